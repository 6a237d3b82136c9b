"""An arm under pressures that change: a function of time, and a series that was recorded. Needs no ROS.

python examples/pressures_over_time.py [PICTURE.png]
"""

import sys

import numpy as np

from soro_core import SoftArm, load_robot, simulate

arm = SoftArm(load_robot("tue_three_bellow"))


def waves(t):
    """Three chambers in turns [Pa gauge]."""
    return 10e3 * (1.0 + np.sin(2.0 * np.pi * t - np.array([0.0, 2.0, 4.0]) * np.pi / 3.0))


result = simulate(arm, pressure=waves, t_end=2.0)
print(result)
print("tip of the last second [mm]:", np.round(1e3 * np.ptp(result.tip[500:], axis=0), 1))

# Rows as a logger writes them: time [s], then pressures [kPa]; for a file, np.loadtxt(name, delimiter=",").
recorded = np.array(
    [[0.0, 0.0, 0.0, 0.0], [0.5, 20.0, 0.0, 0.0], [1.5, 20.0, 15.0, 0.0], [2.0, 0.0, 0.0, 0.0]]
)
again = simulate(
    arm,
    pressure=lambda t: [1e3 * np.interp(t, recorded[:, 0], column) for column in recorded[:, 1:].T],
    t_end=3.0,
)
print("tip at the end [mm]:", np.round(1e3 * again.tip[-1], 1))
if len(sys.argv) > 1:
    result.plot().savefig(sys.argv[1])
