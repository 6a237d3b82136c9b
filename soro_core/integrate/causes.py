"""Messages for the codes of the steppers."""

from __future__ import annotations

import numpy as np

from soro_core.arrays import Array
from soro_core.integrate.explicit import MAX_STEPS
from soro_core.integrate.state import OK, Status
from soro_core.integrate.system import CLOSED, NOT_RESOLVED, TOO_STIFF
from soro_core.model import SoftArm
from soro_core.model.dynamics import BAD_INPUT, COLLAPSED, GOOD, NOT_CONVERGED, NOT_FINITE, SINGULAR
from soro_core.robot.coordinates import strain_fields

CAUSES = {
    NOT_FINITE: "the state is not finite, or grew beyond all bounds",
    COLLAPSED: "a link was compressed to nothing (to its least elongation or beyond)",
    SINGULAR: "the equations became singular",
    NOT_CONVERGED: "Newton's iteration did not converge",
    BAD_INPUT: "a pressure or wrench is not finite",
    TOO_STIFF: f"the error control asked for more than {MAX_STEPS} steps in one of length dt",
    NOT_RESOLVED: "the step is too long for what happens in it",
    CLOSED: "a chamber was closed to nothing",
}
_CURES = {
    NOT_FINITE: "use a smaller dt, or integrator='trapezoidal' or 'tr_bdf2' for stiff arms",
    COLLAPSED: "lower the load or the pressure, raise the axial stiffness, give the link a least_elongation"
    " towards which it stiffens, or use a smaller dt"
    " (with an explicit integrator a much smaller one, or integrator='trapezoidal')",
    SINGULAR: "use a smaller dt, and check masses and stiffnesses of the robot",
    NOT_CONVERGED: "use a smaller dt, or integrator='tr_bdf2'",
    BAD_INPUT: "check the source of the pressures",
    TOO_STIFF: "the arm is stiff: use integrator='tr_bdf2' or 'trapezoidal', or a larger rtol",
    NOT_RESOLVED: "use a smaller dt, or integrator='trapezoidal' or 'tr_bdf2' for stiff arms",
    CLOSED: "use a smaller dt, or give the chamber a larger volume_m3",
}
# What a load that no equilibrium carries may end in; a shorter step does not help then.
BY_LOAD = (COLLAPSED, NOT_CONVERGED, NOT_FINITE, NOT_RESOLVED, SINGULAR, TOO_STIFF)
# Elongation below which a link was near to being compressed to nothing before the step in which it was.
_SHORT = -0.5


def describe_at(code: int, arm: SoftArm, q: Array, when: str = "", carried: float = 1.0) -> Status:
    """Return the status of a kernel's code; of a collapse it names the link.

    Parameters
    ----------
    code : int
    arm : SoftArm
    q : (n_q,)
        Last good coordinates.
    when : str
        Time, inserted before the cause.
    carried : float
        Share of the load beyond which the arm has no equilibrium, where that is below 1.
    """
    cause, cure = CAUSES.get(code, ""), _CURES.get(code, "")
    if code == COLLAPSED:
        link, elongation = _shortest_link(arm, q)
        found = f"link{link} (elongation {elongation:.3f})"
        if elongation < _SHORT:
            when += f" in {found}"
        else:
            cause = f"the load is so large that, within one step from {found}, {cause}"
    if code in BY_LOAD and carried < 1.0:
        cause += f": there is no equilibrium beyond {carried:.2%} of this load (weight, pressures, wrenches)"
        cure = "lower the load or the pressure, or stiffen the arm"
    return OK if code == GOOD else Status(f"failed{when}: {cause}; {cure}")


def _shortest_link(arm: SoftArm, q: Array) -> tuple[int, float]:
    """Return which link is compressed the most, and its mean elongation."""
    fields = strain_fields(arm.robot)
    links = [i for i in range(len(arm.robot.links)) if fields.of("elongation", i).any()]
    means = [(fields.of("elongation", i) * fields.mean) @ q for i in links]
    least = int(np.argmin(means))
    return links[least], float(means[least])
