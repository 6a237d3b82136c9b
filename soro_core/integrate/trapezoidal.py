"""Implicit trapezoidal rule: q1 = q0 + h (v0 + v1) / 2, v1 = v0 + h (a0 + a1) / 2. Order 2, the baseline.

[C22, App. C]. It carries on, undamped, what is faster than the step: from one side to the other at every
step. Steps that are too long for what happens in them are therefore done by TR-BDF2.
"""

from soro_core.integrate.scheme import scheme
from soro_core.integrate.system import RESOLVED

TRAPEZOIDAL = scheme([1.0, 1.0, 1.0, 0.0, 0.25, 0.0, 0.5, 0.0, 0.25, 0.5], resolved=RESOLVED)
