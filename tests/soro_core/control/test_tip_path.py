"""Legs of a path: lines, arcs and splines by their length, corners at rest, and what is refused."""

import itertools

import numpy as np
import pytest

from soro_core.control.motions.tip_path import arc, corners, legs_of
from soro_core.rotation import matrix_from_quaternion, quaternion_from_matrix, rotation_exp, rotation_log
from tests.refused import refused

A, B, C = (np.array(x) for x in ([0.0, 0.0, 0.06], [0.01, 0.0, 0.06], [0.01, 0.01, 0.06]))


def along(leg, n=400):
    return np.array([leg.at(s)[0] for s in np.linspace(0.0, leg.length_m, n + 1)])


def test_two_poses_are_a_straight_line():
    (leg,) = legs_of(np.array([A, B]))
    assert (leg.length_m, leg.curvature_per_m) == (pytest.approx(0.01), 0.0)
    assert leg.at(0.0025)[0] == pytest.approx([0.0025, 0.0, 0.06])


def test_a_repeated_pose_is_a_corner_at_rest_and_a_path_of_one_point_has_no_legs():
    first, second = legs_of(corners([A, B, C]))
    assert first.at(first.length_m)[0] == pytest.approx(B)
    assert second.at(0.0)[0] == pytest.approx(B)
    assert second.at(second.length_m)[0] == pytest.approx(C)
    assert len(legs_of(np.array([A, A, A, B, B]))) == 1
    assert legs_of(np.array([A])) == legs_of(np.array([A, A])) == ()


def test_an_arc_has_the_length_and_the_curvature_of_its_circle():
    radius = 0.012
    points = radius * np.array([[np.cos(x), np.sin(x), 0.0] for x in np.radians([0.0, 100.0, 270.0])])
    (leg,) = legs_of(arc(*points))
    assert leg.length_m == pytest.approx(radius * 1.5 * np.pi, rel=1e-6)
    assert leg.curvature_per_m == pytest.approx(1.0 / radius, rel=1e-2)
    assert np.linalg.norm(along(leg), axis=1) == pytest.approx(np.full(401, radius), abs=1e-8)


def test_a_spline_passes_its_poses_evenly():
    poses = np.array([A, B, C, [0.0, 0.012, 0.065], [-0.01, 0.0, 0.06]])
    (leg,) = legs_of(poses)
    path = along(leg, 4000)
    for pose in poses:
        assert np.linalg.norm(path - pose, axis=1).min() < 1e-5
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert steps == pytest.approx(np.full(4000, leg.length_m / 4000), rel=1e-4)
    turns = np.linalg.norm(np.diff(path, 2, axis=0), axis=1) / steps[1:] ** 2
    assert 0.95 * leg.curvature_per_m < turns.max() < 1.01 * leg.curvature_per_m


def test_orientations_are_passed_and_turn_evenly():
    turns = [np.zeros(3), np.array([0.3, 0.0, 0.1]), np.array([0.5, -0.2, 0.1])]
    begin = rotation_exp(np.array([0.0, 0.0, 2.5]))
    quaternions = np.array([quaternion_from_matrix(begin @ rotation_exp(turn)) for turn in turns])
    (leg,) = legs_of(np.array([A, B, C]), quaternions)
    places = np.linspace(0.0, leg.length_m, 201)
    found = [matrix_from_quaternion(leg.at(s)[1]) for s in places]
    assert found[0] == pytest.approx(begin)
    assert found[-1] == pytest.approx(begin @ rotation_exp(turns[-1]))
    middle = matrix_from_quaternion(quaternions[1])
    assert min(np.linalg.norm(rotation_log(one.T @ middle)) for one in found) < 0.01
    steps = np.array([np.linalg.norm(rotation_log(a.T @ b)) for a, b in itertools.pairwise(found)])
    assert np.abs(np.diff(steps)).max() < 0.05 * steps.max()


@pytest.mark.parametrize(
    ("poses", "key"),
    [
        ([A, [np.nan, 0.0, 0.06]], "poses[1].position"),
        (np.zeros((0, 3)), "poses"),
        ([A, B, A], "poses[1].position"),  # it turns back
    ],
)
def test_poses_that_are_no_path_are_refused(poses, key):
    with refused(key):
        legs_of(np.array(poses))


def test_an_orientation_that_is_none_is_refused():
    with refused("poses[1].orientation", [0.0, 0.0, 0.0, 0.0]):
        legs_of(np.array([A, B]), np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 0.0]]))


@pytest.mark.parametrize("points", [(A, B, A), (A, A, B), (A, B, 2.0 * B - A)])
def test_points_without_a_circle_are_refused(points):
    with refused("points"):
        arc(*points)
