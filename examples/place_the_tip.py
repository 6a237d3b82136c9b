"""Where the tip can be, and the coordinates that bring it to a place. Needs no ROS.

python examples/place_the_tip.py
"""

import numpy as np

from soro_core import SoftArm, inverse_kinematics, load_robot, reachable

arm = SoftArm(load_robot("tue_three_bellow"))
for x_mm in (5.0, 15.0, 200.0):
    found = inverse_kinematics(arm, [1e-3 * x_mm, 0.0, 0.064])
    missed = f"missed by {1e3 * found.position_error_m:.3f} mm"
    print(f"x {x_mm:5.1f} mm: q {np.round(found.q, 3)}, {missed} after {found.iterations} iterations")
# Coordinates that pressures of the robot's range can hold at rest are fewer:
places = reachable(arm)
for name, value in places.numbers():
    print(f"{name}: {value}")
nearest = np.argmin(np.linalg.norm(places.tip_m - [0.01, 0.0, 0.07], axis=1))
print(f"nearest to (10, 0, 70) mm: {np.round(1e3 * places.tip_m[nearest], 1)} mm", end=" ")
print(f"under {np.round(1e-3 * places.pressure_pa[nearest], 1)} kPa")
