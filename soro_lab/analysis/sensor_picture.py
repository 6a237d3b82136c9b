"""The picture of `soro place-sensors`: the sensors on the arm, each place alone, what each sensor adds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from soro_lab.analysis.problem import Placement
from soro_lab.analysis.sensor_report import steps

# Room for the names beside the arm, part of its length.
_ROOM = 0.6
_MARKERS = {"pose": "s", "marker": "o", "imu": "^", "bend": "D"}
_COLOURS = {"pose": "tab:blue", "marker": "tab:green", "imu": "tab:red", "bend": "tab:purple"}


def draw(path: Path, placement: Placement, title: str) -> None:
    """Write the picture as PNG.

    Parameters
    ----------
    path : Path
    placement : Placement
    title : str
    """
    figure = Figure(figsize=(12.0, 5.0), layout="constrained")
    arm, alone, gained = figure.subplots(1, 3, width_ratios=(1.1, 1.1, 1.0))
    _arm(arm, placement)
    _alone(alone, placement)
    _gained(gained, placement)
    figure.suptitle(title)
    figure.savefig(path, dpi=110)


def _arm(axes: Any, placement: Placement) -> None:
    """Arm at rest and at its farthest place, in the vertical plane of that place, with the sensors."""
    arm = placement.arm
    tips = [arm.pose(q, arm.length)[:2, 3] for q in (placement.rest, placement.farthest)]
    away = tips[1] - tips[0]
    size = float(np.linalg.norm(away))
    across = away / size if size > 1e-6 else np.array([1.0, 0.0])
    for q, width, colour in ((placement.farthest, 3, "0.75"), (placement.rest, 5, "0.4")):
        x = 1e3 * arm.backbone(q)
        axes.plot(x[:, :2] @ across, x[:, 2], color=colour, lw=width, solid_capstyle="round", zorder=1)
    labels: dict[float, list[str]] = {}
    for number, k in enumerate(placement.chosen, 1):
        one = placement.candidates[k]
        labels.setdefault(one.s, []).append(f"{number} {one.kind.name}")
        for q in (placement.rest, placement.farthest):
            p = 1e3 * arm.pose(q, one.s)[:3, 3]
            style = _MARKERS[one.kind.name]
            size_pt = 11 if one.kind.name in ("pose", "marker") else 6
            axes.plot(
                p[:2] @ across, p[2], style, color=_COLOURS[one.kind.name], ms=size_pt, mec="white", zorder=3
            )
    for s, texts in labels.items():
        p = 1e3 * arm.pose(placement.rest, s)[:3, 3]
        axes.annotate(
            ", ".join(texts), (p[:2] @ across, p[2]), (-10, 0), textcoords="offset points", fontsize=9,
            va="center", ha="right",
        )  # fmt: skip
    axes.set_aspect("equal", adjustable="datalim")
    tip = 1e3 * arm.pose(placement.rest, arm.length)[:3, 3]
    axes.update_datalim([(tip[:2] @ across - _ROOM * 1e3 * arm.length, tip[2])])
    axes.autoscale_view()
    axes.set_xlabel("sideways, mm")
    axes.set_ylabel("z, mm")
    axes.set_title("sensors in the order of choice\n(dark: rest, light: farthest)", fontsize=9)
    axes.grid(True, alpha=0.3)


def _alone(axes: Any, placement: Placement) -> None:
    """Information of each candidate alone, over its place."""
    for name in dict.fromkeys(one.kind.name for one in placement.candidates):
        those = [(one.s, k) for k, one in enumerate(placement.candidates) if one.kind.name == name]
        values = [placement.information.value([k]) for _, k in those]
        x = [1e3 * s for s, _ in those]
        axes.plot(x, values, color=_COLOURS[name], marker=_MARKERS[name], ms=5, lw=1.2, label=name)
    for end in np.cumsum([link.length for link in placement.arm.robot.links])[:-1]:
        axes.axvline(1e3 * end, color="0.6", lw=0.8, ls="--")
    axes.set_xlim(left=0.0)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("place from the base, mm (dashed: ends of links)")
    axes.set_ylabel("information, nat")
    axes.set_title("one sensor alone", fontsize=9)
    axes.legend(fontsize=8)
    axes.grid(True, alpha=0.3)


def _gained(axes: Any, placement: Placement) -> None:
    """Information and deviation of the tip over the number of sensors."""
    found = steps(placement)
    numbers = range(len(found))
    axes.plot(numbers, [step.value for step in found], "k.-", label="information")
    axes.set_xticks(list(numbers))
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("number of sensors")
    axes.set_ylabel("information, nat")
    other = axes.twinx()
    other.semilogy(numbers, [1e3 * step.tip_m for step in found], "o--", color="tab:orange", ms=4)
    other.set_ylabel("expected deviation of the tip, mm", color="tab:orange")
    axes.set_title("what the chosen sensors give", fontsize=9)
    axes.grid(True, alpha=0.3)
