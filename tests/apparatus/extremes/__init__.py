"""Extremes: what the arm and the loop do where numbers are very small, very large or none."""

from __future__ import annotations

from collections.abc import Iterable

from benchmarks.options import Options
from benchmarks.report import table
from tests.apparatus.extremes import crushed
from tests.apparatus.extremes.cell import Cell, Must, Outcome, Verdict
from tests.apparatus.extremes.cells import cells
from tests.apparatus.extremes.limited import LIMIT_S, MUST_LIMIT_S, verdicts
from tests.apparatus.extremes.loop_cells import loop_cells
from tests.apparatus.extremes.measure import Release

TITLE = "Extremes"
INTRO = (
    "Each cell: what became of the run; in brackets what had to, where that is not to finish. A run is "
    "finished only when it is finite and physical: no elongation of -1 or less, no energy from nowhere. "
    "What had to happen was stated beforehand; cells that are not as stated are in bold, "
    f"and what takes longer than {LIMIT_S:g} s, {MUST_LIMIT_S:g} s where it must finish, is left open."
)


def run(options: Options) -> str:
    """Measure and write."""
    every = [*cells(), *loop_cells()]
    # For a test of the writing, a cell of each group is enough.
    chosen = list({cell.group: cell for cell in every if cell.quick}.values()) if options.quick else every
    results: list[tuple[Cell, Verdict]] = []
    for cell, verdict in verdicts(chosen):
        options.say(f"{len(results) + 1} of {len(chosen)}: {cell}")
        results.append((cell, verdict))
    stopped = [
        (str(cell), cell.task)
        for cell, verdict in results
        if cell.must is Must.FINISH and verdict.outcome is Outcome.STOPPED and isinstance(cell.task, Release)
    ]
    truth = f"\n\n### Crushed in truth\n\n{crushed.text(stopped, options)}" if stopped else ""
    return text(results) + truth


def text(results: list[tuple[Cell, Verdict]]) -> str:
    """Tables, one a group, and the cells that are not as stated."""
    late = [(cell, verdict) for cell, verdict in results if verdict.outcome is Outcome.OPEN]
    wrong = [one for one in results if not one[0].must.allows(one[1].outcome) and one not in late]
    done = len(results) - len(late)
    parts = [INTRO, f"As stated: {done - len(wrong)} of {done} cells; {len(late)} more were left open."]
    parts += [f"### {name}\n\n{_grid(part)}" for name, part in _by_group(results).items()]
    if wrong:
        parts.append(
            "### Not as stated\n\n" + "\n".join(f"- {cell}: {verdict.note}" for cell, verdict in wrong)
        )
    if late:
        parts.append("### Open\n\n" + "\n".join(f"- {cell}: {verdict.note}" for cell, verdict in late))
    return "\n\n".join(parts)


def _by_group(results: Iterable[tuple[Cell, Verdict]]) -> dict[str, list[tuple[Cell, Verdict]]]:
    groups: dict[str, list[tuple[Cell, Verdict]]] = {}
    for cell, verdict in results:
        groups.setdefault(cell.group, []).append((cell, verdict))
    return groups


def _grid(results: list[tuple[Cell, Verdict]]) -> str:
    rows = list(dict.fromkeys(cell.row for cell, _ in results))
    columns = list(dict.fromkeys(cell.column for cell, _ in results))
    at = {(cell.row, cell.column): _mark(cell, verdict) for cell, verdict in results}
    return table(["", *columns], [[row, *(at.get((row, column), "") for column in columns)] for row in rows])


def _mark(cell: Cell, verdict: Verdict) -> str:
    name = verdict.outcome.value
    shown = name if cell.must.value == "finish" else f"{name} ({cell.must.value})"
    if verdict.outcome is Outcome.FINISHED:
        shown += f"; {verdict.note}"
    good = cell.must.allows(verdict.outcome) or verdict.outcome is Outcome.OPEN
    return shown if good else f"**{shown}**"
