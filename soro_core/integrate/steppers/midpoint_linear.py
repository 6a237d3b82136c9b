"""Linearly-implicit midpoint rule: one evaluation of the forces and one factorisation a step.

One Newton iteration of the implicit midpoint rule, about the middle that the accelerations k of the two
steps before predict, 2 k' - k''. The prediction is off by O(h^2), the Jacobian of the equation of motion by
O(h) (it holds M, R and d2U_e/dq2 in full, the derivatives of M, C and G not at all), so the acceleration by
O(h^3): order 2 for any such Jacobian. The linear part is solved exactly, however stiff. The first two steps
have no prediction and take two iterations; so does a step whose first iteration moved the arm far.
"""

from soro_core.integrate.steppers import tr_bdf2
from soro_core.integrate.steppers.midpoint import STAGE
from soro_core.integrate.steppers.scheme import scheme

MIDPOINT_LINEAR = scheme(STAGE, fallback=tr_bdf2.STAGES, start=False, linear=True)
