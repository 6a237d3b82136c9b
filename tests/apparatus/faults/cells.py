"""One cell of the matrix: inject, and compare what happens with what must."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tests.apparatus.faults.rigs import Loop, Rig, rig_of
from tests.apparatus.faults.rows import CHAMBER, Row

EMPTY_PA = 5e3
BEFORE_S, AFTER_S = 0.6, 2.0
TURN_S = 2.0
# From the vent command to where the devices follow it when the bus carries nothing: their own watchdogs
# (heartbeat consumer and set point deadline of the shipped platform, 100 ms) and two cycles.
VENT_SLACK_S = 0.11
_HEALTHY = Row("", "tolerate")


def command(row: Row, t: float, n: int = 3) -> np.ndarray:
    """Set points [Pa gauge] of `n` chambers at a time [s]."""
    # Half a turn when the fault comes: its chamber is at 23 kPa then, and rising.
    turns = 0.0 if row.motion == "hold" else 0.5 + (t - BEFORE_S) / TURN_S
    angle = 2 * math.pi * turns
    return 45e3 + 25e3 * np.sin(angle + 2 * math.pi / 3 * np.arange(n))


@dataclass(frozen=True)
class Result:
    """What happened; `problems` is empty if it is what had to happen."""

    row: Row
    cause: str
    trip_ms: float | None
    empty_ms: float | None
    counted: int
    problems: tuple[str, ...]


def run(
    family: str,
    row: Row,
    real: bool = False,
    beside: Loop | None = None,
    air: Callable[[Rig], Rig] = lambda rig: rig,
) -> Result:
    """Run one cell, with an arm on another bus beside it that must not notice; `air` changes the rig's."""
    rig = air(rig_of(family, row, real))
    try:
        rig.regulator.configure()
        result = _judge(row, _Pair(rig, beside))
    finally:
        rig.close()
    if beside is None or not (beside.vented or beside.rig.devices.pressure_pa.max() < 15e3):
        return result
    return replace(result, problems=(*result.problems, f"the other arm too: {beside.cause}"))


class _Pair(Loop):
    """A loop, and one beside it that goes on whatever happens here."""

    def __init__(self, rig: Rig, beside: Loop | None) -> None:
        super().__init__(rig)
        self._beside = beside

    def cycle(self, command_pa: np.ndarray | None) -> None:
        super().cycle(command_pa)
        if self._beside is not None:
            self._beside.cycle(command(_HEALTHY, self._beside.cycles * self._beside.rig.period_s))


def _judge(row: Row, loop: Loop) -> Result:
    rig, problems = loop.rig, []
    _spin(loop, row, BEFORE_S)
    if loop.vented:
        return Result(row, loop.cause or "", None, None, 0, ("tripped before the fault",))
    before, start = rig.regulator.statistics, loop.cycles
    for injection in row.injections():
        rig.at_devices(lambda injection=injection: rig.devices.faults.add(injection))
    _spin(loop, row, AFTER_S, until=lambda: loop.vented)
    cause = loop.cause or ""
    trip_ms = None if loop.vented_at is None else (loop.vented_at - start + 1) * rig.period_s * 1e3
    empty_ms = None
    if row.must == "trip":
        if trip_ms is None:
            problems.append(f"no trip within {AFTER_S:g} s")
        else:
            if trip_ms > row.bound_ms:
                problems.append(f"vent command after {trip_ms:.0f} ms, bound {row.bound_ms:.0f} ms")
            if not re.search(row.cause, cause):
                problems.append(f"cause {cause!r} does not match {row.cause!r}")
            empty_ms = _vents(row, loop, problems)
            _stays_vented_until_reset(row, loop, problems)
    elif trip_ms is not None:
        problems.append(f"tripped: {cause}")
    elif loop.exchange is None or loop.exchange.sent_pa.max() < 30e3:
        problems.append("the arm did not go on")
    counted = 0
    if row.counts:
        counted = getattr(rig.regulator.statistics, row.counts) - getattr(before, row.counts)
        if counted <= 0:
            problems.append(f"{row.counts} has not grown")
    return Result(row, cause, trip_ms, empty_ms, counted, tuple(problems))


def _spin(
    loop: Loop, row: Row, seconds: float, until: Callable[[], bool] = lambda: False, zero: bool = False
) -> None:
    end = loop.cycles + round(seconds / loop.rig.period_s)
    while loop.cycles < end and not until():
        wanted = command(row, loop.cycles * loop.rig.period_s, loop.rig.regulator.n_chambers)
        loop.cycle(np.zeros_like(wanted) if zero else wanted)


def _vents(row: Row, loop: Loop, problems: list[str]) -> float | None:
    """Time until every chamber that can is below 5 kPa; within the vent time of the flow model."""
    rig, start = loop.rig, loop.cycles
    free = [n for n, name in enumerate(rig.regulator.chamber_names) if not (row.blocked and name == CHAMBER)]
    if row.blocked == "arm":
        return None
    highest = float(rig.devices.pressure_pa[free].max())
    bound_s = rig.vent_time(max(highest, EMPTY_PA), EMPTY_PA, row.slower) + VENT_SLACK_S + row.late_s
    _spin(loop, row, bound_s + 0.5, until=lambda: bool(rig.devices.pressure_pa[free].max() < EMPTY_PA))
    took_s = (loop.cycles - start) * rig.period_s
    if rig.devices.pressure_pa[free].max() >= EMPTY_PA:
        problems.append(f"still {rig.devices.pressure_pa[free].max() / 1e3:.1f} kPa after {took_s:.1f} s")
        return None
    if took_s > bound_s:
        problems.append(f"below 5 kPa after {took_s * 1e3:.0f} ms, bound {bound_s * 1e3:.0f} ms")
    return took_s * 1e3


def _stays_vented_until_reset(row: Row, loop: Loop, problems: list[str]) -> None:
    """Latched while commands go on, whatever becomes of the fault; a reset needs a zero command."""
    cause = loop.cause
    loop.rig.at_devices(loop.rig.devices.faults.clear)
    _spin(loop, row, 0.15)
    if not loop.vented or loop.cause != cause:
        problems.append("the latch opened by itself, or changed its cause")
    if loop.reset() is None:
        problems.append("reset while pressure was commanded")
    _spin(loop, row, 0.15, zero=True)
    loop.rig.at_devices(loop.rig.mend)
    refusal = loop.reset()
    if refusal is not None:
        problems.append(f"reset refused: {refusal}")
        return
    _spin(loop, row, 0.6)
    if loop.vented:
        problems.append(f"tripped again after reset: {loop.cause}")
    elif loop.rig.devices.pressure_pa.max() < 30e3:
        problems.append("no pressure after reset")
