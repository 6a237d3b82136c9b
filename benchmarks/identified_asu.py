"""The shipped file of the ASU arm, judged on recordings: pressures replayed, tip and lengths compared."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

import numpy as np

from benchmarks.air_fit import DATA
from benchmarks.asu_wires import wires
from benchmarks.options import Options
from benchmarks.report import table
from soro_core import SoftArm, load_robot
from soro_core.arrays import Array
from soro_lab.identification.arm.cases.case import Whole
from soro_lab.identification.recording import Plate, Recording, read_csv
from soro_ros.ageing.model_error import CHANGE, ModelMismatch, mismatch_of
from soro_ros.ageing.trend import AGAIN, NEW, STIFFNESS, trend

TITLE = "Identified robot file: asu_two_segment"
ROBOT = "asu_two_segment"
STEP_S, RATE_HZ = 0.04, 4.0
RANGE_M = 0.321
_GOAL = "6.5 %, 8 mm, 4 mm"


def run(options: Options) -> str:
    """Judge the file on each run; a table."""
    folder = Path(os.environ.get("SORO_DATA", DATA)) / ROBOT
    if not folder.is_dir():
        return f"Not measured: no data set in {folder.parent} (SORO_DATA names another folder)."
    robot = load_robot(ROBOT)
    arm = SoftArm(robot)
    files = sorted(folder.glob(options.pick("*", "2023_jan4*") + ".csv"))
    used = [r for r in (read_csv(file, ROBOT, robot) for file in files) if is_driven(r)]
    errors = {}
    for recording in used:
        options.say(recording.name)
        errors[recording.name] = squares(arm, recording)
    frozen = {r.name for r in used if is_frozen(r)}
    held = [name for name in errors if is_held_out(name)]
    groups = {
        "fitted": [name for name in errors if name not in held and name not in frozen],
        "held out, no sensor frozen": [name for name in held if name not in frozen],
        "held out": held,
        "all, no sensor frozen": [name for name in errors if name not in frozen],
        "all": list(errors),
    }
    rows = [
        [name, len(runs), *cells(rms([errors[n] for n in runs]))] for name, runs in groups.items() if runs
    ]
    for name, own in errors.items():
        kind = "held out" if name in held else "not fitted" if name in frozen else "fitted"
        kind += ", frozen" if name in frozen else ""
        rows.append([name, kind, *cells(rms([own]))])
    header = ("runs", "number", f"tip, % of {1e3 * RANGE_M:.0f} mm", "length 0, mm", "length 1, mm")
    text = (
        "RMS over runs of the RMS over samples; each run begins at the balance of its first pressures. Left "
        "out: runs without a change of set points. Held out: those with an even number. Fitted: the others "
        "without a frozen sensor. Frozen: one reading over more than a second, while what drives the sensor "
        f"moves or its noise has stopped. Goal: {_GOAL}."
    )
    return f"{text}\n\n{table(header, rows)}\n\n{_ageing(used)}\n\n{wires(files)}"


def _ageing(recordings: Sequence[Recording]) -> str:
    """Return what `soro log` would say of the age of this arm, day by day."""
    robot = load_robot(ROBOT)
    arm, softer = SoftArm(robot), SoftArm(robot.scaled(stiffness=1.0 - CHANGE))
    found: list[tuple[datetime, ModelMismatch]] = []
    for recording in recordings:
        if not is_frozen(recording):
            away = differences(arm, recording)[0]
            by_stiffness = (away - differences(softer, recording)[0]) / CHANGE
            found.append((_day(recording.name), mismatch_of(-away, by_stiffness)))
    found.sort(key=lambda one: one[0])
    new_m = float(np.median([one.rms_m for _, one in found[:NEW]]))
    over = trend(STIFFNESS, [((day - found[0][0]).days, one.stiffness, one.deviation) for day, one in found])
    rows = []
    for day in sorted({day for day, _ in found}):
        own = [one for of, one in found if of == day]
        error_m = float(np.median([one.rms_m for one in own]))
        again = "yes" if error_m > AGAIN * new_m else "no"
        stiffness = f"{np.mean([one.stiffness for one in own]):.2f}"
        rows.append([f"{day:%Y-%m-%d}", len(own), f"{1e3 * error_m:.1f}", again, stiffness])
    return (
        "Ageing, by what `soro log` computes of the runs of an arm (docs/adr/0079); without those where a "
        f"sensor froze. {STIFFNESS}: {100 * over.per_day:+.2f} ± {100 * over.deviation:.2f} % a day. "
        f"Identify again: where the median is above {AGAIN:g} times that of the first {NEW} runs.\n\n"
        + table(("day", "runs", "error of the model, mm", "identify again", STIFFNESS), rows)
    )


def _day(name: str) -> datetime:
    """Return the day of a session, by the name of its file: 2023_jan4_r1, 2023_jan_10_1_r1."""
    year, month, day = re.fullmatch(r"(\d+)_([a-z]+)_?(\d+).*", name).groups()
    return datetime.strptime(f"{year} {month} {day}", "%Y %b %d")


def is_held_out(name: str) -> bool:
    """Whether a run is kept back from the fit: those with an even number."""
    return int(name.rsplit("_r", 1)[1]) % 2 == 0


def is_driven(recording: Recording) -> bool:
    """Whether the set points of a run change."""
    return recording.command is not None and bool(np.ptp(recording.command.values, axis=0).any())


def is_frozen(recording: Recording) -> bool:
    """Whether a sensor of a run froze."""
    return any(faults.frozen for faults in recording.faults)


def squares(arm: SoftArm, recording: Recording) -> Array:
    """Return the mean squares (3,) [m^2] of the errors of the tip and of the distances of the plates."""
    tip, _, upper, lower = differences(arm, recording)
    return np.array([np.mean(np.sum(tip**2, axis=1)), np.mean(upper**2), np.mean(lower**2)])


def differences(arm: SoftArm, recording: Recording) -> tuple[Array, Array, Array, Array]:
    """Return the errors [m] of tip and middle (n, 3), and of the distances of the plates (n,)."""
    case = Whole(recording, STEP_S, rate_hz=RATE_HZ)
    path = case.simulated(arm, {})
    plates = [shape for shape in case.shapes if isinstance(shape, Plate)]
    middle, tip = (next(p for p in plates if p.place.link == link) for link in (0, 1))
    where = [arm.poses(path.at(tip.t), plate.place.along(arm.robot))[:, :3, 3] for plate in (middle, tip)]
    seen = np.column_stack([np.interp(tip.t, middle.t, column) for column in middle.position.T])
    upper = np.linalg.norm(where[0], axis=1) - np.linalg.norm(seen, axis=1)
    lower = np.linalg.norm(where[1] - where[0], axis=1) - np.linalg.norm(tip.position - seen, axis=1)
    return where[1] - tip.position, where[0] - seen, upper, lower


def rms(parts: Sequence[Array]) -> Array:
    """Return the roots (3,) [m] of the means of `squares` over runs."""
    return np.asarray(np.sqrt(np.mean(parts, axis=0)))


def cells(errors: Array) -> list[str]:
    """Return the tip in parts of its range, and lengths [mm], as they are shown."""
    return [f"{100 * errors[0] / RANGE_M:.2f} %", f"{1e3 * errors[1]:.1f}", f"{1e3 * errors[2]:.1f}"]
