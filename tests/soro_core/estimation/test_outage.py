"""The estimate while poses are missing or frozen, in closed loop with 20 g that the loop does not know."""

import pytest

from soro_core import load_robot
from soro_core.config import find_config, parse
from soro_core.control import ControllerConfig
from tests.soro_core.loop.loop_harness import Setup, run

pytestmark = pytest.mark.slow

BEGIN_S, END_S = 10.0, 11.0


@pytest.mark.parametrize(("fault", "seed"), [("outage_s", 2), ("frozen_s", 4)])
def test_a_second_without_poses_costs_little(fault, seed):
    """Seeds 2 and 4 are the worst of 1 to 5."""
    robot = load_robot(find_config("tue_three_bellow", "robots"))
    control = parse({"law": "composite"}, ControllerConfig, "test")
    record = run(robot, Setup(seed=seed, control=control, duration_s=12.0, **{fault: (BEGIN_S, END_S)}))
    error, t = record.estimation_error(), record.t
    without, back = error[(t > BEGIN_S) & (t <= END_S)].max(), error[t > END_S + 0.3].max()
    print(f"{1e3 * without:.2f} mm during it, {1e3 * back:.2f} mm from 0.3 s after it on")
    assert without < 1.5e-3
    assert back < 0.5e-3
