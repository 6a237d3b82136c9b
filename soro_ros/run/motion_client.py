"""One motion or press, from the side of a program that asks for it: `soro move`, `soro press`."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Container, Iterator, Mapping
from typing import Any, ClassVar

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped, WrenchStamped
from nav_msgs.msg import Path
from rcl_interfaces.msg import Parameter as Message
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.parameter import Parameter

from soro_core.errors import ConfigError
from soro_core.run_keys import Frames
from soro_ros.conversion import messages, qos
from soro_ros.conversion.force import wrench
from soro_ros.host.services import ServiceCaller
from soro_ros.topics.motion_job import LOST, MOVING, PLANNING, REACHED, REFUSED, STATUS, WRENCH
from soro_ros.topics.motion_topic import TOPIC

_DESIRED = "arm/desired/tip"
# Time between two lines of progress [s].
_LINE_S = 1.0
# Period of a wait [s].
POLL_S = 0.02
# Time that the last message of a program has to arrive [s].
_ARRIVES_S = 0.5
_UPRIGHT = np.array([0.0, 0, 0, 1])


class NodeClient:
    """Asks one node.

    Parameters
    ----------
    caller : ServiceCaller
    node : str
        Full name of the node.
    limit_s : float
        Longest wait for an answer or a report [s].
    say : callable
        Takes a line of progress.

    Attributes
    ----------
    ended : str
        How the last request has ended, as the node has said; empty if it has not.
    """

    def __init__(self, caller: ServiceCaller, node: str, limit_s: float, say: Callable[[str], None]) -> None:
        self._caller, self._node = caller, node
        self._limit_s, self._say = limit_s, say
        self._namespace, self.ended = node.rpartition("/")[0], ""

    @contextlib.contextmanager
    def configured(
        self, given: Mapping[str, float | bool | None], once: Container[str] = ()
    ) -> Iterator[None]:
        """Set parameters for what is asked; those of a refused request are taken back.

        Parameters
        ----------
        given : mapping
            Values by name; None leaves one as it is.
        once : container of str
            Names of those that are taken back in any case.

        Raises
        ------
        ConfigError
            If the node refuses one; it then takes none.
        """
        wanted = {key: Parameter(key, value=value) for key, value in given.items() if value is not None}
        if not wanted:
            yield
            return
        request = GetParameters.Request(names=list(wanted))
        before = self._call("get_parameters", GetParameters, request).values
        self._set([value.to_parameter_msg() for value in wanted.values()])
        try:
            yield
        finally:
            olds = zip(wanted, before, strict=True)
            back = [(key, old) for key, old in olds if key in once or self.ended == REFUSED]
            self._set([Message(name=key, value=old) for key, old in back])

    def _set(self, parameters: list[Message]) -> None:
        if not parameters:
            return
        request = SetParametersAtomically.Request(parameters=parameters)
        result = self._call("set_parameters_atomically", SetParametersAtomically, request).result
        if not result.successful:
            keys = ", ".join(parameter.name for parameter in parameters)
            values = ", ".join(str(Parameter.from_parameter_msg(one).value) for one in parameters)
            raise ConfigError(self._node, keys, values, result.reason)

    def _call(self, service: str, kind: Any, request: Any) -> Any:
        return self._caller.call(self._node, service, kind, request, self._limit_s)

    def _wait(self, ready: Callable[[], bool]) -> bool:
        deadline = time.monotonic() + self._limit_s
        while not ready() and time.monotonic() < deadline:
            self._caller.spin(POLL_S)
        return ready()

    def _vented(self) -> str:
        """Why the arm of the controller is vented; empty if it is not."""
        for name, status in self._caller.status.items():
            is_of_arm = name.rpartition("/")[0] == self._namespace
            if is_of_arm and status.message.startswith("vented"):
                return f"{name}: {status.message}"
        return ""


class Mover(NodeClient):
    """Sends a path to a controller and follows its reports.

    Parameters
    ----------
    caller : ServiceCaller
    controller : str
        Full name of the controller node.
    limit_s : float
        Longest wait for an answer or a report [s].
    say : callable
        Takes a line of progress.
    """

    topic: ClassVar[str] = TOPIC
    kind: ClassVar[type[Any]] = Path

    def __init__(
        self,
        caller: ServiceCaller,
        controller: str,
        limit_s: float,
        say: Callable[[str], None],
    ) -> None:
        super().__init__(caller, controller, limit_s, say)
        self._tip: np.ndarray | None = None
        self._world = Frames().world
        self._reports: list[DiagnosticStatus] = []
        self._stamp_ns = 0
        node, names = caller.node, self._namespace
        self._sender = node.create_publisher(self.kind, f"{names}/{self.topic}", qos.RELIABLE)
        node.create_subscription(DiagnosticStatus, f"{names}/{STATUS}", self._reports.append, qos.RELIABLE)
        node.create_subscription(PoseStamped, f"{names}/{_DESIRED}", self._on_desired, qos.SENSOR)

    def start(self) -> np.ndarray:
        """Return where the tip is wanted now (3,) [m].

        Raises
        ------
        ConfigError
            If the controller is not in control.
        """
        if not self._wait(lambda: self._tip is not None and self._is_joined()):
            found = "no reference on arm/desired/tip" if self._tip is None else f"no reader of {self.topic}"
            raise ConfigError(self._node, "controller", found, "a controller in control: soro enable")
        return np.asarray(self._tip)

    def move(self, positions: np.ndarray) -> int:
        """Send a path (n, 3) [m] and wait for its end; return the exit status 0, 1 or 2."""
        path = Path(poses=[PoseStamped(pose=messages.pose(row, _UPRIGHT)) for row in positions])
        return self.send(path)

    def send(self, message: Any) -> int:
        """Send a message and wait for the end of its motion; return the exit status 0, 1 or 2."""
        self._publish(message)
        heard, state, next_line = time.monotonic(), "", 0.0
        while time.monotonic() - heard < self._limit_s:
            self._caller.spin(POLL_S)
            for report, values in self._heard():
                heard = time.monotonic()
                if report.name not in (PLANNING, MOVING):
                    self._say(_line(report.name, report.message, values))
                    self.ended = report.name
                    return {REACHED: 0, REFUSED: 2}.get(report.name, 1)
                if report.name != state or heard >= next_line:
                    state, next_line = report.name, heard + _LINE_S
                    self._say(_line(state, report.message, values))
            if vented := self._vented():
                self._say(f"lost: {vented}")
                return 1
        self._say(f"lost: no report of the controller on {STATUS} for {self._limit_s:g} s")
        return 1

    def _publish(self, message: Any) -> None:
        """Stamp and publish a message, from which on reports are those of its motion."""
        self._stamp_ns = self._caller.node.get_clock().now().nanoseconds
        message.header.frame_id, message.header.stamp = self._world, messages.to_time(self._stamp_ns)
        self._reports.clear()
        self.ended = ""
        self._sender.publish(message)

    def _heard(self) -> Iterator[tuple[DiagnosticStatus, dict[str, str]]]:
        """Reports of the motion that was sent, with their values."""
        while self._reports:
            report = self._reports.pop(0)
            values = {pair.key: pair.value for pair in report.values}
            if values.get("stamp_ns") == str(self._stamp_ns):
                yield report, values

    def _is_joined(self) -> bool:
        return (
            self._sender.get_subscription_count() > 0
            and self._caller.node.count_publishers(f"{self._namespace}/{STATUS}") > 0
        )

    def _on_desired(self, message: PoseStamped) -> None:
        # In the frame in which the controller states its own poses, whatever its name.
        self._tip, self._world = messages.pose_arrays(message.pose)[0], message.header.frame_id


class Presser(Mover):
    """Sends a force to a controller and follows its reports; parameters as of `Mover`."""

    topic = WRENCH
    kind = WrenchStamped

    def press(self, force_n: np.ndarray, hold_s: float) -> int:
        """Press with a force (3,) [N], hold it for a time [s] and release; return the exit status 0, 1 or 2.

        A press that is lost, or interrupted by Ctrl-C, releases; one that is replaced is another program's.
        """
        try:
            status = self.send(self._wrench(force_n)) or self._hold(hold_s)
        except KeyboardInterrupt:
            self._release()
            raise
        if status == 0:
            return self.send(self._wrench(np.zeros(3)))
        if self.ended == LOST:
            self._release()
        return status

    def _wrench(self, force_n: np.ndarray) -> WrenchStamped:
        return wrench(force_n, 0, self._world)

    def _release(self) -> None:
        """Ask to release, and give the message time to arrive."""
        self._publish(self._wrench(np.zeros(3)))
        until = time.monotonic() + _ARRIVES_S
        while time.monotonic() < until and not any(True for _ in self._heard()):
            self._caller.spin(POLL_S)

    def _hold(self, hold_s: float) -> int:
        """Watch a force that is reached; return the exit status."""
        until = time.monotonic() + hold_s
        while time.monotonic() < until:
            self._caller.spin(POLL_S)
            for report, values in self._heard():
                if report.name not in (MOVING, REACHED):
                    self.ended = report.name
                    self._say(_line(report.name, report.message, values))
                    return 1
            if vented := self._vented():
                self._say(f"lost: {vented}")
                return 1
        return 0


def _line(state: str, text: str, values: Mapping[str, str]) -> str:
    """One line of progress."""
    parts = [text] if text else []
    if "passed_s" in values:
        parts.append(f"{values['passed_s']} of {values['duration_s']} s")
    if float(values.get("factor", 1.0)) > 1.0 and state == MOVING:
        parts.append(f"{values['factor']} times the time, for pressures and rates to fit")
    if "force_n" in values:
        parts.append(f"{1e3 * float(values['force_n']):.1f} of {1e3 * float(values['goal_n']):g} mN")
    if "from_the_end_m" in values:
        parts.append(f"{1e3 * float(values['from_the_end_m']):.1f} mm from the end")
    return ": ".join([state, ", ".join(parts)]) if parts else state
