"""A law of your own in the loop of twin, estimator and controller: lockstep, in one process. Needs no ROS.

python examples/closed_loop.py [SECONDS [PICTURE.png]]
"""

import sys
from pathlib import Path

import numpy as np

from soro_core.twin import Twin
from soro_lab.scene import load_scene
from soro_lab.scene.loop import loop_of

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 4.0
# Without a platform the twin has the regulators in it, and nothing else stands between command and air.
law = f"{Path(__file__).with_name('spring_law.py')}:Spring"  # docs/adding_a_law.md; or composite, ...
scene = load_scene("track_circle", {"platform": "", "twin.payload_kg": 0.0, "controller.law": law})
loop, twin = loop_of(scene), Twin(scene.loaded_robot, scene.twin_node())
rows = []
for k, tick in enumerate(loop.run(twin, round(seconds * scene.rate_hz), 1.0 / scene.rate_hz)):
    error_mm = 1e3 * np.linalg.norm(tick.seen.tip[:3, 3] - tick.command.tip_reference[:3, 3])
    rows.append([tick.t_s, error_mm, *(1e-3 * tick.command.setpoint_pa)])
    if k % 100 == 99:
        pressures = ", ".join(f"{p:.1f}" for p in rows[-1][2:])
        print(f"{tick.t_s:.2f} s  tip error {error_mm:5.2f} mm, set points {pressures} kPa")
if len(sys.argv) > 2:
    from matplotlib.figure import Figure

    figure, table = Figure(layout="constrained"), np.array(rows)
    for axes, label, columns in zip(
        figure.subplots(2), ("tip error, mm", "set points, kPa"), (slice(1, 2), slice(2, None)), strict=True
    ):
        axes.plot(table[:, 0], table[:, columns])
        axes.set(xlabel="time, s", ylabel=label)
    figure.savefig(sys.argv[2])
