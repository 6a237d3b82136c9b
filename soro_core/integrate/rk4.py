"""Explicit Runge-Kutta of order 4: for soft arms; with a stiff one it diverges and says so.

Its step is compared with that of the explicit midpoint rule, which is among its stages: where the two do not
agree at all, the run ends.
"""

from soro_core.integrate.tableau import tableau

RK4 = tableau(
    [0.0, 1 / 2, 1 / 2, 1.0],
    [[1 / 2], [0.0, 1 / 2], [0.0, 0.0, 1.0], [1 / 6, 1 / 3, 1 / 3, 1 / 6]],
    error=[1 / 6, 1 / 3 - 1.0, 1 / 3, 1 / 6],
)
