"""The estimator on a CSV of pressures and tracked poses. Needs no ROS.

python examples/estimator_on_csv.py [FILE.csv]     # t [s], pressures [Pa], x, y, z [m], qx, qy, qz, qw
"""

import sys

import numpy as np

from soro_core import SoftArm, load_robot, simulate
from soro_core.estimation import Estimator, PoseSample
from soro_core.rotation import quaternion_from_matrix

robot = load_robot("tue_three_bellow")
arm = SoftArm(robot)
if len(sys.argv) > 1:
    table = np.loadtxt(sys.argv[1], delimiter=",", skiprows=1)
else:  # in the place of a recording: the arm under 20 kPa, its tip with 0.3 mm of noise
    made = simulate(arm, pressure=lambda t: [20e3 * min(t, 1.0), 0.0, 0.0], t_end=2.0, dt=0.005)
    turns = [quaternion_from_matrix(pose[:3, :3]) for pose in arm.poses(made.q, arm.length)]
    noisy = made.tip + 3e-4 * np.random.default_rng(1).normal(size=made.tip.shape)
    table = np.column_stack([made.t, made.pressure, noisy, turns])

dt = float(np.median(np.diff(table[:, 0])))
estimator = Estimator(robot, dt=dt)
state = estimator.initial_state(t_s=table[0, 0] - dt)
for k, (t, *row) in enumerate(table):
    pressure, place, turn = np.split(np.array(row), [3, 6])
    state, estimate = estimator.step(state, pressure, [PoseSample(t, place, turn, arm.length)], [], dt)
    if k % 80 == 0:
        deviation = np.sqrt(np.diag(estimate.covariance)[: arm.n_q])
        said = estimate.status.message or "ok"
        print(f"{t:.2f} s  q {np.round(estimate.q, 3)} +- {np.round(deviation, 3)}, {said}")
if len(sys.argv) == 1:
    off = 1e3 * np.linalg.norm(arm.pose(estimate.q, arm.length)[:3, 3] - made.tip[-1])
    print(f"the tip is {off:.2f} mm off, its measurements 0.3 mm an axis")
