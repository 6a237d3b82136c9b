"""Chambers of which the first pressures do nothing, or whose area swells: what acts is allocated."""

import functools

import numpy as np
import pytest

from soro_core import SoftArm, load_robot
from soro_core.config import parse
from soro_core.control import Controller, ControllerConfig
from soro_core.control.motions.kinematics import mean_static_pressure
from soro_core.errors import ConfigError
from soro_core.robot.coordinates import strain_fields
from tests.soro_core.loop.arms import BY_NAME
from tests.soro_core.loop.loop_harness import run

BANDS_PA = (2400.0, 0.0, 4000.0)


SWELLING_PER_PA = (1e-5, 0.0, 8e-6)


def banded(robot, bands=BANDS_PA, key="dead_band_pa"):
    link = robot.links[0].model_dump(exclude_none=True)
    for chamber, band in zip(link["chambers"], bands, strict=True):
        chamber[key] = band
    return robot.replace(links=[link])


def swelling(robot):
    return banded(robot, SWELLING_PER_PA, "swell_per_pa")


def with_range(low, high):
    return parse({"pressures": {"minimum_pa": low, "maximum_pa": high}}, ControllerConfig, "test")


@pytest.mark.parametrize("changed", [banded, swelling, lambda robot: swelling(banded(robot))])
def test_the_pressures_for_a_force_lie_beyond_the_bands_and_make_it(changed):
    arm = SoftArm(changed(load_robot("tue_three_bellow")))
    bands = arm.tables.dead_band
    made = Controller(arm.robot, with_range(0.0, 80e3)).setpoints
    q = np.array([0.06, 2.0, -1.0])
    actuation = arm.actuation_matrix(q)
    desired = actuation @ arm.acting_pressure(np.array([21e3, 33e3, 12e3]))
    found = made.allocate(actuation, desired, made.preferred_pa)
    assert arm.pressure_force(q, found.pressure_pa) == pytest.approx(found.force, rel=1e-9)
    # The pull towards preferred pressures leaves the rest.
    assert found.force == pytest.approx(desired, rel=2e-2)
    assert np.all(found.pressure_pa >= bands)
    assert np.array_equal(made.minimum_pa, bands)


@pytest.mark.parametrize("changed", [banded, swelling, lambda robot: swelling(banded(robot))])
def test_set_points_are_bounded_and_checked_by_their_maker(changed):
    """A wish at its bounds may leave the range by round-off; set points and plans do not see it."""
    arm = SoftArm(changed(load_robot("tue_three_bellow")))
    maker = Controller(arm.robot, with_range(0.0, 79_999.9)).setpoints
    actuation, rng = arm.actuation_matrix(np.array([0.06, 2.0, -1.0])), np.random.default_rng(1)
    ends = set()
    for _ in range(100):
        wish = maker.allocate(actuation, actuation @ rng.normal(0.0, 1e6, 3), maker.preferred_pa)
        assert wish.pressure_pa == pytest.approx(
            np.clip(wish.pressure_pa, maker.minimum_pa, maker.maximum_pa)
        )
        assert np.max(maker.beyond_pa(wish.pressure_pa)) <= 0.0
        made = maker.make(wish, wish.pressure_pa, wish.pressure_pa, 0.0, 0.005)
        assert made.ok
        assert np.all((made.command_pa >= maker.minimum_pa) & (made.command_pa <= maker.maximum_pa))
        ends |= set(
            zip(made.command_pa == maker.minimum_pa, made.command_pa == maker.maximum_pa, strict=True)
        )
    assert {(True, False), (False, True)} <= ends
    assert np.max(maker.beyond_pa(maker.maximum_pa + 1.0)) > 0.9
    unknown = np.array([0.0, np.nan, 0.0])
    assert not maker.make(wish, maker.preferred_pa, maker.preferred_pa, unknown, 0.005).ok
    failed = maker.allocate(actuation, unknown, maker.preferred_pa)
    assert not maker.make(failed, maker.preferred_pa, maker.preferred_pa, 0.0, 0.005).ok


