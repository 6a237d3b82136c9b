"""The shipped file of the ASU arm, judged on recordings: pressures replayed, tip and lengths compared."""

from __future__ import annotations

import os
from collections.abc import Sequence
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
    return f"{text}\n\n{table(header, rows)}\n\n{wires(files)}"


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
