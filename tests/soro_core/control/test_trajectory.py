"""References: derivatives against differences, smooth joints, ends, and refused trajectories."""

import numpy as np
import pytest

from soro_core.control.reference.trajectory import Blend, Circle, Hold, Waypoints, smooth_step
from tests.refused import refused

NAMES = ("link0/elongation", "link0/bending_x", "link0/bending_y")
X, Y = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


def circle(start=0.0):
    return Circle(np.array([0.1, 0.0, 0.0]), X, Y, 10.0, 4.0, start)


def waypoints(**changes):
    given = {
        "coordinates": NAMES,
        "names": NAMES,
        "times_s": [0.5, 1.0, 2.0],
        "positions": [[0.0, 1.0, 2.0], [0.1, 3.0, -1.0], [0.05, 0.0, 0.0]],
        "start_s": 3.0,
    }
    return Waypoints(**{**given, **changes})


REFERENCES = {
    "circle": circle(),
    "blend": Blend(Hold(np.array([0.0, 1.0, 1.0])), circle(), 0.3, 2.5),
    "cubic spline": waypoints(),
    "cubic": waypoints(velocities=[[0.0, 0.0, 0.0], [0.1, 1.0, -2.0], [0.0, 0.0, 0.0]]),
    "quintic": waypoints(
        velocities=[[0.0, 0.0, 0.0], [0.1, 1.0, -2.0], [0.0, 0.0, 0.0]], accelerations=np.zeros((3, 3))
    ),
}


@pytest.mark.parametrize("name", REFERENCES)
@pytest.mark.parametrize("t", [0.31, 0.9, 1.7, 2.29, 3.6, 4.2, 4.9])
def test_derivatives_against_differences(name, t):
    reference, h = REFERENCES[name], 1e-5
    before, here, after = (reference.sample(x) for x in (t - h, t, t + h))
    assert here.qd == pytest.approx((after.q - before.q) / (2 * h), abs=1e-6, rel=1e-6)
    assert here.qdd == pytest.approx((after.qd - before.qd) / (2 * h), abs=1e-5, rel=1e-5)


@pytest.mark.parametrize("name", ["circle", "blend", "quintic"])
@pytest.mark.parametrize("t", [0.3, 2.3, 2.8, 3.5, 4.0])
def test_accelerations_do_not_jump(name, t):
    before, after = REFERENCES[name].sample(t - 1e-7), REFERENCES[name].sample(t + 1e-7)
    for one, two in ((before.q, after.q), (before.qd, after.qd), (before.qdd, after.qdd)):
        assert one == pytest.approx(two, abs=2e-4)


def test_the_circle_has_its_curvature_and_period():
    for t in np.linspace(0.0, 4.0, 9):
        assert np.hypot(*circle().sample(t).q[1:]) == pytest.approx(10.0)
        assert circle().sample(t).q == pytest.approx(circle().sample(t + 4.0).q)


def test_waypoints_pass_through_their_points_in_the_arms_order():
    given = waypoints(
        names=("link0/bending_y", "link0/elongation", "link0/bending_x"),
        positions=[[2.0, 0.0, 1.0], [-1.0, 0.1, 3.0], [0.0, 0.05, 0.0]],
    )
    for t in (3.4, 3.5, 3.8, 4.0, 4.6, 5.0, 7.0):
        assert given.sample(t).q == pytest.approx(waypoints().sample(t).q)
    assert given.sample(4.0).q == pytest.approx([0.1, 3.0, -1.0])
    assert given.sample(0.0).q == pytest.approx([0.0, 1.0, 2.0])
    assert given.sample(9.0).qd.tolist() == [0.0, 0.0, 0.0]


def test_one_waypoint_is_a_set_point():
    one = waypoints(times_s=[0.0], positions=[[0.1, 1.0, 2.0]])
    assert one.sample(5.0).q.tolist() == [0.1, 1.0, 2.0]


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"names": ("link0/elongation", "link0/bending_x", "link0/torsion")}, "joint_names"),
        ({"names": NAMES[:2]}, "joint_names"),
        ({"names": (NAMES[0], NAMES[0], NAMES[1])}, "joint_names"),
        ({"times_s": [0.5, 0.5, 1.0]}, "time_from_start"),
        ({"times_s": [0.5, np.nan, 1.0]}, "time_from_start"),
        ({"times_s": [-0.5, 0.0, 1.0]}, "time_from_start"),
        ({"times_s": [], "positions": []}, "time_from_start"),
        ({"positions": [[0.0, 1.0, 2.0]]}, "positions"),
        ({"positions": [[0.0, 1.0], [0.0, 1.0, 2.0], [0.0, 1.0]]}, "positions"),
        ({"positions": np.full((3, 3), np.nan)}, "positions"),
        ({"velocities": np.zeros((2, 3))}, "velocities"),
        ({"accelerations": np.zeros((3, 3))}, "accelerations"),
    ],
)
def test_a_wrong_trajectory_is_refused_by_name(changes, key):
    with refused(key):
        waypoints(**changes)


def test_the_smooth_step_is_flat_at_its_ends():
    assert smooth_step(0.0) == (0.0, 0.0, 0.0)
    assert smooth_step(1.0) == (1.0, 0.0, 0.0)
    assert smooth_step(-1.0)[0] == 0.0
    assert smooth_step(2.0)[0] == 1.0
