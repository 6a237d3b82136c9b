"""TR-BDF2: trapezoidal rule to a point inside the step, then BDF2. Order 2, L-stable, for the very stiff.

As a diagonally implicit Runge-Kutta method: stages at 0, 2 d and 1, both implicit ones with the coefficient
d = 1 - sqrt(2) / 2, weights w = sqrt(2) / 4, w, d; the last stage is the new state [Bank et al. 1985;
Hosea and Shampine 1996]. What is much faster than the step is gone after it.
"""

from soro_core.integrate.scheme import DAMPED, scheme

TR_BDF2 = scheme(*DAMPED, dissipative=True)
