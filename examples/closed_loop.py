"""A scene without ROS: twin, estimator and controller in one loop of Python, in lockstep.

python examples/closed_loop.py [SECONDS]
"""

import sys

import numpy as np

from soro_core.twin import Twin
from soro_lab.scene import load_scene
from soro_lab.scene.loop import loop_of

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 4.0
# Without a platform the twin has the regulators in it, and nothing else stands between command and air.
scene = load_scene("track_circle", {"platform": "", "twin.payload_kg": 0.01})
loop, twin = loop_of(scene), Twin(scene.loaded_robot, scene.twin_node())
ticks = round(seconds * scene.rate_hz)
for k, tick in enumerate(loop.run(twin, ticks, 1.0 / scene.rate_hz)):
    if k % 100 == 99:
        error_mm = 1e3 * np.linalg.norm(tick.seen.tip[:3, 3] - tick.command.tip_reference[:3, 3])
        pressures = ", ".join(f"{p:.1f}" for p in 1e-3 * tick.command.setpoint_pa)
        print(f"{tick.t_s:.2f} s  tip error {error_mm:5.2f} mm, set points {pressures} kPa")
