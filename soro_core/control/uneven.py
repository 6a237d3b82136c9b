"""The uneven bend of links under load, which strains that are constant along them do not have.

Weight and inertia bend a link most near its base. With strains that vary linearly along each link,
coordinates x with the accelerations dx/dq qdd, the arm keeps

    f(x) + m Y(x) = H(x) p,   the ends of the links where q has them

in x and p, and these pressures make the force H_1(q) p in the coordinates q, not G + f_e + m Y_m. The
difference is what a law with constant strains lacks, docs/control.md. One step of Newton a tick follows it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.adaptation.scales import q_scale_of
from soro_core.adaptation.uneven import UnevenForce
from soro_core.control.trajectory import Point
from soro_core.model import SoftArm
from soro_core.model.motion import MotionForces
from soro_core.robot import Robot
from soro_core.robot.discretisation import with_basis
from soro_core.robot.parts import fields

Array: TypeAlias = NDArray[np.float64]

# Coefficients of each strain: its mean along the link, and the slope.
_TERMS = 2
# Increment for difference quotients of the forces, in units of q.
_STEP = 1e-6
# Largest difference of the strains from those of q, in units: a learner at its bound must not fold the arm.
_MOST = 2.0
# Steps from constant strains to the shape.
_STEPS = 5
# Part of the largest singular value above which a direction counts.
_ROUND_OFF = 1e-9


@dataclass(frozen=True)
class UnevenShape:
    """What is kept from tick to tick.

    Attributes
    ----------
    deviation : ndarray (2 n_q,)
        x minus the constant strains of q.
    force : ndarray (n_q,) or None
        H_1(q) p; None before the first tick.
    moves : ndarray (2 n_q, n_q) or None
        dx / dq; None before the first tick.
    slope, even_slope : ndarray (2 n_q, 2 n_q), (n_q, n_q); None before the first tick
        Slopes by x and by q of the force that p misses, with strains that vary and that do not.
    column : int
        The column of both that the next tick finds anew: all would take as long as the rest of a tick.
    """

    deviation: Array
    force: Array | None = None
    moves: Array | None = None
    slope: Array | None = None
    even_slope: Array | None = None
    column: int = 0


def bends_unevenly(arm: SoftArm) -> bool:
    """Whether an arm has constant strains, all of which its chambers and the ends of its links determine."""
    robot = arm.robot
    if robot.contacts is not None or robot.tip_constraint is not None:
        return False
    if any(link.varies for link in robot.links):
        return False
    unit = q_scale_of(arm)
    # Where it is straight no two strains move an end alike unless they always do.
    ends = _ends(arm, _link_ends(robot), np.zeros(arm.n_q))[1] * unit
    return all(_full_rank(rows) for rows in (ends.T, unit[:, None] * arm.actuation_matrix()))


class Uneven:
    """The uneven bend of one arm for which `bends_unevenly` holds.

    Parameters
    ----------
    arm : SoftArm
        Discretised model.
    pieces : int
        Number of pieces into which each link is discretised.
    """

    def __init__(self, arm: SoftArm, pieces: int = 1) -> None:
        self.arm, self.varying = arm, SoftArm(_varying(arm.robot))
        self.unit = q_scale_of(arm, pieces)
        self.varying_unit = np.repeat(self.unit, _TERMS)
        self.spread = np.kron(np.eye(arm.n_q), np.eye(_TERMS, 1))
        self.ends = _link_ends(arm.robot)

    def initial_state(self) -> UnevenShape:
        """Return the state before the first tick."""
        return UnevenShape(np.zeros(self.varying.n_q))

    def step(
        self, state: UnevenShape, point: Point, mass_kg: float, forces: MotionForces | None = None
    ) -> tuple[UnevenShape, UnevenForce]:
        """Return state and force after one step of Newton.

        Parameters
        ----------
        state : UnevenShape
            After the last tick.
        point : Point
            Coordinates, near to those of the last tick, rates and accelerations.
        mass_kg : float
            Mass at the tip beyond the robot file's [kg].
        forces : MotionForces, optional
            Those of the arm at the point, where they are known.

        Raises
        ------
        LinAlgError
            If the arm has no stiffness in a shape.
        """
        arm, varying, n, unit = self.arm, self.varying, self.arm.n_q, self.unit
        q, x = point.q, self.spread @ point.q + state.deviation
        moved_by = self.spread if state.moves is None else state.moves
        even_motion, motion = (point.qd, point.qdd), (moved_by @ point.qd, moved_by @ point.qdd)
        even, even_load, here = forces or arm.motion_forces(q, *even_motion)
        now, load, there = varying.motion_forces(x, *motion)
        even = even + mass_kg * even_load
        force = even if state.force is None else state.force
        scaled = unit[:, None] * here
        # The least pressures by a force.
        to_pressure = scaled.T @ np.linalg.solve(scaled @ scaled.T, np.diag(unit))
        pressure = to_pressure @ force

        def missed(of: SoftArm, qd: Array, qdd: Array, at: Array) -> Array:
            force, by_mass, actuation = of.motion_forces(at, qd, qdd)
            return np.asarray(force + mass_kg * by_mass - actuation @ pressure)

        now = now + mass_kg * load - there @ pressure
        slope = _slope(
            state.slope, state.column, x, self.varying_unit, partial(missed, varying, *motion), now
        )
        even_slope = _slope(
            state.even_slope,
            state.column,
            q,
            unit,
            partial(missed, arm, *even_motion),
            even - here @ pressure,
        )
        wanted, by_q = _ends(arm, self.ends, q)
        found, by_x = _ends(varying, self.ends, x)
        # Rows and columns in units; the ends count by the motion of q that they make.
        turn = by_q * unit
        square = np.zeros((varying.n_q + n, varying.n_q + n))
        square[:-n, :-n] = self.varying_unit[:, None] * slope * self.varying_unit
        square[:-n, -n:] = -self.varying_unit[:, None] * (there @ to_pressure) / unit
        square[-n:, :-n] = turn.T @ by_x * self.varying_unit
        right = np.zeros((varying.n_q + n, 2 + n))
        right[:-n, 0] = -self.varying_unit * now
        right[-n:, 0] = turn.T @ (wanted - found)
        right[:-n, 1] = -self.varying_unit * load
        right[-n:, 2:] = turn.T @ by_q
        solved = np.linalg.solve(square, right)
        by_none, by_mass, by_coordinate = np.split(solved[-n:] / unit[:, None], [1, 2], axis=1)
        force = force + by_none[:, 0]
        most = _MOST * self.varying_unit
        deviation = np.clip(state.deviation + self.varying_unit * solved[:-n, 0], -most, most)
        lacking = UnevenForce(q, mass_kg, force - even, by_mass[:, 0] - even_load, by_coordinate - even_slope)
        moves: Array = self.varying_unit[:, None] * solved[:-n, 2:]
        return UnevenShape(deviation, force, moves, slope, even_slope, state.column + 1), lacking

    def away(self, point: Point, mass_kg: float) -> Array:
        """Return the force (n_q,) at a point far from any tick, for a mass [kg] at the tip."""
        state, force = self.initial_state(), np.zeros_like(point.q)
        for _ in range(_STEPS):
            state, lacking = self.step(state, point, mass_kg)
            force = lacking.force
        return force


def _slope(
    last: Array | None, column: int, at: Array, unit: Array, missed: Callable[[Array], Array], now: Array
) -> Array:
    """Return a slope with one column found anew; at the first tick all."""
    n = at.size
    slope = np.zeros((n, n)) if last is None else last.copy()
    for k in range(n) if last is None else (column % n,):
        moved = at.copy()
        moved[k] += _STEP * unit[k]
        slope[:, k] = (missed(moved) - now) / (_STEP * unit[k])
    return slope


def _link_ends(robot: Robot) -> Array:
    return np.cumsum([link.length for link in robot.links])


def _ends(arm: SoftArm, places: Array, q: Array) -> tuple[Array, Array]:
    """Return the positions (3 n_links,) of link ends [m], and their change by q (3 n_links, n_q)."""
    found = [arm.pose_and_jacobian(q, place) for place in places]
    return (
        np.concatenate([pose[:3, 3] for pose, _ in found]),
        np.concatenate([pose[:3, :3] @ jacobian[3:] for pose, jacobian in found]),
    )


def _full_rank(rows: Array) -> bool:
    if rows.shape[0] > rows.shape[1]:
        return False
    sizes = np.linalg.svd(rows, compute_uv=False)
    return bool(sizes.min() > _ROUND_OFF * sizes.max())


def _varying(robot: Robot) -> Robot:
    """Return the robot at rest with strains that vary; its losses may not have that form."""
    still: dict[str, Any] = {"damping": None, "creep": [], "hysteresis": []}
    links = [{**fields(link), **still} for link in robot.links]
    return with_basis(robot.replace(links=links), "legendre", _TERMS - 1)
