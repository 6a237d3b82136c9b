"""Arms whose pressures make another force than their file says, in closed loop."""

import re

import numpy as np
import pytest
from loop_harness import Setup, run

from soro_core import load_robot
from soro_core.config import find_config, parse
from soro_core.control import ControllerConfig
from soro_core.robot.parts import fields

HANGING = load_robot(find_config("three_bellow_hanging", "robots"))
CIRCLE = {"curvature_per_m": 7.0, "mean_pressure_pa": 30e3}


def tracked(change, duration_s=10.0):
    """Run on a plant whose chambers have other keys."""
    link = fields(HANGING.links[0])
    chambers = [fields(chamber) | change(i, chamber) for i, chamber in enumerate(HANGING.links[0].chambers)]
    plant = HANGING.replace(links=[link | {"chambers": chambers}])
    control = parse({"law": "composite", "reference": CIRCLE}, ControllerConfig, "test")
    return run(HANGING, Setup(plant=plant, payload_kg=0.0, control=control, duration_s=duration_s))


def weak(i, chamber):
    part = 0.6 if i == 1 else 1.0
    return {"alpha_eps": part * chamber.alpha_eps, "alpha_kappa": part * chamber.alpha_kappa}


@pytest.mark.slow
def test_a_weak_chamber_is_tracked_and_named_within_five_seconds():
    record = tracked(weak)
    named = [(t, said) for t, said in zip(record.t, record.statuses, strict=True) if "gives" in said]
    print(f"RMS {100 * record.rms(4.0) / HANGING.length:.2f} % of the length; {named[0]}, {named[-1]}")
    assert record.rms(4.0) < 0.005 * HANGING.length
    assert named[0][0] < 5.0
    assert all(set(re.findall("chamber[0-9]", said)) == {"chamber1"} for _, said in named)
    assert float(re.search(r"gives ([0-9.]+) of", named[-1][1])[1]) == pytest.approx(0.6, abs=0.05)


@pytest.mark.slow
def test_another_area_slope_is_tracked_and_no_chamber_named():
    record = tracked(lambda i, chamber: {"area_slope": -2.0})
    print(f"RMS {100 * record.rms(4.0) / HANGING.length:.2f} % of the length")
    assert record.rms(4.0) < 0.01 * HANGING.length
    assert not any("gives" in said for said in record.statuses)
    assert np.isfinite(record.estimates).all()
