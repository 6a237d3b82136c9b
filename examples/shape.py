"""Shape of an arm: backbone, frames and Jacobian in any coordinates. Needs no ROS.

python examples/shape.py
"""

import numpy as np

from soro_core import SoftArm, load_robot

arm = SoftArm(load_robot("asu_two_segment"))
print(arm.robot.coordinate_names)
q = np.zeros(arm.n_q)
q[1], q[5] = 6.0, -8.0  # bending_x of link 0 and bending_y of link 1 [1/m]
for x, y, z in 1e3 * arm.backbone(q, n=5):
    print(f"x {x:7.2f}  y {y:7.2f}  z {z:7.2f} mm")
pose = arm.pose(q, arm.length)
print("axes of the tip in the world:\n", np.round(pose[:3, :3], 3))
# Body Jacobian, rows (angular, linear): the velocity of the tip if the elongation of link 0 grows by 0.1/s.
rates = 0.1 * np.eye(arm.n_q)[0]
print(
    "velocity of the tip [mm/s]:", np.round(1e3 * pose[:3, :3] @ arm.jacobian(q, arm.length)[3:] @ rates, 2)
)
# Many coordinates at once: the way of the tip while link 0 bends further.
more = q + np.linspace(0.0, 4.0, 5)[:, None] * np.eye(arm.n_q)[1]
print("tip x [mm]:", np.round(1e3 * arm.poses(more, arm.length)[:, 0, 3], 2))
