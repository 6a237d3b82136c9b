"""Implicit midpoint rule: the equation of motion holds in the middle, at (q0 + q1) / 2 and (v0 + v1) / 2.

Order 2, symmetric in time and without numerical dissipation: the energy does not drift if the step resolves
the fastest oscillation. Like the trapezoidal rule it does not damp motion faster than the step; TR-BDF2
replaces it for such steps.
"""

from soro_core.integrate.steppers import tr_bdf2
from soro_core.integrate.steppers.scheme import Stage, scheme

STAGE = Stage(place=0.5, span=0.5, q_v0=0.5, c_q=0.25, c_v=0.5)
MIDPOINT = scheme(STAGE, fallback=tr_bdf2.STAGES, start=False)
