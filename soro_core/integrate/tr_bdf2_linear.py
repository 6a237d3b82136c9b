"""Linearly-implicit TR-BDF2: one evaluation of the forces and one factorisation in each of its two stages.

To TR-BDF2 what `midpoint_linear` is to the midpoint rule, and of order 2 for the same reason: half the cost,
as robust where the arm is stiff.
"""

from soro_core.integrate.scheme import DAMPED, scheme

TR_BDF2_LINEAR = scheme(*DAMPED, linear=True, dissipative=True)
