"""Implicit midpoint rule: the equation of motion holds in the middle, at (q0 + q1) / 2 and (v0 + v1) / 2.

Order 2, symmetric in time and without dissipation of its own: energy stays, without a drift, where the step
resolves the fastest swing. Like the trapezoidal rule it carries on what is faster than the step, and such
steps are done by TR-BDF2.
"""

from soro_core.integrate.scheme import scheme
from soro_core.integrate.system import RESOLVED

MIDDLE = [0.5, 0.5, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.25, 0.5]
MIDPOINT = scheme(MIDDLE, start=False, resolved=RESOLVED)
