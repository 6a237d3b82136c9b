"""Driver of a VTEM motion terminal: all set points and all readings in each cycle.

As far as known, the terminal keeps its set points when messages of the host stop. The bus node may reset its
outputs, but the timeout and the reaction of the valves depend on its parameters. So the driver does not rely
on it: a supervisor process shares the connection and writes 0 Pa when the driver is killed or hangs. For
faults of the cable or the machine, the arm needs a normally open dump valve.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence

from soro_core.arrays import Array, Flags
from soro_core.errors import HardwareError
from soro_hardware.finding import Finding, grade, run_check
from soro_hardware.link_driver import LinkDriver
from soro_hardware.supervisor_client import VentPlan
from soro_hardware.transport.tcp import ByteLink
from soro_hardware.vtem.client import Client
from soro_hardware.vtem.config import VtemPlatform
from soro_hardware.vtem.registers import SlotState
from soro_hardware.vtem.terminal import Terminal

# For the supervisor: longest wait for one answer, and for all.
_ANSWER_S, _LONGEST_S = 0.1, 10.0


class VtemRegulator(LinkDriver[VtemPlatform]):
    """Regulators of one arm on one motion terminal.

    Parameters
    ----------
    platform : VtemPlatform
        Slots, range and times.
    link : ByteLink
        Connection to the bus node; `configure` opens it.
    clock, lockstep : callable, bool
        As in `Driver`.
    """

    source, kind = "terminal", "motion terminal"
    device_watchdog = False
    rest_s = (0.0, 1.0)  # the published driver waits 1 s for the exhaust before it ends the app

    def __init__(
        self, platform: VtemPlatform, link: ByteLink, clock: Callable[[], float], lockstep: bool = False
    ) -> None:
        super().__init__(platform, platform.host, link, clock, lockstep)
        self._client = self.traffic = Client(link, platform.registers.unit, clock)
        self._terminal = Terminal(platform, self._client, clock, lockstep)

    def probe(self) -> Iterator[Finding]:
        return examine(self.platform, self.link, self._terminal, self.clock)

    def start_up(self) -> None:
        self.supervise()
        try:
            # Keep a connection that works: a bus node may allow only a few.
            if not self._is_answered():
                self.link.open()
            self.connected()
            self._terminal.start()
        except HardwareError as error:
            self.give_up()
            raise HardwareError(error.text, error.device, error.code, "start-up") from None
        self.sent_pa, self.pressure_pa = self._terminal.sent_pa, self._terminal.pressure_pa

    def connected(self) -> None:
        self._client.reset()
        self.share()

    def send_and_receive(self, setpoint_pa: Array) -> Flags | bool:
        terminal = self._terminal
        deadline_s = self.clock() + self.patience_s(self.platform.budget_s)
        try:
            fresh = terminal.exchange(setpoint_pa, deadline_s)
        finally:
            self.sent_pa, self.pressure_pa = terminal.sent_pa, terminal.pressure_pa
        if self._client.refusal is not None:
            self.latch.add("command_rejected", self.source, self._client.refusal)
        if fresh is None:
            self.answers_lost += 1
            return False
        # A slot whose motion app has stopped ignores set points until `configure` starts the app again.
        for slot, status in terminal.statuses.items():
            if not status.regulates:
                code = "rebooted" if ("link_lost", self.source) in self.latch else "left_operational"
                code = "device_error" if status.state is SlotState.FAILED else code
                self.latch.add(code, terminal.chambers_of(slot), str(status))
        return fresh

    def post_zeros(self) -> None:
        self._terminal.vent()
        self.sent_pa = self._terminal.sent_pa

    def shut_down(self, is_empty: bool) -> None:
        # A valve may keep its pressure when its app ends; while the app runs at 0 Pa, the valve exhausts.
        if is_empty:
            self._terminal.stop()

    def vent_plan(self) -> VentPlan:
        return VentPlan(self.kind, self._terminal.vent_steps(), _ANSWER_S, _LONGEST_S)

    def _is_answered(self) -> bool:
        """Return whether there is a connection that works."""
        with contextlib.suppress(HardwareError):
            return self.link.is_open and self._terminal.read(self.platform.host.answer_timeout_s)
        return False


open_driver = VtemRegulator.over_tcp


_READINGS = 50


def examine(
    platform: VtemPlatform, link: ByteLink, terminal: Terminal, clock: Callable[[], float]
) -> Iterator[Finding]:
    """Connect, read the slots, and disconnect; yields findings.

    Parameters
    ----------
    platform : VtemPlatform
        Slots and times.
    link : ByteLink
        Connection to the bus node.
    terminal : Terminal
        Slots in use.
    clock : callable
        Returns a monotonic time [s].
    """
    advice = "check address, port and cable of the bus node, and that it is set to Modbus TCP"
    return run_check("motion terminal", advice, _read(platform, link, terminal, clock), link.close)


def _read(
    platform: VtemPlatform, link: ByteLink, terminal: Terminal, clock: Callable[[], float]
) -> Iterator[Finding]:
    link.open()
    terminal.client.reset()
    if terminal.read(platform.host.answer_timeout_s):
        yield from _slots(terminal)
        yield check_speed(platform, list(_answers(platform, terminal, clock)))
    else:
        why = terminal.client.refusal or "connected, but no answer to a reading"
        advice = (
            "check registers.inputs and registers.unit, and that the terminal is the first module of the node"
        )
        yield Finding("motion terminal", "fail", why, advice)


def _slots(terminal: Terminal) -> Iterator[Finding]:
    for slot, status in terminal.statuses.items():
        yield grade(
            terminal.chambers_of(slot),
            str(status),
            (status.is_idle, "ok", ""),
            (
                status.state is SlotState.FAILED,
                "fail",
                "check supply pressure and load voltage; the display of the node names the error",
            ),
            (
                status.state is SlotState.RUNNING,
                "warn",
                "end the program that drives the slot; one that was killed may have left it running",
            ),
            (True, "warn", "find the cause; the start-up acknowledges the error"),
        )


def _answers(platform: VtemPlatform, terminal: Terminal, clock: Callable[[], float]) -> Iterator[float]:
    for _ in range(_READINGS):
        begin_s = clock()
        terminal.read(platform.host.answer_timeout_s)
        yield clock() - begin_s


def check_speed(platform: VtemPlatform, took_s: Sequence[float]) -> Finding:
    """Check the durations of transactions [s] against the time of a cycle for one or two of them."""
    budget_s, each = platform.budget_s, 1 if platform.registers.one_transaction else 2
    middle_s, worst_s = sorted(took_s)[len(took_s) // 2], max(took_s)
    found = (
        f"answers after {middle_s * 1e3:.1f} ms, {worst_s * 1e3:.1f} ms at most of {len(took_s)}; "
        f"a cycle has {budget_s * 1e3:.1f} ms for {each}"
    )
    advice = "lower cycle_hz and the scene's rate, raise cycle_budget_s, or use a separate cable"
    return grade("speed", found, (each * worst_s > budget_s, "warn", advice))
