"""An arm with far more damping than its file says, in closed loop."""

import numpy as np
import pytest
from loop_harness import Setup, run

from soro_core import SoftArm, load_robot
from soro_core.config import find_config, parse
from soro_core.control import ControllerConfig
from soro_core.robot.parts import fields

HANGING = load_robot(find_config("three_bellow_hanging", "robots"))
CIRCLE = {"curvature_per_m": 7.0, "mean_pressure_pa": 30e3}
MORE_S = 0.2


@pytest.mark.slow
def test_an_arm_with_four_hundred_times_the_damping_of_its_file_is_tracked():
    more = MORE_S * np.diag(SoftArm(HANGING).stiffness_matrix(np.zeros(3)))
    link = fields(HANGING.links[0])
    plant = HANGING.replace(links=[link | {"damping": tuple(np.add(link["damping"], more))}])
    assert plant.links[0].damping[1] > 400 * link["damping"][1]
    control = parse({"law": "composite", "reference": CIRCLE}, ControllerConfig, "test")
    record = run(HANGING, Setup(plant=plant, payload_kg=0.0, control=control, duration_s=8.0))
    found = record.estimates[-1][record.names.index("link0/bend_damping")]
    print(f"RMS {100 * record.rms(4.0) / HANGING.length:.2f} % of the length, {found:.3f} s found")
    assert record.rms(4.0) < 0.012 * HANGING.length
    assert found == pytest.approx(MORE_S, rel=0.25)
