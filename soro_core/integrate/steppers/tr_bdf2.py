"""TR-BDF2: trapezoidal rule to a point inside the step, then BDF2. Order 2, L-stable, for the very stiff.

As a diagonally implicit Runge-Kutta method: stages at 0, 2 d and 1, both implicit ones with the coefficient
d = 1 - sqrt(2) / 2, weights w = sqrt(2) / 4, w, d; the last stage is the new state [B85, HS96]. Motion
much faster than the step decays within it.
"""

import math

from soro_core.integrate.steppers.scheme import Stage, scheme

_d = 1.0 - math.sqrt(2.0) / 2.0
_w = math.sqrt(2.0) / 4.0
STAGES = (
    Stage(place=2.0 * _d, span=2.0 * _d, q_v0=2.0 * _d, q_a0=_d * _d, v_a0=_d, c_q=_d * _d, c_v=_d),
    Stage(
        place=1.0,
        span=1.0 - 2.0 * _d,
        q_v0=_w + _d,
        q_v=_w,
        q_a0=_d * _w,
        q_a=_d * _w,
        v_a0=_w,
        v_a=_w,
        c_q=_d * _d,
        c_v=_d,
    ),
)
TR_BDF2 = scheme(*STAGES, dissipative=True)
