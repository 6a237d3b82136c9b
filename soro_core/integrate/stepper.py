"""Steppers: one step of an arm in time, state in, state and status out."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soro_core._box import Box
from soro_core.errors import ModelError, short
from soro_core.integrate.air import NO_AIR, Air, air_behind, air_pressures, initial_air, with_air
from soro_core.integrate.dopri5 import DOPRI5
from soro_core.integrate.explicit import MAX_STEPS, explicit_run
from soro_core.integrate.implicit import implicit_run
from soro_core.integrate.midpoint import MIDPOINT
from soro_core.integrate.midpoint_linear import MIDPOINT_LINEAR
from soro_core.integrate.rk4 import RK4
from soro_core.integrate.scheme import Dissipative, Scheme
from soro_core.integrate.state import OK, State, Status
from soro_core.integrate.system import CLOSED, NOT_RESOLVED, TOO_STIFF, make_stepping
from soro_core.integrate.tableau import Tableau
from soro_core.integrate.tr_bdf2 import TR_BDF2
from soro_core.integrate.tr_bdf2_linear import TR_BDF2_LINEAR
from soro_core.integrate.trapezoidal import TRAPEZOIDAL
from soro_core.model import SoftArm
from soro_core.model.checks import finite, flat_wrench, number, require, shaped
from soro_core.model.dynamics import BAD_INPUT, COLLAPSED, GOOD, NOT_CONVERGED, NOT_FINITE, SINGULAR
from soro_core.pneumatics.chamber import Gas, make_gas
from soro_core.pneumatics.valve_condition import ValveCondition
from soro_core.pneumatics.valve_model import ValveModel

Array: TypeAlias = NDArray[np.float64]
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
"""Those that gain no energy without input (ADR 0009)."""

_CAUSES = {
    NOT_FINITE: "the state is not finite, or grew beyond all bounds",
    COLLAPSED: "a link was compressed to nothing (elongation -1 or less)",
    SINGULAR: "the equations became singular",
    NOT_CONVERGED: "Newton's iteration did not converge",
    BAD_INPUT: "a pressure or wrench is not finite",
    TOO_STIFF: f"the error control asked for more than {MAX_STEPS} steps in one of length dt",
    NOT_RESOLVED: "the step is too long for what happens in it",
    CLOSED: "a chamber was closed to nothing",
}
_CURES = {
    NOT_FINITE: "use a smaller dt, or integrator='trapezoidal' or 'tr_bdf2' for stiff arms",
    COLLAPSED: "lower the load or the pressure, raise the axial stiffness, or use a smaller dt"
    " (with an explicit integrator a much smaller one, or integrator='trapezoidal')",
    SINGULAR: "use a smaller dt, and check masses and stiffnesses of the robot",
    NOT_CONVERGED: "use a smaller dt, or integrator='tr_bdf2'",
    BAD_INPUT: "check the source of the pressures",
    TOO_STIFF: "the arm is stiff: use integrator='tr_bdf2' or 'trapezoidal', or a larger rtol",
    NOT_RESOLVED: "use a smaller dt, or integrator='trapezoidal' or 'tr_bdf2' for stiff arms",
    CLOSED: "use a smaller dt, or give the chamber a larger volume_m3",
}


def describe(code: int, when: str = "") -> Status:
    """Status of a kernel's code; `when` is put between what happened and what to do."""
    if code == GOOD:
        return OK
    return Status(f"failed{when}: {_CAUSES[code]}; {_CURES[code]}")


def run_of(name: str, rtol: float | None = None, air: Air = NO_AIR, guarded: bool = True) -> Run:
    """Kernel of the stepper of that name: run(box, times, pressure, wrench, q, v, z) -> (last row, code).

    Parameters
    ----------
    name : str
        One of `STEPPERS`.
    rtol : float, optional
        Relative tolerance of one step, for steppers with error control.
    air : Gas, optional
        Air behind valves; default none.
    guarded : bool
        Whether an implicit stepper damps and divides steps that are too long for what happens in them, and a
        dissipative one takes out energy that it would gain (ADR 0009). Without, a step is one smooth map, as
        a filter that linearises it needs.

    Raises
    ------
    ModelError
        If there is no such stepper, it takes no such tolerance, or it takes no air.
    """
    if not isinstance(name, str) or name not in STEPPERS:
        raise ModelError(f"integrator {short(name)}: allowed are {', '.join(STEPPERS)}")
    scheme = _SCHEMES[name]
    if isinstance(scheme, Scheme):
        if air is not NO_AIR or not guarded:
            # What passes the valves brings energy along; and what is taken out is no smooth map.
            scheme = Scheme(*scheme)
        alone = scheme._replace(resolved=math.inf, far=math.inf)
        run: Run = partial(implicit_run, scheme if guarded else alone, air)
    elif air is not NO_AIR:
        raise ModelError(
            f"integrator {name!r} with valves: allowed are the implicit ones, {', '.join(_IMPLICIT)}"
        )
    else:
        run = partial(explicit_run, scheme if rtol is None else scheme._replace(rtol=number(rtol)))
    if rtol is not None:
        if isinstance(scheme, Scheme) or not scheme.adaptive:
            raise ModelError(
                f"rtol = {short(rtol)} with integrator {name!r}: allowed is none, its steps are dt"
            )
        if not 1e-14 <= number(rtol) <= 0.1:
            raise ModelError(f"rtol = {short(rtol)}: allowed is a number from 1e-14 to 0.1")
    return run


