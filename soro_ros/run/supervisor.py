"""The ROS side of a run: state of the nodes, time, errors, and the services that start control."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.utilities import try_shutdown
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from soro_core.errors import SoroError
from soro_core.safety import Limits
from soro_core.safety.vent_check import REST_S, empty_since
from soro_ros.conversion import messages, qos
from soro_ros.host import claims, middleware, services
from soro_ros.run.processes import NodeError
from soro_ros.status_words import is_requested
from soro_ros.topics.diagnostics import ERROR, WARN

# Nodes publish /diagnostics once a second; a machine that delays them for so long cannot control an arm.
SILENT_S = 8.0
# After a longer time without receiving anything, the silence of a node is counted anew.
DEAF_S = 1.0
# Time in which another program with the same nodes is heard [s].
LOOK_S = 1.5
# Longest time without a reading while an arm becomes empty [s].
SILENT_READINGS_S = 2.0
# Time after which a service is called again [s], longer than one that is busy takes.
REPEAT_S = 2.0
_COMMAND, _DESIRED, _READINGS = "chambers/command", "arm/desired/tip", "chambers/state"


class RunMonitor:
    """Receives /diagnostics, /clock and the first messages of the controller; a context manager.

    Parameters
    ----------
    namespace : str
        Namespace of the robot's nodes.
    arms : sequence of str
        What stands before the names of the nodes of each arm of several, ``left/``.

    Attributes
    ----------
    node : Node
        The supervisor's own node.
    clock_s : float
        Latest time on /clock [s].
    status : dict of str to DiagnosticStatus
        Latest status by name of node.
    """

    def __init__(self, namespace: str, arms: Sequence[str] = ("",)) -> None:
        middleware.init()
        self._arms = arms
        self.node = Node("supervisor", namespace=namespace)
        self._prefix = f"/{namespace}/"
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)
        self.node.create_subscription(Clock, "/clock", self._on_clock, qos.RELIABLE)
        self._first_subscriptions = {
            topic: self.node.create_subscription(kind, topic, partial(self._on_first, topic), qos.NEWEST)
            for arm in arms
            for topic, kind in ((arm + _COMMAND, JointState), (arm + _DESIRED, PoseStamped))
        }
        # Wall time of the first message, and that of /clock.
        self._first_s: dict[str, float] = {}
        self._first_clock_s: dict[str, float] = {}
        self._executor = EventsExecutor()
        self._executor.add_node(self.node)
        self.clock_s, self._ticked_s = 0.0, -math.inf
        self.status: dict[str, DiagnosticStatus] = {}
        self._own: dict[str, str] = {}  # process ids of the nodes of the run, by name
        self._pids: dict[str, set[str]] = {}  # processes that publish under the name of a node
        self._status_s: dict[str, float] = {}  # wall time of the latest status
        self._start_s = time.monotonic()
        self._spun_s = self._listening_s = self._start_s

    def __enter__(self) -> RunMonitor:
        return self

    def __exit__(self, *error: object) -> None:
        self._executor.shutdown()  # it keeps publishers of its nodes alive
        self.node.destroy_node()
        try_shutdown()

    def add_node(self, node: Node) -> None:
        """Also receive the messages of another node."""
        self._executor.add_node(node)

    def spin_once(self, limit_s: float) -> None:
        """Receive the next message, within `limit_s` [s]."""
        self._executor.spin_once(timeout_sec=limit_s)

    def spin(self, seconds: float) -> None:
        """Receive messages for a time [s]."""
        now_s = time.monotonic()
        if now_s - self._spun_s > DEAF_S:
            self._listening_s = now_s
        deadline = now_s + seconds
        while (left := deadline - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)
        self._spun_s = time.monotonic()
        # The first message is enough; more come at the loop's rate.
        for topic in self._first_s.keys() & self._first_subscriptions.keys():
            self.node.destroy_subscription(self._first_subscriptions.pop(topic))

    @property
    def commanded(self) -> bool:
        """Whether each controller has sent a command, zero or not: readings and estimates then reach it."""
        return all(arm + _COMMAND in self._first_s for arm in self._arms)

    @property
    def controlled_s(self) -> float:
        """Wall time [s] since the first set point of each controller; 0 before it."""
        first_s = [self._first_s.get(arm + _DESIRED, math.inf) for arm in self._arms]
        return max(0.0, time.monotonic() - max(first_s))

    @property
    def simulated_s(self) -> float:
        """Time on /clock since the first set point of each controller [s]; 0 before it."""
        first_s = [self._first_clock_s.get(arm + _DESIRED, math.inf) for arm in self._arms]
        return max(0.0, self.clock_s - max(first_s))

    def active(self, name: str) -> bool:
        """Whether a node reports that it is active."""
        return self.values(name).get("lifecycle") == "active"

    def values(self, name: str) -> dict[str, str]:
        """Latest diagnostic values of a node."""
        return {pair.key: pair.value for pair in self.status[name].values} if name in self.status else {}

    def warnings(self) -> dict[str, str]:
        """Latest warnings of the nodes that have one, by name."""
        return {name: str(status.message) for name, status in self.status.items() if status.level == WARN}

    def check(self, names: Iterable[str] | None = None, spares_requested: bool = False) -> None:
        """Raise NodeError if one of these nodes, by default any, reports an error.

        With `spares_requested` a vent that someone asked for is none.
        """
        for name in list(self.status) if names is None else names:
            failure = self.error(name)
            if failure and not (spares_requested and is_requested(self.status[name].message)):
                raise NodeError(name, failure)

    def check_silence(self, names: Iterable[str]) -> None:
        """Raise NodeError if a node that runs the arm is silent on /diagnostics though its process lives.

        A tick of lockstep waits for all of them: while the clock goes on, a late message is the middleware's.
        """
        if time.monotonic() - self._ticked_s <= SILENT_S:
            return
        for name in names:
            if failure := self.silence(name):
                raise NodeError(name, failure)

    def error(self, name: str) -> str:
        """Return the error that a node reports, with its name; "" without one."""
        status = self.status.get(name)
        if status is None or status.level != ERROR:
            return ""
        return f"{name}: {status.message.removeprefix(f'{name}: ')}"

    def silence(self, name: str) -> str:
        """Return that a node has stopped publishing /diagnostics; "" while it has not."""
        heard_s = self._status_s.get(name, math.inf)
        if time.monotonic() - max(heard_s, self._listening_s) <= SILENT_S:
            return ""
        return f"{name}: no message on /diagnostics for {SILENT_S:g} s: it is starved, hangs or was stopped"

    def look(self) -> None:
        """Receive messages until other programs of the domain have been heard."""
        self.spin(max(0.0, self._start_s + LOOK_S - time.monotonic()))

    def listen_to(self, name: str, pid: int) -> None:
        """Take the status of one of the run's nodes from this process alone."""
        self._own[name] = str(pid)

    def check_alone(self, names: Iterable[str]) -> None:
        """Raise ConfigError if another program publishes /diagnostics under one of these names of nodes.

        On this host `claims` finds it sooner; this one may be on another host, or in another container.
        """
        for name in names:
            others = self._pids.get(name, set()) - {self._own.get(name)}
            if others:
                by = f"process {', '.join(sorted(others))}"
                raise claims.taken(self.node, f"{self._prefix}{name}", by)

    def check_clock(self) -> None:
        """Raise ConfigError if another node publishes /clock too: nodes in lockstep would follow both."""
        endpoints = self.node.get_publishers_info_by_topic("/clock")
        names = {f"{one.node_namespace.rstrip('/')}/{one.node_name}" for one in endpoints}
        if others := sorted(names - {f"{self._prefix}{self._arms[0]}twin"}):
            raise claims.taken(self.node, "/clock", ", ".join(others))

    def wait(
        self,
        what: str,
        ready: Callable[[], bool],
        check: Callable[[], None],
        limit_s: float,
        is_paused: Callable[[], bool] = bool,
        advice: Callable[[], str] = str,
    ) -> None:
        """Spin until a condition holds.

        Parameters
        ----------
        what : str
            Description of the condition, for the error.
        ready : callable
            Function that returns whether the condition holds.
        check : callable
            Called while waiting; may raise an error.
        limit_s : float
            Time limit [s].
        is_paused : callable, optional
            While it returns True the time does not run; default: it always runs.
        advice : callable, optional
            Gives the end of the error of a time that is over.

        Raises
        ------
        SoroError
            If a node reports an error, or the time is over.
        """
        left_s, last_s = limit_s, time.monotonic()
        while not ready():
            self.spin(0.05)
            check()
            self.check(self._own or None)
            now_s = time.monotonic()
            left_s -= 0.0 if is_paused() else now_s - last_s
            last_s = now_s
            if left_s < 0.0:
                raise SoroError(f"no {what} within {limit_s:.0f} s{advice()}")

    def call(self, service: str, limit_s: float = 10.0) -> str:
        """Call a Trigger service of the robot's namespace and return its message.

        It is called again while it does not answer, which must do no harm: a second ~/enable behind a vent is
        refused by the latch, a second ~/reset would open a latch that has closed between.

        Raises
        ------
        SoroError
            If it is not there, does not answer, or refuses.
        """
        calling = services.Call(self.node, Trigger, service, Trigger.Request(), REPEAT_S)
        response = services.answer(calling, self.spin, limit_s)
        if not response.success:
            raise SoroError(f"{service}: {response.message}")
        return str(response.message)

    def watch_emptying(
        self, limits: Limits, begin_ns: int, limit_s: float, goes_on: Callable[[], bool], lockstep: bool
    ) -> None:
        """Receive messages until every chamber has been empty for a while, so that the recording has it.

        Parameters
        ----------
        limits : Limits
        begin_ns : int
            Stamp from which on readings count [ns].
        limit_s : float
            Longest time by their stamps [s]; without any reading it is `SILENT_READINGS_S`.
        goes_on : callable
        lockstep : bool
        """
        empty_ns: dict[str, int | None] = dict.fromkeys(self._arms)
        resting, heard_s = set[str](), time.monotonic()

        def take(arm: str, message: JointState) -> None:
            nonlocal heard_s
            now_ns, heard_s = messages.to_ns(message.header.stamp), time.monotonic()
            if now_ns >= begin_ns:
                empty_ns[arm] = since = empty_since(limits, empty_ns[arm], np.array(message.effort), now_ns)
                quiet_s = 0.0 if since is None else 1e-9 * (now_ns - since)
                if quiet_s >= REST_S or now_ns - begin_ns >= 1e9 * limit_s:
                    resting.add(arm)

        subscriptions = [
            self.node.create_subscription(
                JointState, arm + _READINGS, partial(take, arm), qos.sensor(lockstep)
            )
            for arm in self._arms
        ]
        while len(resting) < len(self._arms) and goes_on() and time.monotonic() - heard_s < SILENT_READINGS_S:
            self.spin(0.05)
        for subscription in subscriptions:
            self.node.destroy_subscription(subscription)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name.startswith(self._prefix):
                name = status.name.removeprefix(self._prefix)
                pid = next((pair.value for pair in status.values if pair.key == "pid"), "unknown")
                self._pids.setdefault(name, set()).add(pid)
                if pid == self._own.get(name, pid):
                    self.status[name], self._status_s[name] = status, time.monotonic()

    def _on_first(self, topic: str, message: object) -> None:
        self._first_s.setdefault(topic, time.monotonic())
        self._first_clock_s.setdefault(topic, self.clock_s)

    def _on_clock(self, message: Clock) -> None:
        clock_s = messages.to_ns(message.clock) * 1e-9
        if clock_s > self.clock_s:
            self._ticked_s = time.monotonic()
        self.clock_s = clock_s
