"""A path of the tip that the configuration states: through its points, straight, at rest at each."""

import control_samples
import numpy as np
import pytest

from soro_core import robot_from_dict
from soro_core.config import parse
from soro_core.control import Controller, ControllerConfig
from soro_core.control.reference_feasibility import check_reach
from soro_core.control.retune import retune
from tests.refused import refused

ROBOT = robot_from_dict({**control_samples.ROBOT, "links": [control_samples.LINK]})
REACH = 0.02


def config(points=None, pause_s=0.5, motion=None, **reference):
    given = {"kind": "path", "path_m": points, "pause_s": pause_s, "start_s": 1.0, **reference}
    return parse({"law": "composite", "reference": given, "motion": motion or {}}, ControllerConfig, "test")


def tip(controller, t):
    q = controller.configured.sample(t).q
    return controller.arm.pose(q, controller.robot.length)[:3, 3]


@pytest.fixture(scope="module")
def points():
    arm = Controller(ROBOT, config([0.0, 0.0, -1.02 * ROBOT.length])).arm
    bends = ((0.02, 3.0, 0.0), (0.02, -3.0, 1.0), (0.05, 0.0, -2.0))
    return [arm.pose(np.array(q), ROBOT.length)[:3, 3].tolist() for q in bends]


def test_the_tip_rests_at_each_point_and_goes_straight_between(points):
    controller = Controller(ROBOT, config(points))
    motion = controller.configured
    rests, ways = motion.parts[::2], motion.parts[1::2]
    assert [part.duration_s for part in rests] == [1.5, 0.5, 0.5]
    begin_s = 0.0
    for k, point in enumerate(points):
        assert tip(controller, begin_s) == pytest.approx(point, abs=1e-4)
        assert np.all(motion.sample(begin_s + 0.4).qd == 0.0)
        begin_s += rests[k].duration_s
        if k < len(ways):
            way = np.array([tip(controller, begin_s + x * ways[k].duration_s) for x in np.linspace(0, 1, 20)])
            along = np.array(points[k + 1]) - np.array(point)
            beside = np.cross(way - point, along / np.linalg.norm(along))
            assert np.linalg.norm(beside, axis=1).max() < 1e-4
            speed = np.linalg.norm(np.diff(way, axis=0), axis=1) * 19 / ways[k].duration_s
            assert speed.max() <= 0.04 + 1e-6
            begin_s += ways[k].duration_s
    assert motion.end_s == pytest.approx(begin_s)
    assert tip(controller, begin_s + 10.0) == pytest.approx(points[-1], abs=1e-4)


def test_rows_and_a_plain_list_are_the_same(points):
    assert config(points) == config([number for point in points for number in point])


def test_a_later_begin_is_the_same_motion_later(points):
    motion = Controller(ROBOT, config(points)).configured
    np.testing.assert_allclose(motion.started_at(5.0).sample(7.1).q, motion.sample(2.1).q, atol=1e-9)


@pytest.mark.parametrize(
    ("keys", "key", "names"),
    [
        ({"points": [0.1, 0.2]}, "reference", ("2 numbers",)),
        ({"points": []}, "reference", ("0 numbers",)),
        ({"points": [[0.0, 0.0, 0.06], 0.1]}, "reference.path_m[0]", ()),
        ({"points": [[0.01, 0.0], [0.02, 0.06], [0.01, 0.03]]}, "reference.path_m", ("3 numbers",)),
        ({"points": [[0.0, 0.0, 0.06]]}, "poses[0].position", ("nearest",)),
    ],
)
def test_a_path_that_is_none_or_out_of_reach_is_refused(keys, key, names):
    with refused(key, names=names):
        Controller(ROBOT, config(**keys))


def test_a_path_that_is_too_fast_is_refused_with_the_speed_that_works(points):
    with refused("motion.speed_m_s", names=("at most",)) as error:
        Controller(ROBOT, config(points, motion={"speed_m_s": 5.0, "acceleration_m_s2": 500.0}))
    most = float(str(error.value).split("at most ")[1].split(":")[0])
    assert 0.0 < most < 5.0
    Controller(ROBOT, config(points, motion={"speed_m_s": 0.9 * most, "acceleration_m_s2": 500.0}))


def test_a_path_that_the_pressures_cannot_hold_is_refused(points):
    controller = Controller(ROBOT, config(points))
    check_reach(controller, REACH)
    weak = ROBOT.replace(pressure_range_pa=(0.0, 100.0))
    with refused("reference.path_m", names=("kPa can hold",)):
        check_reach(Controller(weak, config(points)), REACH)


def test_a_leg_beyond_the_pressures_is_seen_beside_long_rests(points):
    """The tip goes out and comes back at once; it waits for a minute where the pressures hold it."""
    weak = ROBOT.replace(pressure_range_pa=(0.0, 3e3))
    near = Controller(ROBOT, config(points)).arm.pose(np.array([0.0, 0.5, 0.0]), ROBOT.length)[:3, 3].tolist()
    check_reach(Controller(weak, config([near], start_s=60.0)), REACH)
    with refused("reference.path_m", names=("kPa can hold",)):
        check_reach(Controller(weak, config([near, points[0], near], pause_s=0.0, start_s=60.0)), REACH)


def test_a_running_controller_goes_along_its_path_at_another_speed(points):
    controller = Controller(ROBOT, config(points))
    state = controller.initial_state()
    new = retune(controller, state, config(points, motion={"speed_m_s": 0.005}), 1.0)
    assert new.moves
    assert new.controller.configured.end_s > controller.configured.end_s + 1.0
    with refused("motion.speed_m_s"):
        retune(controller, state, config(points, motion={"speed_m_s": 5.0, "acceleration_m_s2": 500.0}), 1.0)


def test_a_running_controller_takes_a_path(points):
    controller = Controller(ROBOT, config(points[:1]))
    state, q, none = controller.initial_state(), np.zeros(3), np.zeros(controller.arm.n_u)
    state, _ = controller.step(state, q, q, 0.0, 0.005, none)
    new = retune(controller, state, config(points), 4.0)
    assert new.moves
    np.testing.assert_allclose(
        new.reference.sample(6.3).q, new.controller.configured.sample(2.3).q, atol=1e-9
    )
