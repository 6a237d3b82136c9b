"""What steers a recording: services. A bag keeps its clock meanwhile."""

from __future__ import annotations

from collections.abc import Callable

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from soro_core.errors import BagError
from soro_lab.bag import BackgroundWriter
from soro_ros.host.services import create_triggers


class RecorderControls:
    """Services ~/pause, ~/resume, ~/toggle_paused and ~/split.

    Parameters
    ----------
    node : Node
        The recorder.
    resumed : callable
        Called when a pause has ended.

    Attributes
    ----------
    paused : bool
        Whether messages are left out.
    """

    def __init__(self, node: Node, resumed: Callable[[], None]) -> None:
        self._node, self._resumed, self.paused = node, resumed, False
        self._bag: BackgroundWriter | None = None
        actions = {"pause": self._pause, "resume": self._resume, "toggle_paused": self._toggle}
        create_triggers(node, actions | {"split": self._split})

    def begin(self, bag: BackgroundWriter, paused: bool) -> None:
        """Steer the recording of a bag from now on."""
        self._bag, self.paused = bag, paused
        self._node.add_on_set_parameters_callback(self._keep_clock)

    def end(self) -> None:
        """Steer nothing any more: the bag is about to be closed."""
        self._bag = None
        self._node.remove_on_set_parameters_callback(self._keep_clock)

    def _pause(self) -> str:
        self._open_bag()
        self.paused = True
        return "paused: messages are left out"

    def _resume(self) -> str:
        self._open_bag()
        self.paused = False
        self._resumed()
        return "recording"

    def _toggle(self) -> str:
        return self._resume() if self.paused else self._pause()

    def _split(self) -> str:
        self._open_bag().split()
        return "a new file begins"

    def _open_bag(self) -> BackgroundWriter:
        if self._bag is None:
            raise BagError("nothing is being recorded: activate the recorder")
        return self._bag

    def _keep_clock(self, changes: list[Parameter]) -> SetParametersResult:
        """Refuse another clock within a bag: its times would be those of two."""
        present = self._node.get_parameter("use_sim_time").value
        refused = any(change.name == "use_sim_time" and change.value != present for change in changes)
        reason = "use_sim_time: a bag keeps its clock; deactivate the recorder first" if refused else ""
        return SetParametersResult(successful=not refused, reason=reason)
