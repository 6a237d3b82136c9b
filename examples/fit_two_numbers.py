"""Stiffness and load of an arm from its swing: least squares on two numbers. Needs no ROS.

python examples/fit_two_numbers.py
"""

import numpy as np

from soro_core import SoftArm, load_robot, simulate
from soro_lab.identification import Parameter, fit

guess = load_robot("tue_three_bellow")


def swing(values):
    """Return the positions of the tip (n, 3) [m] of an arm that is released at a curvature of 8 1/m."""
    changes = {"links[0].k_b[0]": values["stiffness"], "tip_mass": values["load"]}
    return simulate(SoftArm(guess.with_(changes)), q0=[0.0, 8.0, 0.0], t_end=0.5, dt=5e-3).tip


k_b = guess.links[0].k_b[0]
# In the place of a recording: the same arm with other numbers, and 0.1 mm of noise.
true = {"stiffness": 1.3 * k_b, "load": 5e-3}
measured = swing(true) + 1e-4 * np.random.default_rng(1).normal(size=(101, 3))

found = fit(
    [Parameter("stiffness", k_b, lower=0.1 * k_b), Parameter("load", 0.0, lower=0.0, scale=1e-3)],
    lambda values: ((swing(values) - measured) / 1e-4).ravel(),
)
for name, value in found.values.items():
    print(f"{name}: {value:.4g} +- {found.deviations[name]:.1g}, true {true[name]:.4g}")
