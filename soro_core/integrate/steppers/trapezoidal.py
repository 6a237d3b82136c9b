"""Implicit trapezoidal rule: q1 = q0 + h (v0 + v1) / 2, v1 = v0 + h (a0 + a1) / 2. Order 2, the baseline.

It does not damp motion faster than the step, which then alternates from step to step. TR-BDF2 therefore
replaces it for steps that do not resolve the motion.
"""

from soro_core.integrate.steppers import tr_bdf2
from soro_core.integrate.steppers.scheme import Stage, scheme

STAGE = Stage(place=1.0, span=1.0, q_v0=1.0, q_a0=0.25, v_a0=0.5, c_q=0.25, c_v=0.5)
TRAPEZOIDAL = scheme(STAGE, fallback=tr_bdf2.STAGES)
