"""An arm softer than its model, with a load: the default law learns them; another_truth.py [SECONDS]."""

import sys

import numpy as np

from soro_core import Loop, load_robot
from soro_core.control import Controller, ControllerConfig
from soro_core.estimation import Estimator
from soro_core.twin import Twin

known = load_robot("tue_three_bellow")  # what estimator and controller are told
truth = known.scaled(stiffness=0.9).with_({"tip_mass": known.tip_mass + 0.01})  # 10 g more
circle = ControllerConfig(reference={"kind": "circle", "curvature_per_m": 6.0})

loop, twin = Loop(Estimator(known), Controller(known, circle)), Twin(truth)
ticks = list(loop.run(twin, round(float((*sys.argv, 6)[1]) / twin.dt), twin.dt, before_s=-twin.dt))
for tick in ticks[249::250]:
    error_mm = 1e3 * np.linalg.norm((tick.seen.tip - tick.command.tip_reference)[:3, 3])
    print(f"tip error {error_mm:5.2f} mm, {tick}")
