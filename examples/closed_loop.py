"""A robot and a law of your own in a closed loop, no file, no ROS: closed_loop.py [SECONDS [PICTURE.png]]."""

import math
import sys

import matplotlib.pyplot as plt
import numpy as np

from soro_core import Law, Loop, robot_from_dict
from soro_core.control import Controller, ControllerConfig
from soro_core.estimation import Estimator
from soro_core.twin import Twin

chambers = [{"angle_rad": 2.0 * math.pi * k / 3, "area_m2": 8e-5, "offset_m": 9e-3} for k in range(3)]
link = {"length": 0.1, "radius": 0.015, "density": 1070.0, "chambers": chambers}
link["material"] = {"youngs_modulus": 120e3, "shear_modulus": 40e3, "viscosity": 1000.0}


class Spring(Law[None]):  # docs/adding_a_law.md
    def initial_state(self):
        return None  # it remembers nothing

    def step(self, state, belief, reference, dt):
        q_d, arm = reference.ahead.q, self.setting.arm
        model = arm.gravity_force(q_d) + arm.elastic_force(q_d)
        spring = -0.5 * np.diag(arm.stiffness_matrix(q_d)) * (belief.q - q_d)
        return state, model + spring, {"model": model, "spring": spring}


robot = robot_from_dict({"name": "mine", "links": [link]})
control = ControllerConfig(law=Spring, reference={"kind": "circle", "curvature_per_m": 4.0})
loop, twin = Loop(Estimator(robot), Controller(robot, control)), Twin(robot)
ticks = list(loop.run(twin, round(float((*sys.argv, 4)[1]) / twin.dt), twin.dt, before_s=-twin.dt))
error_mm = [1e3 * np.linalg.norm((tick.seen.tip - tick.command.tip_reference)[:3, 3]) for tick in ticks]
for tick, error in list(zip(ticks, error_mm, strict=True))[99::100]:
    pressures = ", ".join(f"{1e-3 * p:.1f}" for p in tick.command.setpoint_pa)
    print(f"{tick.t_s:.2f} s  tip error {error:5.2f} mm, set points {pressures} kPa")
if len(sys.argv) > 2:
    plt.plot([tick.t_s for tick in ticks], error_mm)
    plt.savefig(sys.argv[2])
