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
STANDING = load_robot(find_config("tue_three_bellow", "robots"))
CIRCLE = {"curvature_per_m": 7.0, "mean_pressure_pa": 30e3}


def with_chambers(robot, change):
    """The robot with other keys of its chambers."""
    link = robot.links[0]
    chambers = [fields(chamber) | change(i, chamber) for i, chamber in enumerate(link.chambers)]
    return robot.replace(links=[fields(link) | {"chambers": chambers}])


def tracked(change, robot=HANGING, duration_s=10.0, **keys):
    """Run on a plant whose chambers have other keys."""
    plant = with_chambers(robot, change)
    control = parse({"law": "composite", "reference": {**CIRCLE, **keys}}, ControllerConfig, "test")
    return run(robot, Setup(plant=plant, payload_kg=0.0, control=control, duration_s=duration_s))


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
@pytest.mark.parametrize("learned", [True, False])
def test_a_circle_that_a_weak_chamber_cannot_hold_is_chosen_anew_and_said_where_it_may(learned):
    record = tracked(weak, mean_pressure_pa=40e3, learned_elongation=learned)
    print(f"RMS {100 * record.rms(4.0) / HANGING.length:.2f} % of the length; {record.statuses[-1]}")
    assert any("chamber1 needs" in said for said in record.statuses)
    assert (record.rms(4.0) < 0.005 * HANGING.length) == learned
    assert ("the circle has the elongation" in record.statuses[-1]) == learned


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "slope"), [(HANGING, -2.0), (HANGING, 0.0), (STANDING, -2.0)])
def test_another_area_slope_is_tracked_and_no_chamber_named(robot, slope):
    """On the standing arm evidence for the slope takes 5.5 s (ADR 0088)."""
    record = tracked(lambda i, chamber: {"area_slope": slope}, robot, duration_s=12.0)
    print(f"RMS {100 * record.rms(4.0) / HANGING.length:.2f} % of the length")
    assert record.rms(4.0) < 0.007 * HANGING.length
    assert not any("gives" in said for said in record.statuses)
    assert np.isfinite(record.estimates).all()


PROBE_S, LAW_S = 7.3, 2.0


def probed(change):
    """Probe and drive the standing arm: first error of the law by the length, and gains it begins with."""
    reference = {"curvature_per_m": 6.0, "mean_pressure_pa": 30e3}
    keys = {"law": "composite", "reference": reference, "probe_at_enable": "warn"}
    control, plant = parse(keys, ControllerConfig, "test"), with_chambers(STANDING, change)
    setup = Setup(plant=plant, payload_kg=0.0, control=control, duration_s=PROBE_S + LAW_S, refine=2)
    record = run(STANDING, setup)
    first = next(k for k, said in enumerate(record.statuses) if not said.startswith("probing")) + 1
    error = np.sqrt(np.mean(record.error()[first:] ** 2)) / STANDING.length
    gains = record.estimates[first, [record.names.index(f"link0/chamber{k}/gain") for k in range(3)]]
    print(f"{100 * error:.2f} % of the length in {record.t[-1] - record.t[first]:.1f} s; begins with {gains}")
    return error, gains


def test_the_law_begins_with_the_gains_that_the_probe_has_measured():
    error, gains = probed(weak)
    assert gains == pytest.approx(np.array([1.0, 0.6, 1.0]) / (2.6 / 3) - 1.0, abs=0.05)
    assert error < 0.01


def test_an_arm_as_in_its_file_begins_without_gains():
    _, gains = probed(lambda i, chamber: {})
    assert np.all(np.abs(gains) < 1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("stiffness", [0.7, 1.3])
def test_another_stiffness_is_taken_for_no_slope(stiffness):
    control = parse({"law": "composite"}, ControllerConfig, "test")
    record = run(STANDING, Setup(stiffness=stiffness, control=control, duration_s=9.0))
    print(f"RMS {1e3 * record.rms(4.0):.3f} mm")
    assert not record.estimates[:, record.names.index("link0/area_slope")].any()
    assert record.rms(4.0) < 0.2e-3
