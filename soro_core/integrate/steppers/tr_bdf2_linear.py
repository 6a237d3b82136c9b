"""Linearly-implicit TR-BDF2: one evaluation of the forces and one factorisation in each of its two stages.

One Newton iteration of TR-BDF2 for each stage, of order 2 for the same reason as `midpoint_linear`: half the
cost, and as robust for stiff arms.
"""

from soro_core.integrate.steppers.scheme import scheme
from soro_core.integrate.steppers.tr_bdf2 import STAGES

TR_BDF2_LINEAR = scheme(*STAGES, linear=True, dissipative=True)
