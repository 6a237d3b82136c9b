"""The estimator and obstacles of an arm that tapers and is a helix at rest."""

import numpy as np
import pytest

from soro_core import SoftArm, load_robot, simulate
from soro_core.estimation import Estimator, ImuSample, PoseSample
from soro_core.planning.obstacles import obstacles_of
from soro_core.robot.surroundings import Contacts
from soro_core.rotation import quaternion_from_matrix

ROBOT = load_robot("tapered_helix")
ARM = SoftArm(ROBOT)
DT = 0.005
UP = np.array([0.0, 0.0, 9.81])


def straight(robot):
    (link,) = robot.links
    rows = [{"place": row.place, "radius": row.radius} for row in link.sections]
    return robot.with_({"links[0].sections": rows, "links[0].rest_torsion_per_m": 0.0})


def estimated(robot, sample):
    """Coordinates that an estimator of `robot` finds, and those of the arm."""
    run = simulate(ARM, pressure=lambda t: [60e3 * min(t, 1.0), 20e3 * min(t, 1.0), 0.0], t_end=1.5, dt=DT)
    assert run.status.ok
    rng = np.random.default_rng(0)
    estimator = Estimator(robot, dt=DT)
    state = estimator.initial_state(t_s=-DT)
    for t, q, qd, pressure in zip(run.t, run.q, run.qd, run.pressure, strict=True):
        poses, imus = sample(t, q, qd, rng)
        state, found = estimator.step(state, pressure, poses, imus, DT)
    return found.q, run.q[-1]


def tracked(t, q, qd, rng):
    pose = ARM.pose(q, ARM.length)
    place = pose[:3, 3] + 3e-4 * rng.normal(size=3)
    return [PoseSample(t, place, quaternion_from_matrix(pose[:3, :3]), ARM.length)], []


def sensed(t, q, qd, rng):
    pose, omega = ARM.pose(q, ARM.length), ARM.jacobian(q, ARM.length)[:3] @ qd
    up = pose[:3, :3].T @ UP + 0.02 * rng.normal(size=3)
    turn = quaternion_from_matrix(pose[:3, :3])
    return [], [ImuSample(t, omega + 0.01 * rng.normal(size=3), up, turn, ARM.length)]


def off_mm(q, wanted):
    return 1e3 * np.linalg.norm(ARM.pose(q, ARM.length)[:3, 3] - ARM.pose(wanted, ARM.length)[:3, 3])


@pytest.mark.parametrize(("sample", "most_mm"), [(tracked, 0.3), (sensed, 1.0)])
def test_the_estimator_finds_the_shape_of_a_tapered_helix(sample, most_mm):
    found, wanted = estimated(ROBOT, sample)
    assert off_mm(found, wanted) < most_mm


def test_an_estimator_of_a_straight_arm_does_not_find_it():
    found, wanted = estimated(straight(ROBOT), tracked)
    assert off_mm(found, wanted) > 5.0


def test_motions_keep_the_section_that_is_there_clear_of_obstacles():
    ball = {"centre": [0.0, 0.0, 0.5], "radius": 0.02, "stiffness": 1e3}
    contacts = Contacts.model_validate({"spheres": [ball]})
    found = obstacles_of(SoftArm(ROBOT), contacts)
    wanted = np.interp(found.places, [0.0, ARM.length], [0.012, 0.007])
    np.testing.assert_allclose(found.radius, wanted, rtol=1e-12)
    # The step between samples is that of the thinnest section.
    plain = ROBOT.with_(
        {"links[0].sections": [], "links[0].radius": 0.012, "links[0].rest_torsion_per_m": 0.0}
    )
    thick = obstacles_of(SoftArm(plain), contacts)
    assert thick.step_m / found.step_m == pytest.approx(np.sqrt(0.032 / 0.027), rel=1e-9)
