"""The shape of the backbone in which an arm rests on its reference, under the load that its law has learned.

Strains of the reference determine where link ends are, or what chambers drive. Between the ends, weight bends
links non-uniformly; and coordinates that no chamber drives rest where forces balance.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from soro_core.arrays import Array
from soro_core.control.laws.protocol import Law
from soro_core.control.nonuniform_strain import NonuniformStrain
from soro_core.control.reference.trajectory import Point
from soro_core.control.reference.underactuation import UnderactuatedReference
from soro_core.errors import SoroError
from soro_core.model import SoftArm

# Steps of Newton towards the shape: from none, and from that of the coordinates before.
_FIRST_STEPS, _STEPS = 12, 2
# What a step may raise where forces have no balance: the shape is then that of the strains alone.
_NO_BALANCE = (SoroError, np.linalg.LinAlgError)


class RestingShape:
    """The shape of an arm that its reference determines.

    Attributes
    ----------
    arm : SoftArm
        Arm with the coordinates x = spread q + offset of the shape on the reference q.
    spread : ndarray (n_x, n_q)
    """

    def __init__(self, arm: SoftArm, spread: Array) -> None:
        self.arm, self.spread = arm, spread

    def offset(self, q: Array) -> Array:
        """Return the offset (n_x,) at a reference (n_q,), near to the one before."""
        return np.zeros(self.arm.n_q)


class NonuniformShape(RestingShape):
    """The shape of links that weight bends non-uniformly between their ends.

    Parameters
    ----------
    nonuniform : NonuniformStrain
        Of the arm without contact.
    mass_kg : float
        Mass at the tip beyond the robot file's [kg].
    """

    def __init__(self, nonuniform: NonuniformStrain, mass_kg: float) -> None:
        super().__init__(nonuniform.varying, nonuniform.spread)
        self._nonuniform, self._mass_kg = nonuniform, mass_kg
        self._state, self._steps = nonuniform.initial_state(), _FIRST_STEPS

    def offset(self, q: Array) -> Array:
        """Return how the strains vary along the links."""
        still = Point(q, np.zeros_like(q), np.zeros_like(q))
        try:
            for _ in range(self._steps):
                self._state, _ = self._nonuniform.step(self._state, still, self._mass_kg)
            self._steps = _STEPS
        except _NO_BALANCE:
            self._state, self._steps = self._nonuniform.initial_state(), _FIRST_STEPS
        return self._state.deviation


class UnderactuatedShape(RestingShape):
    """The shape of an arm with coordinates that no chamber drives.

    Parameters
    ----------
    underactuated : UnderactuatedReference
    force : callable
        Force (n_q,) of the law at rest, at coordinates (n_q,).
    actuation : callable
        H (n_q, n_u) at coordinates (n_q,).
    """

    def __init__(
        self,
        underactuated: UnderactuatedReference,
        force: Callable[[Array], Array],
        actuation: Callable[[Array], Array],
    ) -> None:
        super().__init__(underactuated.arm, np.eye(underactuated.arm.n_q))
        self._underactuated, self._force, self._actuation = underactuated, force, actuation
        self._state, self._steps = underactuated.initial_state(), _FIRST_STEPS

    def offset(self, q: Array) -> Array:
        """Return what keeps the tip of the reference, as far as chambers bring it there."""
        still = found = Point(q, np.zeros_like(q), np.zeros_like(q))
        try:
            for _ in range(self._steps):
                self._state, found, _ = self._underactuated.step(
                    self._state, still, self._force, self._actuation
                )
            self._steps = _STEPS
        except _NO_BALANCE:
            self._state, self._steps, found = self._underactuated.initial_state(), _FIRST_STEPS, still
        return np.asarray(found.q - q)


def resting_shape(
    arm: SoftArm,
    law: Law[Any],
    law_state: object,
    underactuated: UnderactuatedReference,
    nonuniform: NonuniformStrain | None,
) -> RestingShape:
    """Return the shape of an arm, with the load that its law has learned.

    Parameters
    ----------
    arm : SoftArm
    law : Law
    law_state : object
        Holds what is learned.
    underactuated : UnderactuatedReference
        Coordinates of the arm that no chamber drives.
    nonuniform : NonuniformStrain or None
        Its non-uniform strain, where it has one.
    """
    if underactuated.exist and law.learns:

        def force(q: Array) -> Array:
            return law.reference_force(law_state, q, np.zeros_like(q), np.zeros_like(q))

        return UnderactuatedShape(
            underactuated, force, lambda q: law.actuation(law_state, arm.actuation_matrix(q), q)
        )
    if nonuniform is None:
        return RestingShape(arm, np.eye(arm.n_q))
    own = arm.robot.tip_mass
    return NonuniformShape(nonuniform, law.estimates(law_state).get("tip_mass", own) - own)
