"""What the doctor asks a motion terminal: its slots, and how quickly it answers. Nothing is commanded."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from soro_core.errors import HardwareError
from soro_core.hardware.finding import Finding
from soro_core.hardware.transport.tcp import ByteLink
from soro_core.hardware.vtem.config import VtemPlatform
from soro_core.hardware.vtem.registers import State
from soro_core.hardware.vtem.terminal import Terminal

_READINGS = 50


def look(
    platform: VtemPlatform, link: ByteLink, terminal: Terminal, clock: Callable[[], float]
) -> Iterator[Finding]:
    """Connect, read, and leave."""
    try:
        link.open()
        terminal.client.reset()
        if terminal.read(platform.host.answer_timeout_s):
            yield from _slots(terminal)
            yield check_speed(platform, list(_answers(platform, terminal, clock)))
        else:
            why = terminal.client.refusal or "connected, but no answer to a reading"
            advice = (
                "see registers.inputs and registers.unit, and that the terminal is the node's first module"
            )
            yield Finding("motion terminal", "fail", why, advice)
    except HardwareError as error:
        advice = "see address and port of the bus node, its cable, and that it is set to Modbus TCP"
        yield Finding("motion terminal", "fail", str(error), advice)
    finally:
        link.close()


def _slots(terminal: Terminal) -> Iterator[Finding]:
    for slot, status in terminal.statuses.items():
        name, found = terminal.chambers_of(slot), str(status)
        if status.is_idle:
            yield Finding(name, "ok", found)
        elif status.state is State.FAILED:
            yield Finding(name, "fail", found, "supply pressure, load voltage; the node's display names it")
        elif status.state is State.RUNNING:
            yield Finding(name, "warn", found, "another program drives it, or one has not ended it")
        else:
            yield Finding(name, "warn", found, "the start-up acknowledges it; look for its cause before")


def _answers(platform: VtemPlatform, terminal: Terminal, clock: Callable[[], float]) -> Iterator[float]:
    for _ in range(_READINGS):
        begin_s = clock()
        terminal.read(platform.host.answer_timeout_s)
        yield clock() - begin_s


def check_speed(platform: VtemPlatform, took_s: Sequence[float]) -> Finding:
    """How long transactions took [s], against the time that a cycle has for its one or two."""
    budget_s, each = platform.budget_s, 1 if platform.registers.one_transaction else 2
    middle_s, worst_s = sorted(took_s)[len(took_s) // 2], max(took_s)
    found = (
        f"answers after {middle_s * 1e3:.1f} ms, {worst_s * 1e3:.1f} ms at most of {len(took_s)}; "
        f"a cycle has {budget_s * 1e3:.1f} ms for {each}"
    )
    if each * worst_s > budget_s:
        advice = "lower cycle_hz and the scene's rate, raise cycle_budget_s; a cable of its own"
        return Finding("speed", "warn", found, advice)
    return Finding("speed", "ok", found)
