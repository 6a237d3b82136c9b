"""Non-uniform strain of links under load, which a constant-strain model cannot represent.

Weight and inertia bend a link most near its base. With strains that vary linearly along each link,
coordinates x with the accelerations dx/dq qdd, the arm keeps

    f(x) + m Y(x) = H(x) p,   the ends of the links where q has them

in x and p, and these pressures make the force H_1(q) p in the coordinates q, not G + f_e + m Y_m. The
difference is the unmodelled force of a law with constant strains, docs/control.md. One step of Newton a tick
follows it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from soro_core.adaptation.nonuniform_force import NonuniformForce
from soro_core.adaptation.scales import q_scale_of
from soro_core.arrays import Array
from soro_core.control.kernel import nonuniform_strain as kernel
from soro_core.control.reference.trajectory import Point
from soro_core.frozen import quick
from soro_core.model import SoftArm
from soro_core.model.checks import fault
from soro_core.model.dynamics import GOOD, SINGULAR
from soro_core.robot import Robot
from soro_core.robot.discretisation import with_basis
from soro_core.robot.parts import fields

# Steps from constant strains to the shape.
_STEPS = 5
# Part of the largest singular value above which a direction counts.
_ROUND_OFF = 1e-9


@quick
@dataclass(frozen=True)
class NonuniformStrainState:
    """What is kept from tick to tick.

    Attributes
    ----------
    deviation : ndarray (2 n_q,)
        x minus the constant strains of q.
    force : ndarray (n_q,)
        H_1(q) p.
    moves : ndarray (2 n_q, n_q)
        dx / dq.
    slope, even_slope : ndarray (2 n_q, 2 n_q), (n_q, n_q)
        Slopes by x and by q of the force that p misses, with strains that vary and that do not.
    column : int
        The column of both that the next tick finds anew: all would take as long as the rest of a tick. -1
        before the first tick, which finds the force and all columns.
    """

    deviation: Array
    force: Array
    moves: Array
    slope: Array
    even_slope: Array
    column: int = -1


def has_nonuniform_strain(arm: SoftArm) -> bool:
    """Whether an arm has constant strains, all of which its chambers and the ends of its links determine."""
    robot = arm.robot
    if robot.contacts is not None or robot.tip_constraint is not None:
        return False
    if any(link.varies for link in robot.links):
        return False
    unit = q_scale_of(arm)
    # Where it is straight no two strains move an end alike unless they always do.
    ends = _ends_by_q(arm) * unit
    return all(_full_rank(rows) for rows in (ends.T, unit[:, None] * arm.actuation_matrix()))


def nonuniform_of(arm: SoftArm, pieces: int) -> NonuniformStrain | None:
    """Return the non-uniform strain of an arm without its contacts, or None where it has none.

    Parameters
    ----------
    arm : SoftArm
        Discretised model.
    pieces : int
        Number of pieces into which each link is discretised.
    """
    bare = SoftArm(arm.robot.replace(contacts=None))
    return NonuniformStrain(bare, pieces) if has_nonuniform_strain(bare) else None


class NonuniformStrain:
    """The non-uniform strain of one arm for which `has_nonuniform_strain` holds.

    Parameters
    ----------
    arm : SoftArm
        Discretised model.
    pieces : int
        Number of pieces into which each link is discretised.
    """

    def __init__(self, arm: SoftArm, pieces: int = 1) -> None:
        self.varying = SoftArm(_varying(arm.robot))
        self.unit = q_scale_of(arm, pieces)
        self.varying_unit = np.repeat(self.unit, kernel.TERMS)
        self.spread = np.asarray(np.kron(np.eye(arm.n_q), np.eye(kernel.TERMS, 1)), dtype=np.float64)
        even = arm if arm.method == "exact" else SoftArm(arm.robot)
        self._box = kernel.make_arm_pair(even.tables, self.varying.tables, self.unit, self.varying_unit)

    def initial_state(self) -> NonuniformStrainState:
        """Return the state before the first tick."""
        n, wide = self.unit.size, self.varying_unit.size
        slopes = np.zeros((wide, wide)), np.zeros((n, n))
        return NonuniformStrainState(np.zeros(wide), np.zeros(n), self.spread.copy(), *slopes)

    def step(
        self, state: NonuniformStrainState, point: Point, mass_kg: float
    ) -> tuple[NonuniformStrainState, NonuniformForce]:
        """Return state and force after one step of Newton.

        Parameters
        ----------
        state : NonuniformStrainState
            After the last tick.
        point : Point
            Coordinates, near to those of the last tick, rates and accelerations.
        mass_kg : float
            Mass at the tip beyond the robot file's [kg].

        Raises
        ------
        ModelError
            If a coordinate is not finite, or a link would be compressed to nothing.
        LinAlgError
            If the arm has no stiffness in a shape.
        """
        q, qd, qdd = np.array([point.q, point.qd, point.qdd], dtype=np.float64)
        slopes = state.slope.copy(), state.even_slope.copy()
        shape = (state.deviation.copy(), state.force.copy(), state.moves.copy(), *slopes)
        unmodelled = np.empty(q.size), np.empty(q.size), np.empty((q.size, q.size))
        code = kernel.step(self._box, (q, qd, qdd), mass_kg, state.column, shape, unmodelled)
        if code == SINGULAR:
            raise np.linalg.LinAlgError("the non-uniform strain has no equilibrium")
        if code != GOOD:
            raise fault(code, q, qd)
        return NonuniformStrainState(*shape, max(state.column, 0) + 1), NonuniformForce(
            q, mass_kg, *unmodelled
        )

    def away(self, point: Point, mass_kg: float) -> Array:
        """Return the force (n_q,) at a point far from any tick, for a mass [kg] at the tip."""
        state, force = self.initial_state(), np.zeros_like(point.q)
        for _ in range(_STEPS):
            state, unmodelled = self.step(state, point, mass_kg)
            force = unmodelled.force
        return force


def _ends_by_q(arm: SoftArm) -> Array:
    """Return the change by q (3 n_links, n_q) of the positions of link ends where the arm is straight."""
    places = np.cumsum([link.length for link in arm.robot.links])
    found = [arm.pose_and_jacobian(np.zeros(arm.n_q), place) for place in places]
    return np.concatenate([pose[:3, :3] @ jacobian[3:] for pose, jacobian in found])


def _full_rank(rows: Array) -> bool:
    if rows.shape[0] > rows.shape[1]:
        return False
    sizes = np.linalg.svd(rows, compute_uv=False)
    return bool(sizes.min() > _ROUND_OFF * sizes.max())


def _varying(robot: Robot) -> Robot:
    """Return the robot at rest with strains that vary; its losses may not have that form."""
    still: dict[str, Any] = {"damping": None, "creep": [], "hysteresis": []}
    links = [{**fields(link), **still} for link in robot.links]
    return with_basis(robot.replace(links=links), "legendre", kernel.TERMS - 1)
