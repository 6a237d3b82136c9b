"""Steppers: one step of an arm in time, state in, state and status out."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soro_core.errors import ModelError
from soro_core.integrate.rk4 import rk4_run
from soro_core.integrate.state import OK, State, Status
from soro_core.integrate.trapezoidal import trapezoidal_run
from soro_core.model import SoftArm
from soro_core.model.dynamics import BAD_INPUT, COLLAPSED, GOOD, NOT_CONVERGED, NOT_FINITE, SINGULAR
from soro_core.model.entries import make_box

Array: TypeAlias = NDArray[np.float64]
Run: TypeAlias = Callable[..., tuple[int, int]]

RUNS: dict[str, Run] = {"trapezoidal": trapezoidal_run, "rk4": rk4_run}
STEPPERS = tuple(RUNS)

_CAUSES = {
    NOT_FINITE: "the state grew beyond all bounds",
    COLLAPSED: "a link was compressed to nothing (elongation -1 or less)",
    SINGULAR: "the equations became singular",
    NOT_CONVERGED: "Newton's iteration did not converge",
    BAD_INPUT: "a pressure or wrench is not finite",
}
_CURES = {
    NOT_FINITE: "use a smaller dt, or integrator='trapezoidal' for stiff arms",
    COLLAPSED: "lower the load or the pressure, raise the axial stiffness, or use a smaller dt",
    SINGULAR: "use a smaller dt, and check masses and stiffnesses of the robot",
    NOT_CONVERGED: "use a smaller dt",
    BAD_INPUT: "check the source of the pressures",
}


def describe(code: int, when: str = "") -> Status:
    """Status of a kernel's code; `when` is put between what happened and what to do."""
    if code == GOOD:
        return OK
    return Status(f"failed{when}: {_CAUSES[code]}; {_CURES[code]}")


class Stepper:
    """One integrator on one arm; use `make_stepper`."""

    def __init__(self, name: str, arm: SoftArm) -> None:
        self.name = name
        self.arm = arm
        self._run = RUNS[name]
        self._boxes = make_box(arm.tables), make_box(arm.tables)
        self._no_wrench = np.zeros(6)

    def initial_state(self, q: ArrayLike | None = None, qd: ArrayLike | None = None) -> State:
        """Return a state with relaxed internal states; default straight and at rest."""
        n = self.arm.n_q
        return State(
            np.zeros(n) if q is None else _shaped(q, n, "q"),
            np.zeros(n) if qd is None else _shaped(qd, n, "qd"),
            np.zeros(self.arm.n_internal),
        )

    def step(
        self, state: State, pressures: ArrayLike, dt: float, wrench: ArrayLike | None = None
    ) -> tuple[State, Status]:
        """Advance by dt with pressures and wrench held.

        Parameters
        ----------
        state : State
        pressures : (n_u,)
            Gauge pressures [Pa].
        dt : float
            [s], above 0.
        wrench : (6,), optional
            At the tip, in its body frame: torque [N m], force [N].

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
        if not 0.0 < dt < float("inf"):
            raise ModelError(f"dt = {dt!r} s: allowed is a number above 0")
        p = _shaped(pressures, arm.n_u, "pressures")
        w = self._no_wrench if wrench is None else _shaped(wrench, 6, "wrench")
        # A run of one step: rows are before and after.
        q, v, z = np.empty((2, arm.n_q)), np.empty((2, arm.n_q)), np.empty((2, arm.n_internal))
        q[0] = _shaped(state.q, arm.n_q, "q")
        v[0] = _shaped(state.qd, arm.n_q, "qd")
        z[0] = _shaped(state.internal, arm.n_internal, "internal")
        table = np.empty((2, 3, arm.n_u))
        table[:] = p
        _, code = self._run(*self._boxes, np.array([0.0, dt]), table, w, q, v, z)
        if code != GOOD:
            return state, describe(code)
        return State(q[1], v[1], z[1]), OK


def make_stepper(name: str, arm: SoftArm) -> Stepper:
    """Return the stepper of that name.

    Raises
    ------
    ModelError
        If there is none.
    """
    if name not in RUNS:
        raise ModelError(f"integrator {name!r}: allowed are {', '.join(STEPPERS)}")
    return Stepper(name, arm)


def _shaped(values: ArrayLike, n: int, name: str) -> Array:
    array = np.array(values, dtype=np.float64)
    if array.shape != (n,):
        raise ModelError(f"{name} has shape {array.shape}, allowed is ({n},)")
    return array
