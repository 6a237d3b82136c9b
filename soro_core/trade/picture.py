"""The picture of a study: error against cost, both on logarithmic axes."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from soro_core.trade.results import Row, Study

_FLOOR = 1e-6  # % of the length: nothing is shown below
_STYLES = {"exact": "o", "mde": "^"}


def draw(study: Study, path: Path) -> bool:
    """Write the picture as PNG, unless there is nothing to show; says whether there was."""
    rows = [row for row in study.rows if row.complete]
    if not rows:
        return False
    figure = Figure(figsize=(7.5, 5.2), layout="constrained")
    axes = figure.subplots()
    wish = study.wish
    by_tick = not wish.error

    def cost(row: Row) -> float:
        return row.tick_us if by_tick else 1e3 * row.cpu

    spaces = list(dict.fromkeys(row.candidate.space for row in rows))
    for number, space in enumerate(spaces):
        for method, marker in _STYLES.items():
            these = [r for r in rows if r.candidate.space == space and r.candidate.model.method == method]
            if these:
                axes.plot(
                    [cost(row) for row in these],
                    [max(row.tip, _FLOOR) for row in these],
                    marker,
                    color=f"C{number % 10}",
                    alpha=0.75,
                    markersize=5,
                    label=f"{space}, {method}",
                )
    front = sorted(study.front, key=cost)
    axes.plot([cost(r) for r in front], [max(r.tip, _FLOOR) for r in front], "k-", lw=1.2, label="front")
    own = max(study.reference.own.tip, _FLOOR)
    axes.axhline(own, color="0.6", ls=":", label=f"own error of the reference, {own:.2g} %")
    if wish.error:
        axes.axhline(wish.error_percent, color="C3", ls="--", label=f"wish: {wish.error_percent:g} %")
    else:
        axes.axvline(wish.tick_us, color="C3", ls="--", label=f"wish: {wish.tick_us:g} us")
    chosen = study.choice
    if chosen is not None:
        axes.plot(
            [cost(chosen)], [max(chosen.tip, _FLOOR)], "o", mfc="none", mec="C3", ms=13, mew=2, label="chosen"
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("longest tick, us of CPU" if by_tick else "CPU time, ms a simulated second")
    axes.set_ylabel("RMS error of the tip, % of the length")
    axes.set_title(f"{study.case.robot.name}: {len(rows)} of {study.combinations} combinations", fontsize=10)
    axes.grid(True, which="both", alpha=0.25)
    axes.legend(fontsize=7, ncols=2)
    figure.savefig(path, dpi=120)
    return True
