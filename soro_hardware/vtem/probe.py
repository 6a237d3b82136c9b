"""Check of a motion terminal: its slots and the time of its answers; sends no commands."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from soro_hardware.finding import Finding, grade, run_check
from soro_hardware.transport.tcp import ByteLink
from soro_hardware.vtem.config import VtemPlatform
from soro_hardware.vtem.registers import SlotState
from soro_hardware.vtem.terminal import Terminal

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
