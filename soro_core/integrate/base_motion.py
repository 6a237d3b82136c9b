"""A base that moves as given: pose, velocity and acceleration over a run, docs/model_terms.md.

A run carries them as `WIDTH` more inputs behind pressures and tensions, so that every stage of every stepper
sees them at its own time, as it sees the pressures. The forces of inertia then come from the pass along the
links, which starts with the twist of the base and its rate.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from soro_core._by_type import select_by_type
from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.errors import ModelError, short
from soro_core.model import SoftArm, entries
from soro_core.model.checks import finite, flat_wrench, shaped
from soro_core.model.tables import BaseMotion, FixedBase, Tables
from soro_core.robot import BaseState

# Rotation (9) and position of the base in the world, its twist and the rate of the twist, seen from itself.
WIDTH = 24
Base: TypeAlias = Callable[[float], BaseState]


def base_rows(base: Base, arm: SoftArm, times: Array) -> Array:
    """Return the inputs (..., WIDTH) of a base at times (...).

    Parameters
    ----------
    base : callable
        State of the base at a time [s].
    arm : SoftArm
    times : ndarray (...)
        [s].

    Raises
    ------
    ModelError
        If the function gives no states, or one that is not finite or has no rotation.
    """
    rows = np.array([_row(base(float(t)), arm, float(t)) for t in times.ravel()])
    return rows.reshape(*times.shape, WIDTH)


def _row(state: object, arm: SoftArm, t: float) -> Array:
    if not isinstance(state, BaseState):
        raise ModelError(f"base({t:g}): got {short(state)}; allowed: a BaseState", "base")
    values = []
    for name, value in zip(state._fields, state, strict=True):
        key = f"base({t:g}).{name}"
        values.append(shaped(value, (3, 3) if name == "rotation" else (3,), key, arm.robot.name))
        finite(values[-1].ravel(), key)
    where, v, a, Q, w, dw = values
    if not np.abs(Q.T @ Q - np.eye(3)).max() < 1e-9 or not np.linalg.det(Q) > 0.0:
        raise ModelError(f"base({t:g}).rotation: got {short(Q.tolist())}; allowed: a rotation", "base")
    R = Q @ arm.tables.base_rotation
    spin, speed = R.T @ w, R.T @ v
    rate = R.T @ a - np.cross(spin, speed)
    return np.concatenate([R.ravel(), arm.tables.base_position + where, spin, speed, R.T @ dw, rate])


def moved(arm: SoftArm, rows: Array, poses: Array) -> Array:
    """Return poses (n, 4, 4) in the world of sections of an arm on a moved base.

    Parameters
    ----------
    arm : SoftArm
    rows : ndarray (n, WIDTH)
        Of the base, from `base_rows`.
    poses : ndarray (n, 4, 4)
        Of the sections on the base of the robot file.
    """
    local = np.linalg.inv(_poses(arm.tables.base_rotation[None], arm.tables.base_position[None]))
    there: Array = _poses(rows[:, :9].reshape(-1, 3, 3), rows[:, 9:12]) @ local @ poses
    return there


def _poses(R: Array, p: Array) -> Array:
    poses = np.tile(np.eye(4), (len(p), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = R, p
    return poses


def with_base(t: Tables) -> Tables:
    """Return tables of their own for a run, whose base moves: with inputs for it, which drive no chamber."""

    def wider(values: Array) -> Array:
        return np.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, WIDTH)])

    by_input = ("chamber_samples", "actuation", "area_rate", "area_saturation", "braid", "axial_gain")
    wide: dict[str, Any] = {name: wider(getattr(t, name)) for name in (*by_input, "dead_band", "swell")}
    return t._replace(
        base_rotation=t.base_rotation.copy(),
        base_position=t.base_position.copy(),
        base=BaseMotion(np.zeros(6), np.zeros(6)),
        **wide,
    )


def forces_on_base(base: Base, arm: SoftArm, t: float, q: Array, qd: Array) -> Array:
    """Return the forces (n_places, 3) of `SoftArm.external_forces` on an arm whose base moves.

    Parameters
    ----------
    base, arm : callable, SoftArm
        As of `base_rows`.
    t : float
        Time [s].
    q, qd : ndarray (n_q,)
        Coordinates and velocities.
    """
    row, tables = base_rows(base, arm, np.array([t]))[0], with_base(arm.tables)
    tables.base_rotation[:], tables.base_position[:] = row[:9].reshape(3, 3), row[9:12]
    tables.base.twist[:] = row[12:18]
    force = np.empty((len(tables.external.kind), 3))
    none = flat_wrench(arm.robot, None)
    entries.external_forces(entries.make_box(tables), q, qd, none, np.empty(arm.n_q), force)
    return force


def energy_on_base(base: Base, arm: SoftArm, t: float, q: Array, qd: Array) -> tuple[float, float]:
    """Return kinetic and gravitational energy [J] of an arm whose base moves, as of `SoftArm.energy`.

    Parameters
    ----------
    base, arm, t, q, qd : callable, SoftArm, float, ndarray, ndarray
        As of `forces_on_base`.
    """
    row, tables = base_rows(base, arm, np.array([t]))[0], with_base(arm.tables)
    tables.base_rotation[:], tables.base_position[:] = row[:9].reshape(3, 3), row[9:12]
    tables.base.twist[:] = row[12:18]
    return entries.mechanical_energy(entries.make_box(tables), q, qd)


@inner
def _stay(e: BaseMotion, t: Tables, inputs: Array) -> None:
    return


@inner
def _move(e: BaseMotion, t: Tables, inputs: Array) -> None:
    n = inputs.shape[0] - WIDTH
    for r in range(3):
        for c in range(3):
            t.base_rotation[r, c] = inputs[n + 3 * r + c]
        t.base_position[r] = inputs[n + 9 + r]
    for r in range(6):
        e.twist[r] = inputs[n + 12 + r]
        e.rate[r] = inputs[n + 18 + r]


move_base = select_by_type(FixedBase, _stay, _move)
"""move_base(t.base, t, inputs): the base of `t` <- the last inputs of a stage."""
