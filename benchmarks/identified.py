"""The identified silicone segment against runs that its fit has not seen: how it rings, and where it ends."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from benchmarks.air_fit import DATA
from benchmarks.options import Options
from benchmarks.report import table
from soro_core.config import find_config, load
from soro_core.errors import ModelError
from soro_core.identification.arm.cases import Whole
from soro_core.identification.arm.frames import frame_numbers
from soro_core.identification.arm.judge import ranges
from soro_core.identification.arm.predict import difference
from soro_core.identification.arm.prepare import first_errors
from soro_core.identification.arm.problem import Problem, solve
from soro_core.identification.recording import Columns, Marker, Recording, read_csv
from soro_core.identification.ring import Ring, ring_of
from soro_core.model import SoftArm
from soro_core.robot import Robot, load_robot

Array: TypeAlias = NDArray[np.float64]

TITLE = "Identified silicone segment"
ROBOT = "srl_one_segment"
# Every second level is held out, of both sets.
FITTED = ("A_400", "A_200", "C_400", "C_100", "C_200", "C_300")
HELD_OUT = ("A_100", "A_300", "C_050", "C_150", "C_250", "C_350")
# A ring-down is judged from so long after the step on, for so long; ends are means over so long [s].
_AFTER_S, _FOR_S, _MEAN_S = 0.25, 0.6, 0.15
_DT_S = 0.0025
# Goals of the median errors of frequency, damping ratio and end displacement on unseen runs [%].
GOALS = (3.0, 9.0, 6.0)


@dataclass(frozen=True)
class Motion:
    """How the mean of the tip markers moves.

    Attributes
    ----------
    t : (n,)
        Times [s].
    position : (n, 3)
        [m].
    """

    t: Array
    position: Array

    def displacement(self, step_s: float, end_s: float) -> Array:
        """Return how far it moved (3,) [m] from before a step to before an end."""
        before = self.position[(self.t < step_s) & (self.t > step_s - _MEAN_S)]
        after = self.position[(self.t < end_s) & (self.t > end_s - _MEAN_S)]
        return np.asarray(after.mean(axis=0) - before.mean(axis=0))

    def ring(self, step_s: float, along: Array) -> Ring:
        """Return how it rings after a step, along a direction (3,); nan where it does not."""
        inside = (self.t > step_s + _AFTER_S) & (self.t < step_s + _AFTER_S + _FOR_S)
        try:
            return ring_of(self.t[inside], self.position[inside] @ along)
        except ModelError:
            return Ring(np.nan, np.nan)


def run(options: Options) -> str:
    """Compare ring-downs and end displacements."""
    folder = Path(os.environ.get("SORO_DATA", DATA)) / "srl_one_segment"
    if not folder.is_dir():
        return f"Not measured: no {folder} (SORO_DATA names another folder)."
    robot = load_robot(ROBOT)
    values = _frames(robot, [_read(folder, name, robot) for name in options.pick(FITTED, FITTED[1:4])])
    rows, errors = [], []
    for name in options.pick(HELD_OUT, HELD_OUT[1:4]):
        options.say(name)
        for row, error in _compared(name, _read(folder, name, robot), robot, values):
            rows.append(row)
            errors.append(error)
    medians = np.nanmedian(np.array(errors), axis=0)
    names = ("natural frequency", "damping ratio", "end displacement")
    silent = int(np.isnan(np.array(errors)[:, 0]).sum())
    figures = [
        f"{name}: {100 * median:.1f} % (goal {goal:g} %)"
        for name, median, goal in zip(names, medians, GOALS, strict=True)
    ]
    head = ["run", "step", "frequency, Hz", "model", "damping ratio", "model", "end, mm", "model"]
    return "\n\n".join(
        [
            f"`config/robots/{ROBOT}.yaml`, identified from {', '.join(FITTED)}, on the runs that were held "
            f"out (every second level of both sets, chosen before). Median errors: {'; '.join(figures)}; "
            f"{silent} of {len(rows)} steps without a damped sine (nan) left out.",
            "Frequency and damping ratio: a damped sine on a parabola, fitted to the mean of the tip markers "
            f"from {_AFTER_S:g} s after the step on, for {_FOR_S:g} s, with the same stamps for measurement "
            "and model (`soro_core/identification/ring.py`). End: displacement of that mean by the fill, over"
            f" the last {_MEAN_S:g} s; its error is that of the vector. Frames of the trackers are those of "
            "the runs of the fit.",
            table(head, rows),
        ]
    )


def _read(folder: Path, name: str, robot: Robot) -> Recording:
    path = folder / f"step_{name}mbar.csv"
    return read_csv(path, _map_of(path.stem), robot)


def _frames(robot: Robot, recordings: Sequence[Recording]) -> dict[str, float]:
    """Return where trackers and markers sit: the numbers of the measurement alone are searched."""
    cases = [Whole(r, _DT_S) for r in recordings]
    moved = ranges(cases)
    expected = {s.name: first_errors(s, moved[s.name]) for case in cases for s in case.shapes}
    numbers = frame_numbers(SoftArm(robot), cases)
    return solve(Problem(robot, tuple(cases), numbers, expected), most=200).values


def _compared(
    name: str, recording: Recording, robot: Robot, values: Mapping[str, float]
) -> Iterator[tuple[list[str], list[float]]]:
    """Give a row of the table, and the errors, of each step of a run."""
    arm, case = SoftArm(robot), Whole(recording, _DT_S, rate_hz=1e3)
    tips, models = [], []
    for shape, q in zip(case.shapes, case.coordinates(arm), strict=True):
        if isinstance(shape, Marker):
            tips.append(shape)
            models.append(replace(shape, position=shape.position - difference(shape, arm, q, values)))
    measured, model = _mean(tips), _mean(models)
    times = [time for time, _ in _levels(recording.name)[1:]]
    end_s = times[1] if len(times) > 1 else float(measured.t[-1])
    ends = [motion.displacement(times[0], end_s) for motion in (measured, model)]
    along = ends[0] / np.linalg.norm(ends[0])
    for time, what in zip(times, ("fill", "vent"), strict=False):
        rings = [motion.ring(time, along) for motion in (measured, model)]
        row, errors = [name, what], []
        for mine, its, form in zip(*rings, (".2f", ".3f"), strict=True):
            row += [format(mine, form), format(its, form)]
            errors.append(abs(its / mine - 1.0))
        if what == "fill":
            row += [f"{1e3 * np.linalg.norm(end):.2f}" for end in ends]
            errors.append(float(np.linalg.norm(ends[1] - ends[0]) / np.linalg.norm(ends[0])))
        else:
            row, errors = [*row, "", ""], [*errors, np.nan]
        yield row, errors


def _mean(markers: Sequence[Marker]) -> Motion:
    """Return the mean of markers at the stamps that all of them have."""
    t = markers[0].t
    for marker in markers:
        t = np.intersect1d(t, marker.t)
    return Motion(t, np.mean([marker.position[np.isin(marker.t, t)] for marker in markers], axis=0))


def _levels(name: str) -> Sequence[Sequence[float]]:
    columns = load(find_config(_map_of(name), "recordings"), Columns)
    return columns.pressures.levels(name)["link0/chamber0"]


def _map_of(name: str) -> str:
    return f"srl_step_{name.split('_')[1].lower()}"
