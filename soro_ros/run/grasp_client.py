"""One grasp, from the side of a program that asks for it: `soro grasp`."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator

from diagnostic_msgs.msg import DiagnosticStatus
from std_srvs.srv import Trigger

from soro_core.errors import SoroError
from soro_ros.conversion import qos
from soro_ros.host.services import ServiceCaller
from soro_ros.run.motion_client import POLL_S, NodeClient
from soro_ros.topics.motion_job import GRASP, LOST, REFUSED, VENTED

# Time between two lines of progress [s].
_LINE_S = 1.0


class Grasper(NodeClient):
    """Asks a hand to close or to open, and follows its reports.

    Parameters
    ----------
    caller : ServiceCaller
    node : str
        Full name of the hand.
    limit_s : float
        Longest wait for an answer or for progress [s].
    say : callable
        Takes one line of text.
    """

    def __init__(self, caller: ServiceCaller, node: str, limit_s: float, say: Callable[[str], None]) -> None:
        super().__init__(caller, node, limit_s, say)
        self._reports: list[DiagnosticStatus] = []
        self._said, self._said_s = "", 0.0
        topic = f"{self._namespace}/{GRASP}"
        caller.node.create_subscription(DiagnosticStatus, topic, self._reports.append, qos.RELIABLE)
        self._wait(lambda: caller.node.count_publishers(topic) > 0)

    def grasp(self, hold_s: float | None) -> int:
        """Close, hold for a time [s] and open, or with None leave it held; return the exit status 0, 1 or 2.

        Ctrl-C opens the hand.
        """
        with self._interruptible():
            status = self._ask("close") or self._until("holding")
            if status and not self.ended:  # it has fallen silent, but may listen
                self._let_go("gives up")
            if status or hold_s is None:
                return status
            status = self._hold(hold_s)
        return self.open() or status if self.ended not in (LOST, VENTED) else status

    def open(self) -> int:
        """Open the hand, also at Ctrl-C; return the exit status 0, 1 or 2."""
        with self._interruptible():
            return self._ask("open") or self._until("open")

    @contextlib.contextmanager
    def _interruptible(self) -> Iterator[None]:
        try:
            yield
        except KeyboardInterrupt:
            self._let_go("interrupted")
            raise

    def _let_go(self, why: str) -> None:
        """Ask the hand to open, wait for its answer, and say what it does now."""
        try:
            if self._ask("open") == 0:
                self._say(f"{why}: the hand opens")
        except (SoroError, KeyboardInterrupt) as error:
            found = error or "interrupted again"
            self._say(f"{why}: {found}: the hand may go on to close or hold: soro grasp open")

    def _ask(self, service: str) -> int:
        self._reports.clear()
        answer = self._call(service, Trigger, Trigger.Request())
        if not answer.success:
            self.ended = REFUSED
            self._say(f"{REFUSED}: {answer.message}")
        return 0 if answer.success else 2

    def _until(self, wanted: str) -> int:
        """Wait for a state; return the exit status."""
        since_s, last = time.monotonic(), ("", "")
        while time.monotonic() - since_s < self._limit_s:
            for report in self._heard():
                if report.name in (wanted, LOST, VENTED):
                    self.ended = report.name
                    return 0 if report.name == wanted else 1
                level = next(pair.value for pair in report.values if pair.key == "pressure_pa")
                if (report.name, level) != last:
                    since_s, last = time.monotonic(), (report.name, level)
        found = f"still {last[0]}, its pressures stand" if last[0] else f"no report of the hand on {GRASP}"
        self._say(f"lost: {found} for {self._limit_s:g} s")
        return 1

    def _hold(self, hold_s: float) -> int:
        """Watch a hand that holds; return the exit status."""
        until, last = time.monotonic() + hold_s, "holding"
        while time.monotonic() < until:
            for report in self._heard():
                last = report.name
                if last in (LOST, VENTED):
                    self.ended = last
                    return 1
        if last != "holding":
            self._say(f"lost: still {last} after {hold_s:g} s")
        return 0 if last == "holding" else 1

    def _heard(self) -> Iterator[DiagnosticStatus]:
        """Receive for a moment, and give what has come; new words are said at once."""
        self._caller.spin(POLL_S)
        while self._reports:
            report = self._reports.pop(0)
            values = {pair.key: float(pair.value) for pair in report.values}
            words = f"{report.name}: {report.message}"
            if words != self._said or time.monotonic() > self._said_s + _LINE_S:
                self._said, self._said_s = words, time.monotonic()
                force, level = 1e3 * values["force_n"], 1e-3 * values["pressure_pa"]
                self._say(f"{words}, {force:.1f} mN a finger at {level:.1f} kPa")
            yield report
        if vented := self._vented():
            yield DiagnosticStatus(name=VENTED, message=vented)
