"""Arms at the tip of another arm: which may be, where they are, and their tables."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from soro_core.arrays import Array
from soro_core.bodies.stepping.records import MountTables
from soro_core.integrate.base_motion import Base, energy_on_base
from soro_core.model import SoftArm
from soro_core.robot import BaseState


def tip_frame(
    mounts: Mapping[str, str], arms: Mapping[str, SoftArm], name: str, q: Mapping[str, ArrayLike]
) -> Array:
    """Return what a robot file calls the world (4, 4), in the world: of a carried arm its carrier's tip.

    Parameters
    ----------
    mounts, arms : mapping of str to str, mapping of str to SoftArm
    name : str
        Of the arm.
    q : mapping of str to (n_q,)
        Coordinates of arms; the others are straight.
    """
    if name not in mounts:
        return np.eye(4)
    carrier = arms[mounts[name]]
    return carrier.pose(q.get(mounts[name], np.zeros(carrier.n_q)), carrier.length)


def carried_base(
    mounts: Mapping[str, str],
    arms: Mapping[str, SoftArm],
    name: str,
    q: Mapping[str, Array],
    qd: Mapping[str, Array],
) -> BaseState:
    """Return where the base of an arm is and how fast it moves, its accelerations left 0.

    Parameters
    ----------
    mounts, arms, name : mapping, mapping, str
        As of `tip_frame`.
    q, qd : mapping of str to (n_q,)
        Coordinates and velocities of the arms.
    """
    if name not in mounts:
        return BaseState()
    carrier, own = mounts[name], np.array(arms[name].tables.base_position)
    pose, jacobian = arms[carrier].pose_and_jacobian(q[carrier], arms[carrier].length)
    spin, speed = (pose[:3, :3] @ part for part in np.split(jacobian @ qd[carrier], 2))
    away = pose[:3, :3] @ own
    return BaseState(
        displacement=pose[:3, 3] + away - own,
        velocity=speed + np.cross(spin, away),
        rotation=pose[:3, :3],
        angular_velocity=spin,
    )


def under_gravity(mounts: Mapping[str, str], arms: Mapping[str, SoftArm]) -> tuple[SoftArm, ...]:
    """Return the arms, carried ones with the gravity of their carrier: their files see it from its tip."""
    return tuple(
        SoftArm(arm.robot.replace(gravity=arms[mounts[name]].robot.gravity), nodes=arm.nodes)
        if name in mounts
        else arm
        for name, arm in arms.items()
    )


def _standing(base: BaseState) -> Base:
    return lambda _: base


def arm_energy(
    mounts: Mapping[str, str],
    arms: Mapping[str, SoftArm],
    name: str,
    q: Mapping[str, Array],
    qd: Mapping[str, Array],
) -> Array:
    """Return kinetic, gravitational and elastic energy of an arm with its carrier's motion, (n_t,) [J].

    Parameters
    ----------
    mounts, arms, name : mapping, mapping, str
        As of `tip_frame`.
    q, qd : mapping of str to (n_t, n_q)
        Coordinates and velocities of the arms.
    """
    arm = dict(zip(arms, under_gravity(mounts, arms), strict=True))[name]
    parts = np.array([arm.energy(one, rate) for one, rate in zip(q[name], qd[name], strict=True)])
    for k in range(len(parts) if name in mounts else 0):
        states = [{one: rows[k] for one, rows in given.items()} for given in (q, qd)]
        base = carried_base(mounts, arms, name, *states)
        parts[k, :2] = energy_on_base(_standing(base), arm, 0.0, q[name][k], qd[name][k])
    return np.asarray(parts.sum(axis=1))


def movers_of(
    mounts: Mapping[str, str], arms: Mapping[str, SoftArm]
) -> tuple[list[int], list[int], list[int]]:
    """Return of each arm the row of `Movers` that has it, and its first column; of each row the first arm."""
    rows: list[int] = []
    columns: list[int] = []
    first: list[int] = []
    used: list[int] = []
    for i, (name, arm) in enumerate(arms.items()):
        row = rows[list(arms).index(mounts[name])] if name in mounts else len(first)
        if row == len(first):
            first.append(i)
            used.append(0)
        rows.append(row)
        columns.append(used[row])
        used[row] += arm.n_q
    return rows, columns, first


def mount_tables(mounts: Mapping[str, str], arms: Mapping[str, SoftArm], width: int) -> MountTables:
    """Return the tables of carried arms and their carriers."""
    names, n = list(arms), len(arms)
    carriers = [names.index(mounts[name]) if name in mounts else -1 for name in names]
    return MountTables(
        carrier=np.array(carriers, dtype=np.int64),
        is_carrier=np.array([i in carriers for i in range(n)], dtype=np.bool_),
        offset_rotation=np.array([arm.tables.base_rotation for arm in arms.values()]).reshape(-1, 3, 3),
        offset_place=np.array([arm.tables.base_position for arm in arms.values()]).reshape(-1, 3),
        carried_rotation=np.zeros((n, 3, 3)),
        carried_place=np.zeros((n, 3)),
        tip_rotation=np.zeros((n, 3, 3)),
        tip_place=np.zeros((n, 3)),
        tip_motion=np.zeros((n, 2, 6)),
        wrench=np.zeros((n, 6)),
        columns=np.zeros((n, width, 6)),
        answers=np.zeros((n, width, 6)),
        load=np.zeros((n, 6, 6)),
        scratch=np.zeros((3, 6)),
        block=np.zeros((2, 6, 6)),
        pivots=np.zeros(6, dtype=np.int64),
        no_gravity=np.zeros(3),
        no_wrench=np.zeros((n, 6)),
    )
