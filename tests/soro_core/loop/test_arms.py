"""Arms without a controller file: automatic gains, noise and scales reach the goal of each case.

One seed in shorter runs, which have learned less; `python -m benchmarks --only arms` has means of five.
"""

import pytest

from tests.soro_core.loop.arms import BY_NAME
from tests.soro_core.loop.loop_harness import run

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    "name",
    [
        "asu_two_segment, 100 g, pose at the tip",
        "two three-bellow links, 10 g, two poses",
        "the arm hanging, 7 1/m, 20 g",
        "the arm standing, Legendre order 1, 20 g",
    ],
)
def test_an_arm_with_automatic_gains_reaches_its_goal(figure, name):
    arm = BY_NAME[name]
    robot, setup = arm.ready(duration_s=11.0)
    record = run(robot, setup)
    figure(f"{name}: tip RMS {1e3 * record.rms():.3f} mm, goal {1e3 * arm.goal_m:.2f} mm")
    assert record.rms() <= arm.goal_m
    assert record.counts.outliers + record.counts.failed + record.counts.reacquired == 0


def test_round_off_in_h_takes_no_moment_from_two_segments(figure):
    """19 mm if it gets a weight."""
    arm = BY_NAME["asu_two_segment, 100 g, poses at both plates"]
    robot, setup = arm.ready(duration_s=8.0)
    record = run(robot, setup)
    figure(f"{arm.name}, first 8 s: tip RMS of the last 5 s {1e3 * record.rms():.3f} mm")
    assert record.rms() <= 2.0 * arm.goal_m


def test_saturated_pressures_are_named_with_their_chamber():
    robot, setup = BY_NAME["the arm hanging, 10 1/m, 20 g"].ready(duration_s=8.0)
    record = run(robot, setup)
    saturated = {status for status in record.statuses if "pressure saturated" in status}
    assert saturated
    assert all("link0/chamber" in status and "kPa" in status for status in saturated)
    assert record.counts.failed == 0
