"""The meshes of the arm: where they lie, how they are closed, and their colours."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseArray

from soro_core.robot import load_robot
from soro_ros.conversion import messages
from soro_ros.view.arm_shape import between, chambers
from soro_ros.view.skin import Skin


def bent(robot, curvature, n=21):
    """Poses of an arm that is bent in the plane of x and z."""
    s = np.linspace(0.0, robot.length, n)
    poses = np.tile(np.eye(4), (n, 1, 1))
    angle = curvature * s
    poses[:, 0, 0] = poses[:, 2, 2] = np.cos(angle)
    poses[:, 0, 2], poses[:, 2, 0] = np.sin(angle), -np.sin(angle)
    poses[:, 0, 3], poses[:, 2, 3] = (1 - np.cos(angle)) / curvature, np.sin(angle) / curvature
    return poses


def volume(vertices, triangles):
    """Signed volume between a mesh and the origin: positive for faces that look outwards."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


@pytest.mark.parametrize("name", ["tue_three_bellow", "asu_two_segment", "six_link"])
def test_meshes_lie_around_the_backbone_and_look_outwards(name):
    robot = load_robot(name)
    skin, poses = Skin(robot, payload_kg=0.02), bent(robot, 2.0)
    assert set(robot.chamber_names) <= set(skin.names)
    backbone = between(np.linspace(0, 1, 21), poses, np.linspace(0, 1, 400))[:, :3, 3]
    for mesh, vertices, triangles in zip(skin.names, skin.vertices(poses), skin.triangles, strict=True):
        assert triangles.min() == 0
        assert triangles.max() == len(vertices) - 1
        if mesh == "payload":
            continue
        away = np.linalg.norm(vertices[:, None] - backbone, axis=-1).min(axis=1)
        assert away.max() <= 1.01 * robot.links[0].radius, mesh
    straight = np.tile(np.eye(4), (2, 1, 1))
    straight[1, 2, 3] = robot.length
    for mesh, vertices, triangles in zip(skin.names, skin.vertices(straight), skin.triangles, strict=True):
        assert volume(vertices - vertices.mean(axis=0), triangles) > 0, mesh


def test_a_chamber_is_the_fuller_the_higher_its_pressure():
    robot = load_robot("tue_three_bellow")
    skin = Skin(robot)

    def colour(value):
        return skin.colours({"link0/chamber1": value})[skin.names.index("link0/chamber1")]

    full = chambers(robot)[1]
    assert full.name == "link0/chamber1"
    grey = [abs(colour(value) - 0.9).sum() for value in (0.0, 0.5, 1.0)]
    assert grey == sorted(grey)
    assert grey[2] > 4 * grey[0] > 0
    unknown = colour(float("nan"))
    assert np.ptp(unknown) == 0.0
    assert unknown[0] < 0.5
    assert skin.colours({})[skin.names.index("link0/chamber1")] == pytest.approx(unknown)
    assert colour(7.0) == pytest.approx(colour(1.0))
    others = skin.colours({})
    assert others[skin.names.index("core")] == pytest.approx(skin.colours({"core": 1.0})[0])


def test_poses_between_known_ones():
    s = np.array([0.0, 1.0, 3.0])
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 0, 3] = [0.0, 1.0, 5.0]
    found = between(s, poses, np.array([-1.0, 0.5, 1.0, 2.0, 9.0]))[:, 0, 3]
    assert found == pytest.approx([0, 0.5, 1, 3, 5])


def test_transforms_of_messages():
    poses = bent(load_robot("tue_three_bellow"), 8.0, n=5)
    array = PoseArray(poses=[messages.pose_of(pose) for pose in poses])
    assert messages.transforms(array) == pytest.approx(poses)
    assert messages.transforms(PoseArray()).shape == (0, 4, 4)