def test_the_mean_pressure_that_holds_a_shape_has_the_bands():
    robot = load_robot("tue_three_bellow")
    q, ends = np.array([0.06, 2.0, -1.0]), (np.zeros(3), np.full(3, 80e3))
    plain, more = (
        mean_static_pressure(SoftArm(r), strain_fields(r), q, *ends) for r in (robot, banded(robot))
    )
    assert more - plain == pytest.approx(np.mean(BANDS_PA))


def test_the_mean_pressure_of_a_straight_arm_is_less_where_areas_swell():
    robot, per_pa = load_robot("tue_three_bellow"), 1e-5
    q, ends = np.array([0.06, 0.0, 0.0]), (np.zeros(3), np.full(3, 80e3))
    plain, less = (
        mean_static_pressure(SoftArm(r), strain_fields(r), q, *ends)
        for r in (robot, banded(robot, (per_pa,) * 3, "swell_per_pa"))
    )
    assert less == pytest.approx(plain / (1.0 + per_pa * plain), rel=2e-3)


@functools.cache
def hanging(law):
    """Robot and setup, and the tip error without bands."""
    case = BY_NAME["the arm hanging, 7 1/m, 20 g"]
    robot, setup = case.ready(law=law, duration_s=8.0, payload_kg=0.01)  # with 20 g one is empty at times
    return robot, setup, run(robot, setup).rms()


@pytest.mark.slow
@pytest.mark.parametrize("law", ["composite", "adaptive"])
def test_an_arm_with_dead_bands_follows_like_one_without(figure, law):
    robot, setup, without_m = hanging(law)
    with_bands = run(banded(robot), setup)
    figure(f"{law}: tip RMS {1e3 * with_bands.rms():.3f} mm, without bands {1e3 * without_m:.3f} mm")
    assert with_bands.rms() < 1.2 * without_m
    assert np.all(with_bands.command[-1] >= BANDS_PA)


@pytest.mark.slow
@pytest.mark.parametrize("law", ["composite", "adaptive"])
def test_an_arm_whose_areas_swell_follows_like_one_without(figure, law):
    robot, setup, without_m = hanging(law)
    with_swelling = run(swelling(robot), setup)
    figure(f"{law}: tip RMS {1e3 * with_swelling.rms():.3f} mm, else {1e3 * without_m:.3f} mm")
    assert with_swelling.rms() < 2.0 * without_m


def test_a_chamber_without_a_band_keeps_its_range_below_zero():
    robot = load_robot("tue_three_bellow").replace(pressure_range_pa=(-10e3, 90e3))
    made = Controller(robot, with_range(-5e3, 80e3)).setpoints
    assert np.array_equal(made.minimum_pa, [-5e3] * 3)


@pytest.mark.parametrize(("low", "high", "band"), [(-5e3, 80e3, 2400.0), (0.0, 80e3, 80e3)])
def test_a_range_on_both_sides_of_a_band_or_within_it_is_refused(low, high, band):
    robot = load_robot("tue_three_bellow").replace(pressure_range_pa=(-10e3, 90e3))
    with pytest.raises(ConfigError) as caught:
        Controller(banded(robot, (0.0, band, 0.0)), with_range(low, high))
    assert (caught.value.where, caught.value.key) == ("controller", "dead_band_pa")
    assert f"{band:g} of link0/chamber1" in str(caught.value)


def test_pressures_within_the_bands_apply_no_force():
    controller = Controller(banded(load_robot("tue_three_bellow")), with_range(0.0, 80e3))
    q, still = np.array([0.0, 1.0, 0.0]), np.zeros(3)
    command = controller.step(controller.initial_state(), q, still, 0.0, 0.005, np.array(BANDS_PA))[1]
    assert command.status.ok
    assert np.array_equal(command.applied_force, still)
