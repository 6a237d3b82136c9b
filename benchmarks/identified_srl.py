"""The identified silicone segment against runs that its fit has not seen: how it rings, and where it ends."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.air_fit import DATA
from benchmarks.options import Options
from benchmarks.report import met, table
from benchmarks.ring import Ring
from benchmarks.tip_steps import (
    RING_S,
    Plane,
    TipRun,
    end_of,
    is_held_out,
    place_of,
    plane_of,
    read_tip_run,
    rings,
    shown,
    swung,
)
from soro_core.arrays import Array
from soro_core.model import SoftArm
from soro_core.robot import Robot, load_robot

TITLE = "Identified silicone segment"
ROBOT = "srl_one_segment"
MAPS = {"step_A": "srl_step_a", "step_C": "srl_step_c"}
# The arm hangs along +x of the trackers.
DOWN = np.array([1.0, 0.0, 0.0])
# Goals of the median errors on unseen runs.
GOALS = {"natural frequency": 0.03, "damping ratio": 0.09, "end displacement": 0.06}


@dataclass(frozen=True)
class Step:
    """One step of one run.

    Attributes
    ----------
    run, what : str
        Name of the run; fill or vent.
    is_held_out : bool
    rings : (measured, model)
    ends : (2, 2)
        End displacement of the fill, measured and of the model [m]; nan of a vent.
    """

    run: str
    what: str
    is_held_out: bool
    rings: tuple[Ring, Ring]
    ends: Array

    @property
    def errors(self) -> Array:
        """Relative errors (3,) in the order of `GOALS`."""
        mine, its = (np.array(ring) for ring in self.rings)
        end = np.linalg.norm(self.ends[1] - self.ends[0]) / np.linalg.norm(self.ends[0])
        return np.array([*np.abs(its / mine - 1.0), end])


def judged(robot: Robot, folder: Path) -> list[Step]:
    """Return all steps of all runs; frames and markers are those of the runs of the fit.

    Parameters
    ----------
    robot : Robot
    folder : Path
        With step_A_*.csv and step_C_*.csv.
    """
    arm, found = SoftArm(robot), []
    for start, columns in MAPS.items():
        runs = [read_tip_run(file, columns, robot) for file in sorted(folder.glob(f"{start}_*.csv"))]
        top = {run.name: max(p for _, p in run.levels.steps) for run in runs}
        kept = {run.name: is_held_out(top, run.name) for run in runs}
        plane = plane_of([run for run in runs if not kept[run.name]], DOWN)
        used = [run for run in runs if not kept[run.name]]
        paths = [swung(arm, run.levels, float(run.t[-1])) for run in used]
        place = place_of(arm, used, paths, plane)
        for run in runs:
            found += _steps(arm, run, plane, place, kept[run.name])
    return found


def medians(steps: Sequence[Step]) -> Array:
    """Return the median errors (3,) of steps; those without a damped sine count for the ends alone."""
    return np.asarray(np.nanmedian([step.errors for step in steps], axis=0))


def run(options: Options) -> str:
    """Compare ring-downs and end displacements."""
    folder = Path(os.environ.get("SORO_DATA", DATA)) / ROBOT
    if not folder.is_dir():
        return f"Not measured: no {folder} (SORO_DATA names another folder)."
    options.say(ROBOT)
    steps = judged(load_robot(ROBOT), folder)
    out, used = ([s for s in steps if s.is_held_out is kept] for kept in (True, False))
    parts = zip(GOALS.items(), medians(out), medians(used), strict=True)
    rows = [
        [name, f"{100 * goal:.0f} %", f"{100 * theirs:.1f} %", met(theirs <= goal), f"{100 * own:.1f} %"]
        for (name, goal), theirs, own in parts
    ]
    names = ", ".join(dict.fromkeys(step.run for step in out))
    return "\n\n".join(
        [
            f"`config/robots/{ROBOT}.yaml` by `benchmarks/fit_srl.py`. Held out, by a rule on the "
            f"names (every second level of each tracker, but not the highest): {names}. Medians over steps:",
            table(["", "goal", "held out", "", "fitted"], rows),
            "Ring-down: a damped sine on a line and two decays (`benchmarks/ring.py`), fitted "
            f"to the mean of the tip markers from {RING_S[0]:g} to {RING_S[1]:g} s after a step, with the "
            "same stamps for measurement and model. End: displacement by the fill before the vent, or at the "
            "last sample; its error is that of the vector. Two numbers of each tracker, where the markers "
            "sit in the plane of bending, are fitted to the ends of the fitted runs.",
            table(
                [
                    "run",
                    "step",
                    "use",
                    "frequency, Hz",
                    "model",
                    "damping ratio",
                    "model",
                    "end, mm",
                    "model",
                ],
                [_row(step) for step in steps],
            ),
        ]
    )


def _steps(arm: SoftArm, run: TipRun, plane: Plane, place: Array, is_kept: bool) -> list[Step]:
    seen = plane.seen(run)
    model = shown(arm, swung(arm, run.levels, float(run.t[-1])), run.t, place)
    pairs = zip(*(rings(run.t, moved[:, 0], run.levels) for moved in (seen, model)), strict=True)
    ends = np.array([end_of(run.t, moved, run.levels) for moved in (seen, model)])
    return [
        Step(run.name, what, is_kept, pair, ends if what == "fill" else np.full((2, 2), np.nan))
        for what, pair in zip(("fill", "vent"), pairs, strict=False)
    ]


def _row(step: Step) -> list[str]:
    mine, its = step.rings
    ends = [f"{1e3 * size:.2f}" if np.isfinite(size) else "" for size in np.linalg.norm(step.ends, axis=1)]
    return [
        *(step.run.removeprefix("step_"), step.what, "held out" if step.is_held_out else "fit"),
        *(f"{mine.frequency_hz:.2f}", f"{its.frequency_hz:.2f}"),
        *(f"{mine.damping_ratio:.3f}", f"{its.damping_ratio:.3f}", *ends),
    ]
