"""An arm that is let go: bend it, release it, and see it swing. Needs no ROS.

python examples/free_swing.py
"""

import numpy as np

from soro_core import SoftArm, load_robot, simulate

arm = SoftArm(load_robot("tue_three_bellow"))
print(arm.robot.coordinate_names)
released = simulate(arm, q0=[0.0, 8.0, 0.0], qd0=np.zeros(3), t_end=1.0, dt=2e-3)
assert released.status.ok, released.status
tip_mm = 1e3 * np.array([arm.pose(q, arm.length)[:3, 3] for q in released.q])
for k in range(0, len(released.t), 25):
    print(f"{released.t[k]:.1f} s  tip at x {tip_mm[k, 0]:6.2f} mm, z {tip_mm[k, 2]:6.2f} mm")
