"""An arm of your own without a file: describe it, change one number, keep it. Needs no ROS.

python examples/own_arm.py [FILE.yaml]
"""

import math
import sys

from soro_core import SoftArm, load_robot, robot_from_dict, save_robot

# Each key has its line in soro_core/robot/description.py and link.py; what is left out has a default.
link = {
    "length": 0.12,  # m
    "radius": 0.015,  # m
    "density": 1070.0,  # kg/m^3, or mass in kg
    "material": {"youngs_modulus": 180e3, "shear_modulus": 60e3, "viscosity": 100.0},  # Pa, Pa, Pa s
    "chambers": [{"angle_rad": 2.0 * math.pi * k / 3, "area_m2": 5e-5, "offset_m": 8e-3} for k in range(3)],
}
# x, y, z, w: the arm hangs down; without it, it stands, and one that is long and soft falls over.
robot = robot_from_dict({"name": "mine", "links": [link, link], "base_quaternion": [1.0, 0.0, 0.0, 0.0]})
print(robot)
print(robot.coordinate_names, robot.chamber_names)
softer = robot.with_({"links[1].material.youngs_modulus": 90e3, "tip_mass": 5e-3})
stiffness = [SoftArm(one).stiffness_matrix([0.0] * 6)[4, 4] for one in (robot, softer)]
print(f"stiffness of bending_x of the second link: {stiffness[0]:.2e} and {stiffness[1]:.2e} N m^3")

if len(sys.argv) > 1:
    save_robot(softer, sys.argv[1])
    print(f"read again: {load_robot(sys.argv[1]) == softer}")
