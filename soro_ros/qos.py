"""Quality of service of soro's topics."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

# Everything soro publishes; deep enough that lockstep loses nothing to a slow recorder.
RELIABLE = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
# A reader that wants the present state of affairs and no queue.
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
# Readers of sensors in real time: a best-effort reader also hears a reliable writer.
SENSOR = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
# A replay as fast as its reader takes it: a bounded history would overwrite what has not been read yet.
REPLAY = QoSProfile(history=HistoryPolicy.KEEP_ALL, depth=0, reliability=ReliabilityPolicy.RELIABLE)


# In lockstep a lost message is a deadlock: what was published before a reader was there reaches it as well.
LOCKSTEP = QoSProfile(
    depth=1000, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)


# What a replay makes, possibly much faster than real time.
REPLAYED = QoSProfile(
    depth=10000, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)


def loop(lockstep: bool) -> QoSProfile:
    """QoS of what belongs to the control loop."""
    return LOCKSTEP if lockstep else RELIABLE


def command(lockstep: bool) -> QoSProfile:
    """QoS of the reader of commands: in real time only the newest, for those before it are history."""
    return LOCKSTEP if lockstep else NEWEST


def array(lockstep: bool) -> QoSProfile:
    """QoS of the reader of commands without a stamp, which anybody may publish."""
    return RELIABLE if lockstep else NEWEST


def sensor(lockstep: bool) -> QoSProfile:
    """QoS of a reader of sensors: nothing may be lost in lockstep, nothing may block in real time."""
    return LOCKSTEP if lockstep else SENSOR
