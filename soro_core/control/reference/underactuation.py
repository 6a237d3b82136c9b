"""Underactuated arms: a reference whose unactuated coordinates are in equilibrium, and the actuated subspace.

An arm may have more coordinates than its chambers drive. The others rest where the model and the learned load
put them, whatever the reference says. With N' H = 0, the law follows the q that solves

    minimise |tip(q) - tip(q_d)|^2 + eps |(q - q_d) / q_scale|^2   where   N' f(q, qd_d, qdd_d) = 0

and f is its own force on the reference, docs/control.md. One step of Newton a tick follows the solution.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from soro_core.adaptation.scales import q_scale_of
from soro_core.arrays import Array
from soro_core.control.reference.trajectory import Point
from soro_core.linear import solve
from soro_core.model import SoftArm
from soro_core.robot.coordinates import StrainFields

# A direction is driven if H is above this part of its largest singular value: the sine of pi is 1e-16.
_ROUND_OFF = 1e-9
# eps: a unit of each coordinate counts as 1e-2 of the length at the tip. Less lets noise through where
# chambers hardly move the tip in a direction; more leaves the tip beside the reference.
_NEAR = 1e-2
# Increment for the difference quotient of the force, in units, and the part of the largest stiffness that its
# round-off may be: what is softer has no balance.
_STEP, _STEP_NOISE = 1e-6, 1e-9


@dataclass(frozen=True)
class UnderactuatedState:
    """What is kept from tick to tick.

    Attributes
    ----------
    offset : ndarray (n_q,)
        What the law's reference adds to the given one.
    stiffness : ndarray (n_q, n_q) or None
        Slope of the force that the pressures miss, in units; None before the first tick.
    column : int
        The column that the next tick finds anew: all of them would take as long as the rest of a tick.
    """

    offset: Array
    stiffness: Array | None = None
    column: int = 0


@dataclass(frozen=True)
class ActuatedSubspace:
    """The motions of an arm that its chambers make while the other coordinates keep their balance.

    Attributes
    ----------
    arm : SoftArm
    unit, inverse : ndarray (n_q, n_q)
        Coordinates that one unit of each direction is, and the inverse.
    q : ndarray (n_q,)
        Coordinates of the balance.
    along : ndarray (n_q, n_d)
        Directions of the motions, in units.
    slope : ndarray (3, n_q)
        Change of the position of the tip by a unit of each direction [m].
    """

    arm: SoftArm
    unit: Array
    inverse: Array
    q: Array
    along: Array
    slope: Array

    def nearest(self, tip: Array, change: Array) -> Array:
        """Return the motion (n_q,), in units, that moves the tip as wanted and is near to a change.

        Parameters
        ----------
        tip : ndarray (3,)
            Wanted change of the position of the tip [m].
        change : ndarray (n_q,)
            Wanted change of the coordinates, in units; it decides what the tip leaves open.
        """
        tips, near = self.slope @ self.along, (_NEAR * self.arm.length) ** 2
        square = tips.T @ tips + near * self.along.T @ self.along
        return np.asarray(self.along @ np.linalg.solve(square, tips.T @ tip + near * (self.along.T @ change)))

    def within(self, q: Array, qd: Array) -> tuple[Array, Array]:
        """Return coordinates and rates (n_q,) whose tip is that of (q, qd), with no other motion than these.

        Parameters
        ----------
        q, qd : ndarray (n_q,)
            Coordinates and rates.
        """
        tip, slope = _tip(self.arm, q)
        here = self.arm.pose(self.q, self.arm.length)[:3, 3]
        away = self.nearest(tip - here, self.inverse @ (q - self.q))
        return self.q + self.unit @ away, self.unit @ self.nearest(slope @ qd, self.inverse @ qd)


class UnderactuatedReference:
    """The reference of an underactuated arm, whose unactuated coordinates are kept in equilibrium.

    Parameters
    ----------
    arm : SoftArm
        Discretised model.
    fields : StrainFields
        Its strains.
    limit : ndarray (n_q,)
        Largest absolute strains of a reference.
    pieces : int
        Number of pieces into which each link is discretised.
    """

    def __init__(self, arm: SoftArm, fields: StrainFields, limit: Array, pieces: int = 1) -> None:
        self.arm, self.fields, self.limit = arm, fields, limit
        # Mean squares along the links, so that the basis does not matter.
        self.unit = q_scale_of(arm, pieces)[:, None] * fields.root.T
        self.inverse = np.asarray(np.linalg.inv(self.unit), dtype=np.float64)
        self.exist = self._split(arm.actuation_matrix(np.zeros(arm.n_q)))[1].shape[1] > 0

    def initial_state(self) -> UnderactuatedState:
        """Return the state before the first tick."""
        return UnderactuatedState(np.zeros(self.arm.n_q))

    def step(
        self,
        state: UnderactuatedState,
        point: Point,
        force: Callable[[Array], Array],
        actuation: Callable[[Array], Array],
    ) -> tuple[UnderactuatedState, Point, ActuatedSubspace]:
        """Return the reference with the shape that the other coordinates take, after one step of Newton.

        Parameters
        ----------
        state : UnderactuatedState
            After the last tick.
        point : Point
            The given reference.
        force : callable
            Force f (n_q,) of the law at coordinates (n_q,) on the reference, without feedback.
        actuation : callable
            H (n_q, n_u) at coordinates (n_q,).

        Returns
        -------
        state : UnderactuatedState
        point : Point
            Its tip is that of the given reference as far as the chambers can bring it there.
        motions : ActuatedSubspace
            About this reference.
        """
        unit, inverse = self.unit, self.inverse
        q = self.fields.within(point.q + state.offset, self.limit)
        here = actuation(q)
        driven, free = self._split(here)
        # H turns with q: what the pressures of now miss has the right slope.
        wanted_force = unit.T @ force(q)
        pressure = np.linalg.lstsq(unit.T @ here, wanted_force, rcond=None)[0]

        def missed(at: Array) -> Array:
            return np.asarray(unit.T @ (force(at) - actuation(at) @ pressure))

        now = np.asarray(wanted_force - unit.T @ here @ pressure)
        stiffness = self._stiffness(state, q, now, missed)
        # Of the free shape while the driven directions are held.
        of_free = free.T @ stiffness @ free
        given = free.T @ np.column_stack([now, stiffness @ driven])
        held = solve(of_free, given, _STEP_NOISE, of=stiffness)
        back, along = -free @ held[:, 0], driven - free @ held[:, 1:]
        tip, slope = _tip(self.arm, q)
        wanted, of_wanted = _tip(self.arm, point.q)
        motions = ActuatedSubspace(self.arm, unit, inverse, q, along, slope @ unit)
        moved = back + motions.nearest(wanted - tip - motions.slope @ back, inverse @ (point.q - q) - back)
        q = self.fields.within(q + unit @ moved, self.limit)
        qd, qdd = (unit @ motions.nearest(of_wanted @ x, inverse @ x) for x in (point.qd, point.qdd))
        motions = replace(motions, q=q)
        column = (state.column + 1) % self.arm.n_q
        return UnderactuatedState(q - point.q, stiffness, column), Point(q, qd, qdd), motions

    def _stiffness(
        self, state: UnderactuatedState, q: Array, now: Array, missed: Callable[[Array], Array]
    ) -> Array:
        """Return the slope of the residual with one column found anew; at the first tick all."""
        first = state.stiffness is None
        columns = range(self.arm.n_q) if first else (state.column,)
        stiffness = np.zeros((q.size, q.size)) if state.stiffness is None else state.stiffness.copy()
        for k in columns:
            stiffness[:, k] = (missed(q + _STEP * self.unit[:, k]) - now) / _STEP
        return stiffness

    def _split(self, actuation: Array) -> tuple[Array, Array]:
        """Return bases of the directions that chambers drive, and of the others, (n_q, ...) in units."""
        left, sizes, _ = np.linalg.svd(self.unit.T @ actuation)
        rank = int(np.count_nonzero(sizes > _ROUND_OFF * sizes.max(initial=0.0)))
        return left[:, :rank], left[:, rank:]


def _tip(arm: SoftArm, q: Array) -> tuple[Array, Array]:
    """Return the position of the tip (3,) [m], and its change by each coordinate (3, n_q)."""
    pose, jacobian = arm.pose_and_jacobian(q, arm.length)
    return pose[:3, 3], pose[:3, :3] @ jacobian[3:]
