"""What the pressures can hold, before anything moves."""

import numpy as np
import pytest

from soro_core import Loop, load_robot
from soro_core.config import find_config, parse
from soro_core.control import Controller, ControllerConfig
from soro_core.control.reference_feasibility import check_reach, tip_distance
from soro_core.estimation import Estimator
from soro_core.twin import Twin
from tests.refused import refused


def controller(robot="tue_three_bellow", **reference):
    config = parse({"reference": reference}, ControllerConfig, "test")
    return Controller(load_robot(find_config(robot, "robots")), config)


@pytest.mark.parametrize(
    "reference",
    [
        {},
        {"kind": "hold"},
        {"kind": "set_point", "set_point": [0.05, 3.0, 4.0]},
        {"curvature_per_m": 0.0},
        {"curvature_per_m": 14.0},
    ],
    ids=str,
)
def test_what_can_be_held_is_accepted(reference):
    check_reach(controller(**reference), 0.1)


@pytest.mark.parametrize(
    ("robot", "reference", "key", "names"),
    [
        ("tue_three_bellow", {"curvature_per_m": 25.0}, "reference.curvature_per_m", ()),
        ("tue_three_bellow", {"kind": "set_point", "set_point": [0.5, 0.0, 0.0]}, "reference.set_point", ()),
        # It bends about one axis alone.
        ("asu_two_segment", {}, "reference.curvature_per_m", ("asu_two_segment", "10%", "27 mm")),
    ],
)
def test_what_cannot_be_held_is_refused(robot, reference, key, names):
    with refused(key, names=names):
        check_reach(controller(robot, **reference), 0.1)


def test_the_distance_grows_with_the_bend():
    """Also where the arm is about to buckle and no search for its rest succeeds."""
    control = controller()
    bends = [np.array([0.05, k, 0.0]) for k in np.arange(12.0, 40.0, 2.0)]
    distances = [tip_distance(control, q) for q in bends]
    assert np.all(np.diff(distances) > -0.2e-3)
    assert distances[-1] > 20e-3


@pytest.mark.parametrize(("bend", "named"), [(25.0, True), (4.0, False)])
def test_a_loop_names_a_circle_out_of_reach_in_one_line(caplog, bend, named):
    robot = load_robot("tue_three_bellow")
    twin, loop = Twin(robot), Loop(Estimator(robot), controller(curvature_per_m=bend))
    next(loop.run(twin, 1, twin.dt, before_s=-twin.dt))
    lines = [one.getMessage() for one in caplog.records if "reference.curvature_per_m" in one.getMessage()]
    assert [("mm away" in line, "\n" in line) for line in lines] == [(True, False)] * named
