"""Picture of measured step responses and models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from soro_lab.identification.air_picture import DOT, responses, times
from soro_lab.identification.pump import PumpModel, PumpRun, pump_response
from soro_lab.identification.regulator_fit import AirFit
from soro_lab.identification.steps import FoundSteps
from soro_lab.identification.valves import grid

# Lines of the picture: the one that answers at once, and one that waits before it vents.
PROMPT, LATE = "s2r", "s1r"


@dataclass(frozen=True)
class Pumped:
    """A run of the pump and what two fits make of it: one to the other runs, and one to this run alone."""

    run: PumpRun
    others: PumpModel
    own: PumpModel


def air_fit(path: Path, found: FoundSteps, fits: Sequence[AirFit], pumped: Sequence[Pumped]) -> None:
    """Fills and vents of the regulators above, runs of the pump below."""
    figure = Figure(figsize=(15, 9), layout="constrained")
    (fill, prompt, late), (pressure, duty, scatter) = figure.subplots(2, 3)
    shown = fits[:1] + fits[-2:] if len(fits) > 2 else fits
    for axes, line, rises in ((fill, PROMPT, True), (prompt, PROMPT, False), (late, LATE, False)):
        steps = [s for s in found.steps if s.line == line and s.fill == rises]
        responses(axes, steps, shown, grid(found.steps))
        axes.set_title(f"asu_two_segment: {'fill' if rises else 'vent'}, line {line}", fontsize=10)
    _pump(pressure, pumped)
    _duty(duty, pumped)
    times(scatter, shown)
    scatter.set_title("asu_two_segment: t63 of runs not seen (shaded: within 20 %)", fontsize=10)
    figure.savefig(path, dpi=100)


def _pump(axes: Any, pumped: Sequence[Pumped]) -> None:
    for k, one in enumerate(pumped):
        colour = f"C{k}"
        axes.plot(one.run.t, one.run.pressure / 1e3, color=colour, label=one.run.run, **DOT)
        for model, style in ((one.others, ":"), (one.own, "-")):
            t, pressure, _ = pump_response(model, one.run)
            axes.plot(t, pressure / 1e3, style, color=colour, linewidth=1.2)
    axes.plot([], [], "k-", linewidth=1.2, label="flow, fit to the run itself")
    axes.plot([], [], "k:", linewidth=1.2, label="flow, fit to the other runs")
    axes.axhline(35.0, color="k", linewidth=0.6)
    axes.text(0.05, 35.3, "set point", fontsize=8)
    axes.set_title("softbot_pressure_loop: pump under PI control", fontsize=10)
    axes.set_xlabel("time, s")
    axes.set_ylabel("pressure, kPa gauge")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="lower right", markerscale=3)


def _duty(axes: Any, pumped: Sequence[Pumped]) -> None:
    """The first run, which hovers where the controller leaves full power, and the last, which arrives."""
    for one, above in ((pumped[0], 0.0), (pumped[-1], 1.3)):
        t, _, duty = pump_response(one.own, one.run)
        axes.plot(one.run.t, one.run.duty + above, color="k", label=None, **DOT)
        axes.step(t, duty + above, "C3", where="post", linewidth=0.8)
        axes.text(0.15, above + 0.5, one.run.run.removeprefix("sweep_"), fontsize=9)
    axes.plot([], [], color="k", label="measured", **DOT)
    axes.plot([], [], "C3", label="model, fit to the run itself")
    axes.set_yticks([0.0, 1.0, 1.3, 2.3], ["0", "1", "0", "1"])
    axes.set_ylim(-0.1, 2.9)
    axes.set_title("softbot_pressure_loop: duty cycle, which saturates", fontsize=10)
    axes.set_xlabel("time, s")
    axes.set_ylabel("duty cycle of the pump")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="upper right", markerscale=3, ncols=2)
