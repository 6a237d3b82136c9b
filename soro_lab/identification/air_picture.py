"""Pictures of measured step responses and the models fitted to them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator, ScalarFormatter

from soro_core.arrays import Array
from soro_lab.identification.regulator_fit import GOOD, AirFit
from soro_lab.identification.steps import Step
from soro_lab.identification.valves import grid

STYLES = ("C7:", "C0--", "C3-", "C2-.", "C4-")
DOT = {"marker": ".", "linestyle": "none", "markersize": 3, "alpha": 0.5}


def draw(path: Path, steps: Sequence[Step], fits: Sequence[AirFit]) -> None:
    """Draw fills, vents, and times to 63.2 %, measured and modelled.

    Parameters
    ----------
    path : Path
        File of the picture.
    steps : sequence of Step
    fits : sequence of AirFit
        Fitted models.
    """
    figure = Figure(figsize=(13, 4.4), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    for axes, fill in ((left, True), (middle, False)):
        chosen = [step for step in steps if step.fill == fill]
        if chosen:
            responses(axes, chosen, fits, grid(steps))
        axes.set_title("fill" if fill else "vent", fontsize=10)
    times(right, fits)
    figure.savefig(path, dpi=110)


def responses(axes: Any, steps: Sequence[Step], fits: Sequence[AirFit], t: Array) -> None:
    """Draw all measured readings, and the models over one step of each line and size.

    Parameters
    ----------
    axes : matplotlib axes
        Where to draw.
    steps : sequence of Step
        Measured steps of one direction.
    fits : sequence of AirFit
        Fitted models.
    t : ndarray (n,)
        Times of the models [s].
    """
    for k, step in enumerate(steps):
        axes.plot(step.t, step.pressure / 1e3, color="k", label="measured" if k == 0 else None, **DOT)
    typical = {(step.line, round(step.change_pa / 2e4)): step for step in steps}
    for fitted, style in zip(fits, STYLES, strict=False):
        for k, step in enumerate(typical.values()):
            pressure = fitted.response(step, t)
            name = f"{fitted.kind.name}, {'each line' if fitted.kind.each_line else 'all lines'}"
            axes.plot(t, pressure / 1e3, style, linewidth=1.3, label=name if k == 0 else None)
    axes.set_xlim(0.0, 0.7 * t[-1])
    axes.set_xlabel("time since the set point changed, s")
    axes.set_ylabel("pressure, kPa gauge")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)


def times(axes: Any, fits: Sequence[AirFit]) -> None:
    """Draw times to 63.2 % of held-out steps."""
    every = [time for one in fits for j in one.held_out for time in (j.step.t63_s, j.t63_s)]
    every = [time for time in every if np.isfinite(time)] or [1.0]
    ends = [0.8 * min(every), 1.25 * max(every)]
    axes.fill_between(
        ends, [(1 - GOOD) * e for e in ends], [(1 + GOOD) * e for e in ends], color="k", alpha=0.1, lw=0
    )
    for fitted, style in zip(fits, STYLES, strict=False):
        for fill, marker in ((True, "^"), (False, "v")):
            chosen = [one for one in fitted.held_out if one.step.fill == fill]
            way = "fill" if fill else "vent"
            name = f"{fitted.kind.name}, {'each line' if fitted.kind.each_line else 'all lines'}: {way}"
            axes.plot(
                [one.step.t63_s for one in chosen],
                [one.t63_s for one in chosen],
                marker,
                color=style[:2],
                markersize=4,
                alpha=0.6,
                label=name,
            )
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(ScalarFormatter())
    axes.set_xlim(*ends)
    axes.set_ylim(*ends)
    axes.set_title("time to 63.2 %, runs not seen (shaded: within 20 %)", fontsize=10)
    axes.set_xlabel("measured, s")
    axes.set_ylabel("model, s")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7, loc="lower right")
