"""Quality of service of soro's topics."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

# Topics that soro publishes; the depth suffices for a slow recorder in lockstep.
RELIABLE = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
# A reader of the newest message alone.
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
# Readers of sensors in real time: a best-effort reader also receives from a reliable writer.
SENSOR = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
# Topics of a replay at the rate of its reader: a bounded history would overwrite unread messages.
REPLAY = QoSProfile(history=HistoryPolicy.KEEP_ALL, depth=0, reliability=ReliabilityPolicy.RELIABLE)


# The present state, which also a late reader receives.
LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)

# In lockstep a lost message is a deadlock: a late reader also receives earlier messages.
LOCKSTEP = QoSProfile(
    depth=1000, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)


# Topics of a replay, which may be much faster than real time.
REPLAYED = QoSProfile(
    depth=10000, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)


def loop(lockstep: bool) -> QoSProfile:
    """QoS of the topics of the control loop."""
    return LOCKSTEP if lockstep else RELIABLE


def command(lockstep: bool) -> QoSProfile:
    """QoS of the reader of commands: in real time only the newest command counts."""
    return LOCKSTEP if lockstep else NEWEST


def array(lockstep: bool) -> QoSProfile:
    """QoS of the reader of commands without a stamp, from any publisher."""
    return RELIABLE if lockstep else NEWEST


def sensor(lockstep: bool) -> QoSProfile:
    """QoS of a reader of sensors: nothing may be lost in lockstep, nothing may block in real time."""
    return LOCKSTEP if lockstep else SENSOR


def reference(lockstep: bool) -> QoSProfile:
    """QoS of what a user wants of the arm: the same in both."""
    return RELIABLE
