"""Pictures of the results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from soro_lab.trade.picture import logarithmic


def six_link(
    path: Path, spatial: Sequence[Any], temporal: Sequence[Any], published: Mapping[int, float]
) -> None:
    """Error against spatial steps, and against speed."""
    figure = Figure(figsize=(10, 4.9), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    left.plot(list(published), list(published.values()), "k--x", label="published (mde)")
    for method, style in (("mde", "o-"), ("exact", "s-")):
        points = [p for p in spatial if p.method == method]
        left.plot([p.spatial for p in points], [p.error for p in points], style)
        right.plot([p.factor for p in points], [p.error for p in points], style, label=f"{method}, 50 Hz")
    for integrator in dict.fromkeys(p.integrator for p in temporal):
        points = [p for p in temporal if p.integrator == integrator]
        right.plot([p.factor for p in points], [p.error for p in points], ".:", label=f"exact, {integrator}")
    left.set_xlabel("steps or nodes along the arm")
    left.set_ylabel("mean tip error, % of the length")
    right.set_xlabel("times real time")
    for axes in (left, right):
        logarithmic(axes)
    figure.legend(loc="outside lower center", fontsize=8, ncols=4)
    figure.savefig(path, dpi=120)


def forward(path: Path, links: Sequence[int], curves: Mapping[str, Sequence[float]]) -> None:
    """Time of forward dynamics against the number of links."""
    figure = Figure(figsize=(5.5, 4.2), layout="constrained")
    axes = figure.subplots()
    for name, times in curves.items():
        axes.plot(links, [1e6 * t for t in times], "o-" if "soromox" not in name else "s--", label=name)
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    axes.set_xlabel("links of three strains")
    axes.set_ylabel("forward dynamics, us")
    axes.grid(True, which="both", alpha=0.3)
    axes.legend(fontsize=8)
    figure.savefig(path, dpi=120)
