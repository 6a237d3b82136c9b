"""Steppers: one step of an arm in time, state in, state and status out."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from soro_core._box import Box
from soro_core.arrays import Array
from soro_core.errors import ModelError, short
from soro_core.integrate.air import NO_AIR, Air, air_behind, air_pressures, initial_air, with_air
from soro_core.integrate.base_motion import WIDTH, Base, base_rows, with_base
from soro_core.integrate.causes import describe_at
from soro_core.integrate.explicit import explicit_run
from soro_core.integrate.implicit import implicit_run
from soro_core.integrate.state import OK, State, Status
from soro_core.integrate.step_work import make_stepping
from soro_core.integrate.steppers.dopri5 import DOPRI5
from soro_core.integrate.steppers.midpoint import MIDPOINT
from soro_core.integrate.steppers.midpoint_linear import MIDPOINT_LINEAR
from soro_core.integrate.steppers.rk4 import RK4
from soro_core.integrate.steppers.scheme import Dissipative, Scheme
from soro_core.integrate.steppers.tableau import Tableau
from soro_core.integrate.steppers.tr_bdf2 import TR_BDF2
from soro_core.integrate.steppers.tr_bdf2_linear import TR_BDF2_LINEAR
from soro_core.integrate.steppers.trapezoidal import TRAPEZOIDAL
from soro_core.model import SoftArm
from soro_core.model.checks import finite, flat_wrench, number, refuse_push, require, shaped
from soro_core.model.dynamics import GOOD
from soro_core.pneumatics.chamber import Gas, make_gas
from soro_core.pneumatics.valve_condition import ValveCondition
from soro_core.pneumatics.valve_model import ValveModel

if TYPE_CHECKING:
    from soro_core.integrate.derivatives.step_derivatives import StepDerivatives, StepRoom

Run: TypeAlias = Callable[..., tuple[int, int]]

_SCHEMES: dict[str, Scheme | Tableau] = {
    "trapezoidal": TRAPEZOIDAL,
    "rk4": RK4,
    "midpoint_linear": MIDPOINT_LINEAR,
    "midpoint": MIDPOINT,
    "tr_bdf2": TR_BDF2,
    "tr_bdf2_linear": TR_BDF2_LINEAR,
    "dopri5": DOPRI5,
}
STEPPERS = tuple(_SCHEMES)
_IMPLICIT = tuple(name for name, scheme in _SCHEMES.items() if isinstance(scheme, Scheme))
DISSIPATIVE = tuple(name for name, scheme in _SCHEMES.items() if isinstance(scheme, Dissipative))
"""Steppers that gain no energy without input (ADR 0009)."""


def run_of(name: str, rtol: float | None = None, air: Air = NO_AIR, guarded: bool = True) -> Run:
    """Return the kernel of a stepper: run(box, (times, pressure, wrench), (q, v, z)) -> (last row, code).

    Parameters
    ----------
    name : str
        One of `STEPPERS`.
    rtol : float, optional
        Relative tolerance of one step, for steppers with error control.
    air : Gas, optional
        Air behind valves; default none.
    guarded : bool
        Whether an implicit stepper damps and divides steps that do not resolve the motion, and a dissipative
        one removes gained energy (ADR 0009). False gives a smooth map, which a filter can linearise.

    Raises
    ------
    ModelError
        If there is no such stepper, it takes no such tolerance, or it takes no air.
    """
    if not isinstance(name, str) or name not in STEPPERS:
        raise ModelError(f"integrator {short(name)}: allowed are {', '.join(STEPPERS)}", "integrator")
    scheme = _SCHEMES[name]
    if isinstance(scheme, Scheme):
        if air is not NO_AIR or not guarded:
            # Air through valves carries energy, and the removal of energy is not a smooth map.
            scheme = Scheme(*scheme)
        alone = scheme._replace(resolved=math.inf, far=math.inf)
        run: Run = partial(implicit_run, scheme if guarded else alone, air)
    elif air is not NO_AIR:
        raise ModelError(
            f"integrator {name!r} with valves: allowed are the implicit ones, {', '.join(_IMPLICIT)}",
            "integrator",
        )
    else:
        run = partial(explicit_run, scheme if rtol is None else scheme._replace(rtol=number(rtol)))
    if rtol is not None:
        if isinstance(scheme, Scheme) or not scheme.adaptive:
            raise ModelError(
                f"rtol = {short(rtol)} with integrator {name!r}: allowed is none, its steps are dt", "rtol"
            )
        if not 1e-14 <= number(rtol) <= 0.1:
            raise ModelError(f"rtol = {short(rtol)}: allowed is a number from 1e-14 to 0.1", "rtol")
    return run


def internal_states(arm: SoftArm, air: Air = NO_AIR) -> int:
    """Return the number of states: creep and hysteresis and, with air, mass and volume of each chamber."""
    return arm.n_internal + (2 * arm.n_u if isinstance(air, Gas) else 0)


def stepping(arm: SoftArm, air: Air = NO_AIR, base: Base | None = None) -> Box:
    """Return tables and workspace for a kernel of `run_of`, for one thread.

    Parameters
    ----------
    arm : SoftArm
    air : Gas, optional
        Of the chambers, where valves fill them.
    base : callable, optional
        State of the base at a time [s], where it moves.

    Raises
    ------
    ModelError
        If the base moves and there are valves, or the method is not `exact`.
    """
    tables = with_air(arm.tables, arm.n_u) if isinstance(air, Gas) else arm.tables
    if base is None:
        return make_stepping(tables, arm.n_q, internal_states(arm, air), arm.n_u)
    if arm.method != "exact":
        raise ModelError(f"base with method {arm.method!r}: allowed is 'exact'", "base")
    if isinstance(air, Gas):
        raise ModelError("base with valves: allowed is a base at rest, or given pressures", "base")
    return make_stepping(with_base(tables), arm.n_q, arm.n_internal, arm.n_u + WIDTH)


class Stepper:
    """One integrator on one arm; use `make_stepper`.

    Parameters
    ----------
    name : str
        One of `STEPPERS`.
    arm : SoftArm
        Model.
    guarded : bool
        Whether the step may damp, divide and take out energy, see `run_of`.
    valves : ValveModel, optional
        Valves in front of the chambers; without them the pressures are given.
    base : callable, optional
        Motion of the base, as of `simulate`; default at rest.
    """

    def __init__(
        self,
        name: str,
        arm: SoftArm,
        guarded: bool = True,
        valves: ValveModel | None = None,
        base: Base | None = None,
    ) -> None:
        require(arm, SoftArm, "arm", "a SoftArm")
        require(valves, ValveModel | None, "valves", "a ValveModel")
        self.name = name
        self.arm = arm
        self._valves, self._guarded, self._base = valves, guarded, base
        self._air = air_behind(arm, valves)
        self._run = run_of(name, air=self._air, guarded=guarded)
        self._box = stepping(arm, self._air, base)
        self._n_internal = internal_states(arm, self._air)
        self._room: StepRoom | None = None

    def initial_state(
        self, q: ArrayLike | None = None, qd: ArrayLike | None = None, pressure0: ArrayLike | None = None
    ) -> State:
        """Return a state with relaxed internal states.

        Parameters
        ----------
        q, qd : (n_q,), optional
            Coordinates and velocities; default straight and at rest.
        pressure0 : (n_u,), optional
            With valves, gauge pressures in the chambers [Pa]; default 0.
        """
        n, name = self.arm.n_q, self.arm.robot.name
        start = np.zeros(n) if q is None else shaped(q, (n,), "q", name)
        given = None
        if pressure0 is not None:
            given = finite(shaped(pressure0, (self.arm.n_u,), "pressure0", name), "pressure0")
        air = initial_air(self._air, self.arm, start, given)
        return State(
            start,
            np.zeros(n) if qd is None else shaped(qd, (n,), "qd", name),
            np.concatenate((np.zeros(self.arm.n_internal), air)),
        )

    def pressures(self, state: State) -> Array:
        """Return the gauge pressures (n_u,) [Pa] of chambers behind valves.

        Raises
        ------
        ModelError
            If there are no valves: the pressures are then given.
        """
        if not isinstance(self._air, Gas):
            text = "pressures of a state without valves: allowed is with, else they are given"
            raise ModelError(text, "valves")
        pressures: Array = air_pressures(self._air, state.internal[None, self.arm.n_internal :])[0]
        return pressures

    def step(
        self,
        state: State,
        pressures: ArrayLike,
        dt: float,
        wrench: ArrayLike | None = None,
        condition: ValveCondition | None = None,
        t: float = 0.0,
    ) -> tuple[State, Status]:
        """Return state and status after dt, with pressures and wrench held.

        Parameters
        ----------
        state : State
            State at the start.
        pressures : (n_u,)
            Gauge pressures or, with valves, set points [Pa], then tensions of the tendons [N].
        dt : float
            Time step [s], above 0.
        wrench : (6,) or (n_wrenches, 6), optional
            Wrenches, as in `SoftArm.forward_dynamics`.
        condition : ValveCondition, optional
            Faults of the valves; healthy by default.
        t : float
            Time at the start [s], for a base that moves.

        Returns
        -------
        State, Status
            On failure the state at the start, and the cause as status.

        Raises
        ------
        ModelError
            If a shape is wrong or dt is not above 0. Values that are not finite give a status instead.
        """
        arm = self.arm
        require(state, State, "state", "a State, as initial_state gives it")
        if not 0.0 < number(dt) < math.inf:
            raise ModelError(f"dt = {short(dt)} s: allowed is a number above 0", "dt")
        p = shaped(pressures, (arm.n_u,), "pressures", arm.robot.name)
        if arm.robot.tendons:
            refuse_push(arm.robot, p, "pressures")
        w = flat_wrench(arm.robot, wrench)
        q = self._before_and_after(state.q, arm.n_q, "q")
        v = self._before_and_after(state.qd, arm.n_q, "qd")
        z = self._before_and_after(state.internal, self._n_internal, "internal")
        table = np.empty((2, 3, arm.n_u))
        table[:] = p
        if self._base is not None:
            rows = base_rows(self._base, arm, t + float(dt) * np.array([[0.0, 0.5, 1.0]] * 2))
            table = np.concatenate((table, rows), axis=2)
        _, code = self._run_with(condition)(self._box, (np.array([0.0, number(dt)]), table, w), (q, v, z))
        if code != GOOD:
            return state, describe_at(code, arm, q[0])
        return State(q[1], v[1], z[1]), OK

    def derivatives(
        self, state: State, pressures: ArrayLike, dt: float, wrench: ArrayLike | None = None
    ) -> StepDerivatives:
        """Return the state after `step` and its exact derivatives, docs/model.md (48), (49).

        Parameters
        ----------
        state, pressures, dt, wrench : State, (n_u,), float, (6,) or None
            As in `step`.

        Returns
        -------
        StepDerivatives
            State after the step, and its derivatives by q, qd, internal states and pressures.

        Raises
        ------
        ModelError
            As `step`, and if the step fails; where the arm has no derivatives (`SoftArm.derivatives`); of a
            linearly implicit stepper; with valves; if the step was damped, divided or corrected (ADR 0009).
        """
        from soro_core.integrate.derivatives.step_derivatives import StepRoom, refuse_underivable

        refuse_underivable(self.name, _SCHEMES[self.name], self._valves)
        if self._base is not None:
            raise ModelError("derivatives of a step on a base that moves: allowed is one at rest", "base")
        if self._room is None:
            self._room = StepRoom(self.arm)
        end, status = self.step(state, pressures, dt, wrench)
        if not status.ok:
            raise ModelError(f"derivatives of a step that {status}")
        return self._room.derive(_SCHEMES[self.name], self._box, (state, end), pressures, dt, wrench)

    def _before_and_after(self, values: Array, n: int, name: str) -> Array:
        """Return the rows (2, n) of a run of one step, the first of them given."""
        rows = np.empty((2, n))
        is_right = type(values) is np.ndarray and values.dtype == np.float64 and values.shape == (n,)
        rows[0] = values if is_right else shaped(values, (n,), name, self.arm.robot.name)
        return rows

    def _run_with(self, condition: ValveCondition | None) -> Run:
        if condition is None:
            return self._run
        if not (isinstance(self._air, Gas) and self._valves is not None):
            raise ModelError("a condition of valves without valves: allowed is none", "condition")
        air = make_gas(self._valves, self._air.volume, condition)
        return run_of(self.name, air=air, guarded=self._guarded)


def make_stepper(
    name: str,
    arm: SoftArm,
    guarded: bool = True,
    valves: ValveModel | None = None,
    base: Base | None = None,
) -> Stepper:
    """Return the stepper of a name; parameters as in `Stepper`.

    Raises
    ------
    ModelError
        If there is none, it takes no valves, or with valves a chamber has no volume.
    """
    return Stepper(name, arm, guarded, valves, base)
