"""A tip with markers that swings in a plane after steps of one pressure: measured, modelled, how it rings.

Frames are two numbers: where the mean of the markers sits on the cross-section of the tip, in the plane.
Motions are those from rest, so where tracker and base stand does not matter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path as File
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from benchmarks.ring import Ring, ring_of
from soro_core.arrays import Array
from soro_core.config import find_config, load
from soro_core.errors import ModelError
from soro_core.integrate import simulate
from soro_core.model import SoftArm
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.robot import Robot
from soro_lab.identification.arm.cases.case import ArmMotion
from soro_lab.identification.recording import Columns, read_csv
from soro_lab.identification.recording.sources.from_csv import stated_pressure

# A ring-down is seen from so long after the step on until so long after it [s].
RING_S = (0.15, 1.0)
# Of a sound ring-down, a window that begins later [s] shows the same damping ratio within this factor.
_LATER_S, _SAME = 0.25, 1.2
# An end is a mean over so long, and ends so long before a step [s]: stamps may be late.
_MEAN_S, _BEFORE_S = 0.15, 0.03
# Relative error of an end beyond which it counts linearly.
_END = 0.03
# Steps of the simulations [s], with which the frequency of 8 Hz is right to 0.2 %.
_DT_S, _STEPPER = 0.0025, "tr_bdf2_linear"


@dataclass(frozen=True)
class Levels:
    """Commanded pressure of the one chamber of a run.

    Attributes
    ----------
    steps : tuple of (time, pressure)
        [s], [Pa]; the first holds from the begin on.
    lag_s : (rise, fall)
        Lags [s] with which levels are reached.
    """

    steps: tuple[tuple[float, float], ...]
    lag_s: tuple[float, float]


@dataclass(frozen=True)
class TipRun:
    """One run.

    Attributes
    ----------
    name, frame : str
        Of the run, and of its tracker.
    t : (n,)
        Times [s].
    moved : (n, 3)
        Mean of the tip markers from its rest, in the frame of the tracker [m].
    levels : Levels
    """

    name: str
    frame: str
    t: Array
    moved: Array
    levels: Levels


@dataclass(frozen=True)
class Plane:
    """Frame of the runs of one tracker.

    Attributes
    ----------
    across, down : (3,)
        Direction in which the arm bends, and that in which it hangs.
    """

    across: Array
    down: Array

    def seen(self, run: TipRun) -> Array:
        """Return the motion (n, 2) [m] across and down."""
        return np.column_stack([run.moved @ self.across, run.moved @ self.down])


def read_tip_run(file: File, columns: str, robot: Robot) -> TipRun:
    """Read a CSV file: samples at which all its markers were seen.

    Parameters
    ----------
    file : ArmMotion
    columns : str
        Column map with stated levels.
    robot : Robot
        Of one chamber.
    """
    keys = load(find_config(columns, "recordings"), Columns).pressures
    recording = read_csv(file, columns, robot)
    stated = keys.levels(file.stem)[robot.chamber_names[0]]
    rise, fall = keys.stated_lag_s
    levels = Levels(tuple((float(t), float(p) * keys.factor) for t, p in stated), (rise, fall))
    times = [np.round(marker.t, 6) for marker in recording.markers]
    t = times[0]
    for other in times[1:]:
        t = np.intersect1d(t, other)
    parts = [m.position[np.isin(own, t)] for m, own in zip(recording.markers, times, strict=True)]
    moved = np.mean(parts, axis=0)
    still = t < levels.steps[1][0] - _BEFORE_S
    return TipRun(recording.name, recording.frame, t, moved - moved[still].mean(axis=0), levels)


def plane_of(runs: Sequence[TipRun], down: Array) -> Plane:
    """Return the plane in which runs of one tracker bend: of their largest motion square to `down` (3,)."""
    flat = np.concatenate([run.moved for run in runs])
    flat = flat - np.outer(flat @ down, down)
    across = flat.T @ np.linalg.norm(flat, axis=1)
    return Plane(across / np.linalg.norm(across), down)


def swung(arm: SoftArm, levels: Levels, t_end: float) -> ArmMotion:
    """Simulate an arm from its rest under stepped pressure.

    Parameters
    ----------
    arm : SoftArm
        Of one chamber.
    levels : Levels
    t_end : float
        [s].

    Raises
    ------
    ModelError
        If the simulation fails.
    """
    t: Array = _DT_S * np.arange(int(np.ceil(t_end / _DT_S)) + 2, dtype=float)
    at = [stated_pressure(levels.steps, levels.lag_s, t + part * _DT_S) for part in (0.0, 0.5, 1.0)]
    start = equilibrium(arm, np.array([levels.steps[0][1]]))
    table = np.stack(at, axis=1)[:, :, None]
    result = simulate(arm, start, t_end=float(t[-1]), dt=_DT_S, integrator=_STEPPER, pressure=table)
    q, qd = np.asarray(result.q, float), np.asarray(result.qd, float)
    if len(q) != len(t) or not np.isfinite(q).all():
        raise ModelError(f"the simulation failed: {result.status.message}", "pressure")
    return ArmMotion(t, q, qd)


def shown(arm: SoftArm, path: ArmMotion, t: Array, place: Sequence[float]) -> Array:
    """Return the motion (n, 2) [m] across and down of a point on the cross-section of the tip.

    Parameters
    ----------
    arm : SoftArm
        Hanging along -z; it bends in the plane of x and z.
    path : ArmMotion
    t : (n,)
        Times [s].
    place : (2,)
        Along x of the cross-section, and along the arm [m].
    """
    body = np.array([place[0], 0.0, place[1]])
    poses = arm.poses(np.vstack([path.q[:1], path.at(t)]), arm.robot.length)
    point = poses[:, :3, 3] + poses[:, :3, :3] @ body
    moved = point[1:] - point[0]
    return np.column_stack([moved[:, 0], -moved[:, 2]])


def place_of(arm: SoftArm, runs: Sequence[TipRun], paths: Sequence[ArmMotion], plane: Plane) -> Array:
    """Return where the markers sit on the cross-section (2,) [m], by the ends of runs of one tracker.

    Parameters
    ----------
    arm : SoftArm
    runs : sequence of TipRun
    paths : sequence of ArmMotion
        Simulated motion of each run.
    plane : Plane
    """
    rows, seen = [], []
    for run, path in zip(runs, paths, strict=True):
        end = end_of(run.t, plane.seen(run), run.levels)
        origin, *units = (
            end_of(run.t, shown(arm, path, run.t, place), run.levels) / np.linalg.norm(end)
            for place in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
        )
        rows.append(np.column_stack([unit - origin for unit in units]))
        seen.append(end / np.linalg.norm(end) - origin)
    matrix, measured = np.concatenate(rows), np.concatenate(seen)
    found: Any = least_squares(
        lambda x: matrix @ x - measured, np.zeros(2), x_scale=0.01, loss="soft_l1", f_scale=_END
    )
    return np.asarray(found.x)


def rings(t: Array, across: Array, levels: Levels, late_s: float = 0.0) -> list[Ring]:
    """Return how a motion rings after each step; nan where it does not.

    Parameters
    ----------
    t, across : (n,)
        Times [s], and the motion.
    levels : Levels
    late_s : float
        So much later the window begins [s].
    """
    found = []
    for time, _ in levels.steps[1:]:
        inside = (t > time + RING_S[0] + late_s) & (t < time + RING_S[1])
        try:
            found.append(ring_of(t[inside], across[inside]))
        except ModelError:
            found.append(Ring(np.nan, np.nan))
    return found


def are_sound(t: Array, across: Array, levels: Levels) -> list[bool]:
    """Whether each measured ring-down shows the same ratio in a window that begins later.

    Parameters
    ----------
    t, across : (n,)
        Times [s], and the motion.
    levels : Levels
    """
    whole, later = (rings(t, across, levels, late) for late in (0.0, _LATER_S - RING_S[0]))
    return [
        bool(1.0 / _SAME < b.damping_ratio / a.damping_ratio < _SAME)
        for a, b in zip(whole, later, strict=True)
    ]


def end_of(t: Array, moved: Array, levels: Levels) -> Array:
    """Return how far it moved (2,) [m] by the end of the fill: before the vent, or at the last sample.

    Parameters
    ----------
    t : (n,)
        Times [s].
    moved : (n, 2)
    levels : Levels
    """
    end = levels.steps[2][0] - _BEFORE_S if len(levels.steps) > 2 else np.inf
    last = t[t < end][-1]
    return np.asarray(moved[(t <= last) & (t > last - _MEAN_S)].mean(axis=0))


def is_held_out(levels: Mapping[str, float], name: str) -> bool:
    """Whether a run is kept back: every second level of those of its tracker, but not the highest.

    Parameters
    ----------
    levels : mapping of str to float
        Highest pressure of each run of the tracker, by its name.
    name : str
        One of them.
    """
    order = sorted(levels, key=lambda run: levels[run])
    return order.index(name) % 2 == 1 and name != order[-1]
