"""A thousand arms that differ as made ones do, on all cores. Needs no ROS.

python examples/thousand_variations.py [NUMBER]
"""

import sys

import numpy as np
from rich.progress import Progress

from soro_core import load_robot, simulate_many

number = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
robot, rng = load_robot("tue_three_bellow"), np.random.default_rng(1)
factors = rng.normal(1.0, 0.05, size=(number, 2))
robots = [
    robot.with_({"links[0].k_b[0]": k * robot.links[0].k_b[0], "links[0].mass": m * robot.links[0].mass})
    for k, m in factors
]
with Progress() as bar:
    task = bar.add_task("simulate")
    runs = simulate_many(
        robots,
        pressure=[20e3, 0.0, 0.0],
        t_end=1.0,
        progress=lambda done, of: bar.update(task, completed=done, total=of),
    )
tip_mm = 1e3 * runs.tip[runs.ok, -1]  # runs.tip is (number, n_t, 3)
print(f"{runs.ok.sum()} of {number} runs are ok")
print(f"tip x {tip_mm[:, 0].mean():.2f} mm, standard deviation {tip_mm[:, 0].std():.2f} mm")
print(f"correlation with the stiffness: {np.corrcoef(factors[runs.ok, 0], tip_mm[:, 0])[0, 1]:.2f}")
