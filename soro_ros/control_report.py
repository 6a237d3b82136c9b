"""What a controller node reports of each tick: where the tip ought to be, and what the law has learned."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar

from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState

from soro_core.control.command import Command
from soro_ros import messages


class ControlReport:
    """Publishes arm/desired/tip and the law's estimates, deviations and terms.

    Parameters
    ----------
    coordinates : sequence of str
        Names of the coordinates.
    world : str
        Name of the frame of the poses.
    publish : callable
        Takes the name of a topic and a message.
    """

    outputs: ClassVar[dict[str, type[Any]]] = {
        "arm/desired/tip": PoseStamped,
        "controller/estimates": JointState,
        "controller/deviations": JointState,
        "controller/terms": JointState,
    }

    def __init__(self, coordinates: Sequence[str], world: str, publish: Callable[[str, Any], None]) -> None:
        self._coordinates, self._world, self._publish = coordinates, world, publish

    def publish(self, command: Command, stamp_ns: int) -> None:
        """Publish what belongs to a command of this time [ns]."""
        self._publish("arm/desired/tip", messages.pose_stamped(command.tip_reference, stamp_ns, self._world))
        terms = {
            f"{name}/{term}": float(value)
            for term, values in (command.terms or {}).items()
            for name, value in zip(self._coordinates, values, strict=True)
        }
        for topic, values_by_name in (
            ("controller/estimates", command.estimates),
            ("controller/deviations", command.deviations),
            ("controller/terms", terms),
        ):
            message = JointState(name=list(values_by_name), position=list(values_by_name.values()))
            message.header.stamp = messages.to_time(stamp_ns)
            self._publish(topic, message)
