"""Faults: the matrix of every fault on every family, and an hour without one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks.options import Options
from benchmarks.report import met, table
from soro_core.jobs import Processes, map_jobs
from tests.apparatus.faults import cells
from tests.apparatus.faults.cells import Result
from tests.apparatus.faults.matrix import FOUR, MATRIX
from tests.apparatus.faults.rigs import Loop, Rig, rig_of
from tests.apparatus.faults.rows import Row

TITLE = "Faults"


def run(options: Options) -> str:
    """Run every cell, each beside an arm on another bus, and write."""
    beside = Loop(rig_of("canopen_408", HEALTHY))
    beside.rig.regulator.configure()
    sections, total, bad = {}, 0, 0
    for family, rows in MATRIX.items():
        results = []
        for row in rows[: options.pick(len(rows), 1)]:
            options.say(f"{family}: {row.fault}")
            results.append(cells.run(family, row, beside=beside))
        for row in [row for row in rows if row.fault in ON_REAL_LINES][: options.pick(len(rows), 0)]:
            options.say(f"{family} over a real line: {row.fault}")
            found = cells.run(family, row, real=True)
            results.append(replace(found, row=replace(row, fault=f"{row.fault} (real line)")))
        total, bad = total + len(results), bad + sum(bool(result.problems) for result in results)
        sections[family] = [f"### {family}", summary(results), results_table(results)]
    beside.rig.close()
    hours = {family: options.pick(600 if family == FOUR else 3600, 1) for family in MATRIX}
    for family, end in _without_a_fault(hours, options):
        sections[family].append(end)
    parts = [
        _INTRO,
        f"{total} cells, {bad} of them not as stated: {met(not bad)}.",
        *(part for section in sections.values() for part in section),
    ]
    return "\n\n".join(parts)


HEALTHY = Row("", "tolerate")
# Over pseudo-terminals and TCP what is lost takes time on the wall; these cells do not need much of it.
ON_REAL_LINES = ("adapter_unplug", "reboot", "mute", "garbage_line, p: 0.1", "stuck_open")
_INTRO = """\
Every fault is injected into a running arm (chambers on a circle of 25 kPa, 2 s a turn, in lockstep) with the
limits as shipped. *Trip*: time from the injection to the vent command, then to all chambers below 5 kPa (of
those that the fault does not block), the cause matched, the latch held while commands go on and the fault
goes away, a reset refused while pressure is commanded and granted with a zero command; an arm on another bus
goes on beside it. A bound is the family's own (CANopen, our board and the VTEM 100 ms, published VEAB server
150 ms, serial lines the age at which a reading is lost and a round of the line: 236 ms ITV, 213 ms Alicat),
after the time in which the fault becomes visible: 300 or 500 ms of a monitor and the motion that it needs
(tests/apparatus/faults/matrix.py says which, ADR 0013 why)."""


def _without_a_fault(hours: dict[str, int], options: Options) -> Iterator[tuple[str, str]]:
    """What became of each family after so many seconds; in lockstep, so that they may share the machine."""
    if options.quick:
        yield from ((family, healthy(family, seconds)) for family, seconds in hours.items())
        return
    with Processes() as executor:
        ends = map_jobs(partial(_lasted, hours), hours, executor)
        for family, end in zip(hours, ends, strict=True):
            options.say(f"{family}: {hours[family]} s without a fault")
            yield family, end


def _lasted(hours: dict[str, int], family: str) -> str:
    return healthy(family, hours[family])


def healthy(family: str, seconds: float, air: Callable[[Rig], Rig] = lambda rig: rig) -> str:
    """Circles of all sizes and speeds, and steps of full scale, on devices with nothing wrong."""
    rig = air(rig_of(family, HEALTHY))
    loop = Loop(rig)
    try:
        rig.regulator.configure()
        for _ in range(round(seconds / rig.period_s)):
            loop.cycle(healthy_command(loop.cycles * rig.period_s, rig.regulator.n_chambers))
            if loop.vented:
                break
    finally:
        rig.close()
    ran_s = loop.cycles * rig.period_s
    end = f"**tripped** after {ran_s:.1f} s: {loop.cause}" if loop.vented else "no trip"
    return f"Without a fault for {ran_s / 60:.1f} minutes of circles and steps of full scale: {end}."


def healthy_command(t: float, n: int = 3) -> np.ndarray:
    """Set points [Pa gauge] of the chambers: ten seconds each of one kind, circles, holds or steps."""
    number = int(t // 10)
    if number % 2:
        return 90e3 * (np.floor((t + np.arange(n) * 0.3) / (0.2 + 0.2 * (number % 7))) % 2)
    period, size = 0.5 + 0.5 * (number % 16), 5e3 * (1 + number % 9)
    held = number % 6 == 4
    return 45e3 + size * np.sin(2 * np.pi * ((0.0 if held else t / period) + np.arange(n) / 3))


def summary(results: list[Result]) -> str:
    bad = [result for result in results if result.problems]
    kinds = {must: sum(r.row.must == must for r in results) for must in ("tolerate", "degrade", "trip")}
    counts = ", ".join(f"{number} {must}" for must, number in kinds.items())
    return f"{len(results)} faults ({counts}): {len(results) - len(bad)} as stated, {len(bad)} not."


def results_table(results: list[Result]) -> str:
    head = ["fault", "must", "vent command, ms (bound)", "below 5 kPa, ms", "cause, count", "as stated"]
    return table(head, [_line(result) for result in results])


def _line(result: Result) -> list[object]:
    row = result.row
    trip = "-" if result.trip_ms is None else f"{result.trip_ms:.0f} ({row.bound_ms:.0f})"
    empty = "-" if result.empty_ms is None else f"{result.empty_ms:.0f}{' (others)' if row.blocked else ''}"
    empty = "held by the devices" if row.blocked == "arm" else empty
    said = (
        result.cause.split(";")[0]
        if result.cause
        else f"{row.counts} {result.counted}"
        if row.counts
        else "-"
    )
    return [row.fault, row.must, trip, empty, said, "; ".join(result.problems) or "yes"]
