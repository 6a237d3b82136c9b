"""Explicit Runge-Kutta method of order 4, for soft arms; with a stiff arm it diverges and ends with a status.

Each step is compared with that of the explicit midpoint rule, which is among its stages; a large difference
ends the run.
"""

from soro_core.integrate.steppers.tableau import tableau

RK4 = tableau(
    [0.0, 1 / 2, 1 / 2, 1.0],
    [[1 / 2], [0.0, 1 / 2], [0.0, 0.0, 1.0], [1 / 6, 1 / 3, 1 / 3, 1 / 6]],
    error=[1 / 6, 1 / 3 - 1.0, 1 / 3, 1 / 6],
)
