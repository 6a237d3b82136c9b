"""Loops whose valves are later than their platform says: they swing until the feedback is lowered."""

import numpy as np
import pytest
from loop_harness import Setup, run

from soro_core import load_robot
from soro_core.config import find_config, parse
from soro_core.control import Controller, ControllerConfig
from soro_core.pneumatics import RegulatorModel

STANDING = load_robot(find_config("tue_three_bellow", "robots"))
HANGING = load_robot(find_config("three_bellow_hanging", "robots"))
CIRCLE = {"curvature_per_m": 7.0, "mean_pressure_pa": 40e3}


def tracked(robot, law, factor, payload_kg, duration_s=8.0, **reference):
    """Run with gains of this factor on the automatic ones, behind valves with a dead time of 100 ms."""
    keys = {"law": law, "reference": reference}
    gains = Controller(robot, parse(keys, ControllerConfig, "test")).gains
    stated = {
        "k_p": (factor * np.diag(gains.k_p)).tolist(),
        "k_d": (factor * np.diag(gains.k_d)).tolist(),
        "lambda_per_s": gains.rate.tolist(),
    }
    control = parse({**keys, "gains": stated}, ControllerConfig, "test")
    late = RegulatorModel(delay_s=0.1)
    setup = Setup(control=control, regulator=late, payload_kg=payload_kg, duration_s=duration_s)
    return run(robot, setup)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "law", "factor", "payload_kg", "reference", "most"),
    [
        # Without lowering: 20 %, 22 % and, of a lost arm, 68 % of the length.
        (STANDING, "composite", 1.0, 0.02, {}, 0.03),
        (HANGING, "composite", 4.0, 0.02, CIRCLE, 0.04),
        (STANDING, "adaptive", 4.0, 0.02, {}, 0.08),
    ],
)
def test_a_loop_that_swings_behind_late_valves_is_named_and_calmed(
    robot, law, factor, payload_kg, reference, most
):
    record = tracked(robot, law, factor, payload_kg, **reference)
    named = [(t, said) for t, said in zip(record.t, record.statuses, strict=True) if "limit cycle at" in said]
    print(
        f"RMS {100 * record.rms(3.0) / robot.length:.2f} %, {record.command_rate(3.0):.0f} Pa/s; {named[:1]}"
    )
    assert named[0][0] < 2.0
    assert "lowered to" in record.statuses[-1]
    assert record.rms(3.0) < most * robot.length


@pytest.mark.slow
@pytest.mark.parametrize("law", ["composite", "adaptive"])
def test_a_step_of_the_load_is_no_limit_cycle(law):
    control = parse({"law": law}, ControllerConfig, "test")
    record = run(STANDING, Setup(control=control, load_steps=((5.0, 0.0),), duration_s=8.0))
    assert not any("limit cycle" in said for said in record.statuses)
