"""The published table of error against spatial steps, and where `mde` and `exact` lie, on one picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from benchmarks.options import Options
from benchmarks.report import figure, table
from benchmarks.sixlink import LINKS, PUBLISHED, RATE_HZ, Case, Point
from soro_core import SoftArm
from soro_lab.trade.picture import logarithmic

TITLE = "Trade: mde and exact on the six-link benchmark"
RECOMPUTED = dict(zip(PUBLISHED, (9.2, 5.3, 3.4, 1.6, 1.1, 0.9), strict=True))
"""An independent computation of the same table, over the last 2 s."""
NODES = (2, 3, 4, 6, 8)
FINE_HZ = 200


def run(options: Options) -> str:
    """Measure and write."""
    options.say("reference")
    case = Case(options.pick(10.0, 0.02))
    points: dict[tuple[str, int], list[Point]] = {}
    for rate in options.pick((RATE_HZ, FINE_HZ), (RATE_HZ,)):
        for total in options.pick(tuple(PUBLISHED), (24,)):
            options.say(f"mde, {total} steps, {rate} Hz")
            arm = SoftArm(case.robot, method="mde", steps=total // LINKS)
            points.setdefault(("mde", rate), []).append(case.measure(arm, "trapezoidal", 1 / rate))
        for nodes in options.pick(NODES, (2,)):
            options.say(f"exact, {LINKS * nodes} nodes, {rate} Hz")
            arm = SoftArm(case.robot, nodes=nodes)
            points.setdefault(("exact", rate), []).append(case.measure(arm, "trapezoidal", 1 / rate))
    draw(options.folder / "trade.png", points)
    head = ["method", "rate, Hz", "steps or nodes in all", "mean error, %", "last 2 s, %", "times real time"]
    head += ["published, %", "recomputed, last 2 s, %"]
    rows = [cells(p, rate) for (_, rate), these in points.items() for p in these]
    return "\n\n".join(
        [
            "Error against spatial steps of the six-link benchmark of [C22] (docs/model.md), trapezoidal, at "
            f"the published {RATE_HZ} Hz and at {FINE_HZ} Hz, where the error of time is small beside that "
            f"of space. Converged run: own error {figure(case.own_error, 2)} % of the length.",
            table(head, rows),
            knee(points),
            "![error against cost of mde and exact](trade.png)",
        ]
    )


def cells(p: Point, rate: int) -> list[object]:
    """Row of the table."""
    published = (PUBLISHED.get(p.spatial, "-"), RECOMPUTED.get(p.spatial, "-")) if p.method == "mde" else "--"
    return [p.method, rate, p.spatial, figure(p.error), figure(p.late), figure(p.factor), *published]


def knee(points: dict[tuple[str, int], list[Point]]) -> str:
    """From where on more steps or nodes no longer help, and at what speed that is."""
    lines = []
    for (method, rate), these in points.items():
        floor = min(p.error for p in these)
        enough = next(p for p in these if p.error <= 1.2 * floor)
        lines.append(
            f"- {method} at {rate} Hz: within a fifth of its floor ({figure(floor)} %) from {enough.spatial} "
            f"{'steps' if method == 'mde' else 'nodes'} on, at {figure(enough.factor)} x real time."
        )
    return "\n".join(lines)


def draw(path: Path, points: dict[tuple[str, int], Sequence[Point]]) -> None:
    """Error against spatial steps, and against cost."""
    page = Figure(figsize=(10, 4.9), layout="constrained")
    left, right = page.subplots(1, 2, sharey=True)
    left.plot(list(PUBLISHED), list(PUBLISHED.values()), "kx--", label=f"published, mde, {RATE_HZ} Hz")
    left.plot(list(RECOMPUTED), list(RECOMPUTED.values()), "k+:", label="recomputed elsewhere, 8 s to 10 s")
    styles = {"mde": "^", "exact": "o"}
    for number, ((method, rate), these) in enumerate(points.items()):
        line = {"marker": styles[method], "color": f"C{number}", "label": f"{method}, {rate} Hz"}
        left.plot([p.spatial for p in these], [p.error for p in these], **line)
        right.plot([1e3 / p.factor for p in these], [p.error for p in these], **line)
    left.set_xlabel("steps (mde) or nodes (exact) along the arm")
    left.set_ylabel("mean tip error, % of the length")
    right.set_xlabel("CPU time, ms a simulated second")
    for axes in (left, right):
        logarithmic(axes)
    page.legend(*left.get_legend_handles_labels(), loc="outside lower center", fontsize=8, ncols=3)
    page.savefig(path, dpi=120)