def internal_states(arm: SoftArm, air: Air = NO_AIR) -> int:
    """Count the states of creep and hysteresis, and with air mass and volume of each chamber."""
    return arm.n_internal + (2 * arm.n_u if isinstance(air, Gas) else 0)


def stepping(arm: SoftArm, air: Air = NO_AIR) -> Box:
    """Numbers and workspace for `run_of`; one thread at a time."""
    tables = with_air(arm.tables, arm.n_u) if isinstance(air, Gas) else arm.tables
    return make_stepping(tables, arm.n_q, internal_states(arm, air), arm.n_u)


class Stepper:
    """One integrator on one arm; use `make_stepper`."""

    def __init__(
        self, name: str, arm: SoftArm, guarded: bool = True, valves: ValveModel | None = None
    ) -> None:
        require(arm, SoftArm, "arm", "a SoftArm")
        require(valves, ValveModel | None, "valves", "a ValveModel")
        self.name = name
        self.arm = arm
        self._valves, self._guarded = valves, guarded
        self._air = air_behind(arm, valves)
        self._run = run_of(name, air=self._air, guarded=guarded)
        self._box = stepping(arm, self._air)
        self._n_internal = internal_states(arm, self._air)

    def initial_state(
        self, q: ArrayLike | None = None, qd: ArrayLike | None = None, pressure0: ArrayLike | None = None
    ) -> State:
        """Return a state with relaxed internal states; default straight and at rest.

        With valves, `pressure0` (n_u,) are the gauge pressures in the chambers [Pa], by default 0.
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
        """Gauge pressures [Pa] (n_u,) of the chambers, with valves a part of the state.

        Raises
        ------
        ModelError
            If there are no valves: the pressures are those given.
        """
        if not isinstance(self._air, Gas):
            raise ModelError("pressures of a state without valves: allowed is with, else they are given")
        pressures: Array = air_pressures(self._air, state.internal[None, self.arm.n_internal :])[0]
        return pressures

    def step(
        self,
        state: State,
        pressures: ArrayLike,
        dt: float,
        wrench: ArrayLike | None = None,
        condition: ValveCondition | None = None,
    ) -> tuple[State, Status]:
        """Advance by dt with pressures and wrench held.

        Parameters
        ----------
        state : State
        pressures : (n_u,)
            Gauge pressures [Pa], with valves their set points.
        dt : float
            [s], above 0.
        wrench : (6,) or (n_wrenches, 6), optional
            As for `SoftArm.forward_dynamics`.
        condition : ValveCondition, optional
            Of the valves, where there are some; default healthy.

        Returns
        -------
        State, Status
            On failure the state given, and a status that says why.

        Raises
        ------
        ModelError
            If a shape is wrong or dt is not above 0. Values that are not finite make a status.
        """
        arm = self.arm
        require(state, State, "state", "a State, as initial_state gives it")
        if not 0.0 < number(dt) < math.inf:
            raise ModelError(f"dt = {short(dt)} s: allowed is a number above 0")
        p = shaped(pressures, (arm.n_u,), "pressures", arm.robot.name)
        w = flat_wrench(arm.robot, wrench)
        # A run of one step: rows are before and after.
        q, v, z = np.empty((2, arm.n_q)), np.empty((2, arm.n_q)), np.empty((2, self._n_internal))
        q[0] = shaped(state.q, (arm.n_q,), "q", arm.robot.name)
        v[0] = shaped(state.qd, (arm.n_q,), "qd", arm.robot.name)
        z[0] = shaped(state.internal, (self._n_internal,), "internal", arm.robot.name)
        table = np.empty((2, 3, arm.n_u))
        table[:] = p
        _, code = self._run_with(condition)(self._box, np.array([0.0, number(dt)]), table, w, q, v, z)
        if code != GOOD:
            return state, describe(code)
        return State(q[1], v[1], z[1]), OK

    def _run_with(self, condition: ValveCondition | None) -> Run:
        if condition is None:
            return self._run
        if not (isinstance(self._air, Gas) and self._valves is not None):
            raise ModelError("a condition of valves without valves: allowed is none")
        air = make_gas(self._valves, self._air.volume, condition)
        return run_of(self.name, air=air, guarded=self._guarded)


def make_stepper(name: str, arm: SoftArm, guarded: bool = True, valves: ValveModel | None = None) -> Stepper:
    """Return the stepper of that name; `guarded` as in `run_of`, `valves` as in `simulate`.

    Raises
    ------
    ModelError
        If there is none, it takes no valves, or with valves a chamber has no volume.
    """
    return Stepper(name, arm, guarded, valves)
