"""Derivatives of one step of a stepper, docs/model.md (48), (49)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from soro_core._box import Box, view
from soro_core._jit import entry, inner
from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.integrate.derivatives.explicit_sensitivity import follow_explicit
from soro_core.integrate.derivatives.implicit_sensitivity import follow_implicit
from soro_core.integrate.derivatives.sensitivity import (
    LAST,
    STAGE,
    START,
    Q,
    StepRule,
    V,
    box_of,
    make_sensitivity,
)
from soro_core.integrate.state import State
from soro_core.integrate.step_work import StepInput
from soro_core.integrate.steppers.scheme import Scheme
from soro_core.integrate.steppers.tableau import Tableau
from soro_core.model.checks import flat_wrench, shaped
from soro_core.model.checks import refuse_underivable as refuse_arm
from soro_core.model.dynamics import GOOD, NOT_FINITE, SINGULAR
from soro_core.model.links.linear import assign_matrix, clear_matrix
from soro_core.model.records import ArmState
from soro_core.pneumatics.valve_model import ValveModel

if TYPE_CHECKING:
    from soro_core.model import SoftArm


# Code of a step that was damped, divided or corrected, beside those of `soro_core.model.dynamics`.
OTHER_STEP = 30
# Largest difference of a step from its rule, relative to its largest entry: round-off. With a larger bound a
# small removal of gained energy (ADR 0009) would not be found.
SAME = 1e-13


class StepDerivatives(NamedTuple):
    """Derivatives of the state after a step; rows are q, qd and internal, one behind the other."""

    state: State
    """State after the step."""
    by_q: Array
    """(n_x, n_q) with n_x = 2 n_q + n_internal."""
    by_qd: Array
    """(n_x, n_q)."""
    by_internal: Array
    """(n_x, n_internal)."""
    by_p: Array
    """(n_x, n_u), of pressures that hold over the step, per Pa."""


class StepRoom:
    """Workspace for the derivatives of the steps of one stepper.

    Parameters
    ----------
    arm : SoftArm
        Model; one without derivatives is refused.
    """

    def __init__(self, arm: SoftArm) -> None:
        refuse_arm(arm.robot, arm.method)
        self._arm = arm
        # The box does not keep the arrays.
        self._arrays = make_sensitivity(arm.n_q, arm.n_internal, arm.n_u)
        self._box = box_of(arm._box, self._arrays)

    def derive(
        self,
        rule: Scheme | Tableau,
        run: Box,
        states: tuple[State, State],
        pressures: ArrayLike,
        dt: float,
        wrench: ArrayLike | None,
    ) -> StepDerivatives:
        """Derive the step that was made last.

        Parameters
        ----------
        rule : Scheme or Tableau
            Coefficients of the stepper.
        run : Box
            The stepper's `Stepping` after the step.
        states : tuple of State
            Those before and after it.
        pressures, dt, wrench : array_like, float, array_like or None
            Those of the step.

        Raises
        ------
        ModelError
            If the step is not one step of the rule.
        """
        arm, (state, end) = self._arm, states
        name, n_q, n_z = arm.robot.name, arm.n_q, arm.n_internal
        q, qd = shaped(state.q, (n_q,), "q", name), shaped(state.qd, (n_q,), "qd", name)
        z = shaped(state.internal, (n_z,), "internal", name)
        p, w = shaped(pressures, (arm.n_u,), "pressures", name), flat_wrench(arm.robot, wrench)
        by = np.empty((2 * n_q + n_z, 2 * n_q + n_z + arm.n_u))
        coefficients = rule.stages if isinstance(rule, Scheme) else rule.matrix
        own, at_start = (rule.own, rule.start) if isinstance(rule, Scheme) else (0, False)
        fields, motion = (coefficients, own, at_start, float(dt)), ((q, qd, z), (end.q, end.qd))
        code = _derive(self._box, run, fields, motion, (p, w), by)
        if code == OTHER_STEP:
            raise ModelError(
                f"derivatives of a step that was damped, divided or corrected (dt = {float(dt):g} s):"
                " allowed is one step of the stepper's rule; use a smaller dt or guarded=False",
                "dt",
            )
        if code != GOOD:
            raise ModelError("derivatives of a step whose equations are singular; use a smaller dt", "dt")
        of_q, of_qd, of_z = by[:, :n_q], by[:, n_q : 2 * n_q], by[:, 2 * n_q : 2 * n_q + n_z]
        return StepDerivatives(end, of_q, of_qd, of_z, by[:, 2 * n_q + n_z :])


@inner
def _differs(x: Array, y: Array) -> bool:
    """Whether x is not y but for round-off of the largest entry."""
    most, size = 0.0, 0.0
    for b in range(x.shape[0]):
        most = max(most, abs(x[b] - y[b]))
        size = max(size, abs(y[b]))
    return not most <= SAME * size


@entry
def _derive(
    box: Box,
    run: Box,
    fields: tuple[Array, int, bool, float],
    motion: tuple[tuple[Array, Array, Array], tuple[Array, Array]],
    held: tuple[Array, Array],
    by: Array,
) -> int:
    """Fill `by` (2 n_q + n_z, w) with the derivatives of the step that `run` has made last; gives a code.

    `fields` of a `StepRule`; `motion`: q, v, z before the step, and q, v after it; `held`: pressures (n_u,)
    and wrenches.
    """
    room, stepping = view(box), view(run)
    s, rule = room.sensitivity, StepRule(*fields)
    start, end = ArmState(*motion[0]), motion[1]
    given = StepInput(*held)
    n_q, n_z = s.q.shape[2], s.z.shape[2]
    clear_matrix(s.a[START])
    clear_matrix(s.a[LAST])
    assign_matrix(s.v[START], s.v[LAST])
    assign_matrix(s.z[START], s.z[LAST])
    if rule.own > 0:
        good = follow_implicit(room, stepping, rule, start, given)
    else:
        good = follow_explicit(room, stepping, rule.coefficients, rule.h, start, given)
    if _differs(s.point[Q], end[0]) or _differs(s.point[V], end[1]):
        return OTHER_STEP
    total = 0.0
    for w in range(s.q.shape[1]):
        for b in range(n_q):
            by[b, w], by[n_q + b, w] = s.q[STAGE, w, b], s.v[STAGE, w, b]
            total += by[b, w] + by[n_q + b, w]
        for j in range(n_z):
            by[2 * n_q + j, w] = s.z[STAGE, w, j]
            total += by[2 * n_q + j, w]
    if not good:
        return SINGULAR
    return GOOD if math.isfinite(total) else NOT_FINITE


def refuse_underivable(name: str, rule: Scheme | Tableau, valves: ValveModel | None) -> None:
    """Refuse steppers whose steps have no derivatives.

    Parameters
    ----------
    name : str
        Name of the stepper.
    rule : Scheme or Tableau
        Coefficients of the stepper.
    valves : ValveModel or None
        Valves in front of the chambers.

    Raises
    ------
    ModelError
        One line.
    """
    if valves is not None:
        raise ModelError(
            "derivatives of a step with valves: allowed is without, with given pressures", "valves"
        )
    if isinstance(rule, Scheme) and rule.linear:
        raise ModelError(
            f"derivatives of a step of the integrator {name!r}, which does not solve its equations:"
            " allowed are those whose name does not end in _linear",
            "integrator",
        )
