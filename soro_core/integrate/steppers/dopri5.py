"""Dormand and Prince's pair of orders 5 and 4 with error control inside each step: for soft arms.

Results are on the grid of the caller's steps; inside each, the stepper takes as many steps as the tolerance
requires [DP80]. For a stiff arm their number exceeds the limit, which ends the run with a status.
"""

from soro_core.integrate.steppers.tableau import tableau

RTOL = 1e-6

_new = [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84]

DOPRI5 = tableau(
    [0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0],
    [
        [1 / 5],
        [3 / 40, 9 / 40],
        [44 / 45, -56 / 15, 32 / 9],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656],
        _new,
        _new,
    ],
    # Weights of order 5 minus those of order 4.
    error=[71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40],
    rtol=RTOL,
)
