"""Output of `soro trade`: table, explanation of the figures, and the model that meets the requirement."""

from __future__ import annotations

from rich import box
from rich.table import Table

from soro_lab.trade.results import CandidateResult, Study
from soro_lab.trade.slow_metrics import LOOP_LAST_S, loop_seconds

SHOWN = 40  # rows of the table; the JSON has them all


def table(study: Study) -> Table:
    """Return the table of what was measured, the front marked."""
    front, chosen = study.front, study.choice
    title = f"{study.case.robot.name}: speed against accuracy (* Pareto front, > chosen)"
    shown = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False)
    for name in ("", "strain x pieces", "method", "integrator"):
        shown.add_column(name, no_wrap=True)
    for name in ("dt ms", "tip %", "shape %", "energy %", "freq %", "ms/s", "tick us", "start ms"):
        shown.add_column(name, justify="right", no_wrap=True)
    loops = any(row.loop for row in study.rows)
    measured = any(row.measured_per_m is not None for row in study.rows)
    for name in ["loop mm", "loop us"] * loops + ["meas. 1/m"] * measured:
        shown.add_column(name, justify="right", no_wrap=True)
    for row in _shown(study):
        mark = (">" if row is chosen else "") + ("*" if row in front else "")
        c, e, k = row.candidate, row.errors, row.cost
        cells = [mark, c.space, c.quadrature, c.integrator, f"{1e3 * c.dt_s:g}"]
        assert e is not None
        assert k is not None
        frequency = "-" if e.frequency is None else _figure(e.frequency)
        cells += [_figure(e.tip), _figure(e.shape), _figure(e.energy), frequency]
        cells += [_figure(1e3 * k.cpu_s_per_s), _figure(k.worst_tick_us), _figure(1e3 * k.startup_s)]
        if loops:
            cells += _loop_cells(row)
        if measured:
            cells.append("" if row.measured_per_m is None else _figure(row.measured_per_m))
        shown.add_row(*cells, style="bold" if row in front else None)
    return shown


def _shown(study: Study) -> list[CandidateResult]:
    """The front, the chosen one, and the others from the most accurate on, in order of cost."""
    front = study.front
    others = [row for row in study.rows if row.complete and row not in front]
    others.sort(key=lambda row: row.tip)
    keep = [*front, *others[: max(0, SHOWN - len(front))]]
    chosen = study.choice
    return [row for row in study.rows if row in keep or row is chosen]


def _loop_cells(row: CandidateResult) -> list[str]:
    if row.loop is None:
        return ["", ""]
    if row.loop.tracking_mm is None:
        return ["n/a", "n/a"]
    return [_figure(row.loop.tracking_mm), _figure(row.loop.typical_us)]


def _figure(value: float) -> str:
    """Three digits, without an exponent where that is readable."""
    return f"{value:.0f}" if 1e3 <= value < 1e6 else f"{value:.3g}"


def notes(study: Study) -> list[str]:
    """Return what the figures mean, and what is missing and why."""
    own, truth = study.reference.own, study.reference
    failed = [row for row in study.rows if row.failure]
    tick = f"{1e3 * study.case.tick_s:g} ms" + (
        "" if study.case.paced else ", or a step where that is longer"
    )
    lines = [
        f"{len(study.rows)} of {study.combinations} combinations were run ({len(failed)} of them failed); "
        f"the table shows at most {SHOWN}, the JSON all.",
        f"Reference: {truth.candidate}; its own error: "
        + (f"of space unknown: {truth.unknown}; of quadrature and time: " if truth.unknown else "")
        + f"tip {own.tip:.2g} %, shape {own.shape:.2g} %, energy "
        f"{own.energy:.2g} %"
        + (f", frequency {own.frequency:.2g} %." if own.frequency is not None else ".")
        + ("" if truth.converged else " It did not converge as far as asked: smaller errors mean nothing.")
        + (" Errors are those beside the same basis." if truth.unknown else ""),
        "Errors: RMS over the run, tip and shape (five places) in % of the length, energy in % of its span. "
        "Times: CPU, kernels compiled, one candidate at a time, median of "
        f"{max((row.cost.repeats for row in study.rows if row.cost), default=0)} runs; a tick is "
        f"{tick}, called from Python. The requirement looks at the tip only.",
    ]
    if truth.note:
        lines.append(f"Of the reference: {truth.note}")
    lines += [f"Not available: {space}: {reason}" for space, reason in study.refused.items()]
    if any(row.loop for row in study.rows) and study.case.scene is not None:
        lines.append(
            f"Closed loop: {loop_seconds(study.case.scene):g} s, RMS distance of the tip from its reference "
            f"over the last {LOOP_LAST_S:g} s; the model in estimator and controller, the reference in the "
            "twin with the scene's payload and sensors; only of some models near the front. loop us: "
            "median CPU time of estimator and controller a tick."
        )
        reasons = {
            row.candidate.space: row.loop.failure for row in study.rows if row.loop and row.loop.failure
        }
        lines += [f"Closed loop not available: {space}: {reason}" for space, reason in reasons.items()]
    causes = {row.failure.split(":", 1)[-1].split(";")[0].strip() for row in failed}
    lines += [f"Failed: {cause}" for cause in sorted(causes)[:5]]
    return lines


def verdict(study: Study) -> str:
    """Return the model that meets the requirement, as a block to paste, or the nearest one."""
    chosen, nearest = study.choice, study.nearest
    if study.stopped:
        return "interrupted: what is done is written; run the same command again to go on"
    if chosen is not None:
        best = "cheapest" if study.requirement.error else "most accurate"
        figures = f"tip {chosen.tip:.3g} %, {1e3 * chosen.cpu:.3g} ms a simulated second"
        return (
            f"{best} model for the requirement ({study.requirement}): "
            f"{figures}, longest tick {chosen.tick_us:.3g} us\n\n{study.block}"
        )
    if nearest is None:
        return f"no model came to its end: nothing meets the requirement ({study.requirement})"
    own = study.reference.own.tip
    got = f"longest tick {nearest.tick_us:.3g} us"
    if study.requirement.error:
        got = f"tip error {nearest.tip:.3g} % (of the reference itself: {own:.2g} %, which counts too)"
    return f"nothing meets the requirement ({study.requirement}); nearest: {got} with {nearest.candidate}"
