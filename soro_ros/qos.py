"""Quality of service of soro's topics."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

# Everything soro publishes; deep enough that lockstep loses nothing to a slow recorder.
RELIABLE = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
# Readers of sensors in real time: a best-effort reader also hears a reliable writer.
SENSOR = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
# Set once, wanted by late joiners.
LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)


def sensor(lockstep: bool) -> QoSProfile:
    """QoS of a reader of sensors: nothing may be lost in lockstep, nothing may block in real time."""
    return RELIABLE if lockstep else SENSOR
