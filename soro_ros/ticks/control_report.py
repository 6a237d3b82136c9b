"""What a controller node reports of each tick: where the tip ought to be, and what the law has learned."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

from geometry_msgs.msg import PoseStamped, WrenchStamped
from sensor_msgs.msg import JointState

from soro_core.control.command import Command
from soro_core.control.force.press import Press
from soro_ros.conversion import force, messages


class ControlReport:
    """Publishes where the tip ought to be, the wanted force, and the law's estimates, deviations and terms.

    Parameters
    ----------
    coordinates : sequence of str
        Names of the coordinates.
    world : str
        Name of the frame of the poses.
    publish : callable
        Takes the name of a topic and a message.
    is_read : callable
        Takes the name of a topic and says whether its message is wanted: making it takes time.
    """

    outputs: ClassVar[dict[str, type[Any]]] = {
        "arm/desired/tip": PoseStamped,
        "arm/configured/tip": PoseStamped,
        "arm/desired/wrench": WrenchStamped,
        "controller/estimates": JointState,
        "controller/deviations": JointState,
        "controller/terms": JointState,
    }

    def __init__(
        self,
        coordinates: Sequence[str],
        world: str,
        publish: Callable[[str, Any], None],
        is_read: Callable[[str], bool],
    ) -> None:
        self._coordinates, self._world = coordinates, world
        self._publish, self._is_read = publish, is_read

    def publish(self, command: Command, press: Press | None, stamp_ns: int) -> None:
        """Publish what belongs to a command.

        Parameters
        ----------
        command : Command
        press : Press or None
            The press under way.
        stamp_ns : int
            Time of both [ns].
        """
        tips = {"arm/desired/tip": command.tip_reference, "arm/configured/tip": command.configured_tip}
        for topic, tip in tips.items():
            if tip is not None and self._is_read(topic):
                self._publish(topic, messages.pose_stamped(tip, stamp_ns, self._world))
        if press is not None and self._is_read("arm/desired/wrench"):
            goal = force.wrench(-press.force_n * press.direction, stamp_ns, self._world)
            self._publish("arm/desired/wrench", goal)
        for topic, values in (
            ("controller/estimates", lambda: command.estimates),
            ("controller/deviations", lambda: command.deviations()),
            ("controller/terms", lambda: self._terms(command)),
        ):
            if self._is_read(topic):
                self._publish_values(topic, values(), stamp_ns)

    def _terms(self, command: Command) -> dict[str, float]:
        return {
            f"{name}/{term}": float(value)
            for term, values in (command.terms or {}).items()
            for name, value in zip(self._coordinates, values, strict=True)
        }

    def _publish_values(self, topic: str, values: Mapping[str, float], stamp_ns: int) -> None:
        message = JointState(name=list(values), position=list(values.values()))
        message.header.stamp = messages.to_time(stamp_ns)
        self._publish(topic, message)
