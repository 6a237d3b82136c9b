"""Frames on the arm: what robot_description says of them, and where they are on /tf."""

import sys
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
import rclpy
import yaml
from rclpy.node import Node
from rosbags.typesys import Stores, get_typestore
from std_msgs.msg import String

from soro_core.errors import ConfigError
from soro_core.model.soft_arm import SoftArm
from soro_core.robot import load_robot
from soro_core.rotation import matrix_from_quaternion
from soro_core.run_keys import Frames
from soro_lab.scene import EstimatorNodeConfig
from soro_ros.conversion import messages, qos
from soro_ros.conversion.arm_frames import frames_of, urdf
from soro_ros.conversion.interfaces import definition
from soro_ros.host import middleware
from soro_ros.nodes.estimator import EstimatorNode
from soro_ros.topics.transforms import ArmTransforms
from tests.refused import fails
from tests.soro_ros.direct import active, captured, receive
from tests.soro_ros.running import wait_until

TURN = [float(v) for v in np.array([1.0, 2.0, -1.0, 3.0]) / np.sqrt(15.0)]
PLACES = {"camera": {"at": 0.5, "offset_m": [0.03, 0.0, 0.0], "quaternion": TURN}}
CHANGES = {
    "base_position": [0.1, -0.2, 0.3],
    "base_quaternion": TURN,
    "places": PLACES,
    "calibration": {"bodies": [{"at": 1.0, "offset_m": [0.0, 0.01, 0.0]}]},
}
NAMES = ("link0/end", "link1/end", "tip", "pose0", "imu0", "camera")


@pytest.fixture
def robot(tmp_path):
    """A robot of two links on a turned base, with a camera and a body that a tracker sees."""
    file = tmp_path / "robot.yaml"
    file.write_text(yaml.safe_dump({"based_on": "asu_two_segment", **CHANGES}))
    return file


def expected(robot, q):
    """Poses of all frames at the base, by the model alone."""
    arm = SoftArm(load_robot(str(robot)))
    at_base = {s: np.linalg.inv(arm.pose(q, 0.0)) @ arm.pose(q, s) for s in (0.14, 0.135, 0.27)}
    body, camera = np.eye(4), np.eye(4)
    body[1, 3] = 0.01
    camera[:3, :3], camera[0, 3] = matrix_from_quaternion(np.array(TURN)), 0.03
    tip = at_base[0.27]
    poses = (at_base[0.14], tip, tip, tip @ body, tip, at_base[0.135] @ camera)
    return dict(zip(NAMES, poses, strict=True))


def settings(robot, *more):
    return (f"robot:={robot}", "imu_locations:=[1.0]", *more)


def pose_of(message):
    t, r = message.transform.translation, message.transform.rotation
    pose = np.eye(4)
    pose[:3, :3] = matrix_from_quaternion(np.array([r.x, r.y, r.z, r.w]))
    pose[:3, 3] = t.x, t.y, t.z
    return pose


@pytest.fixture
def in_left(domain):
    """Give an active estimator in the namespace `left` for a robot, and a node that looks on."""
    made = []

    def start(robot, *more):
        options = [part for one in settings(robot, *more) for part in ("-p", one)]
        middleware.init(["--ros-args", "-r", "estimator:__ns:=/left", *options])
        estimator, reader = EstimatorNode(), Node("reader")
        made.extend((estimator, reader))
        assert estimator.trigger_configure().name == "SUCCESS", estimator.failure
        estimator.trigger_activate()
        return estimator, reader

    yield start
    for node in made:
        node.destroy_node()
    rclpy.try_shutdown()  # a test that skips has started none


def described(in_left, robot):
    """What a reader receives that comes late."""
    _, reader = in_left(robot, "publish_tf:=false")
    heard = []
    reader.create_subscription(String, "/left/robot_description", heard.append, qos.LATCHED)
    wait_until(lambda: (rclpy.spin_once(reader, timeout_sec=0.1), heard)[1], "robot_description", every_s=0.0)
    return heard[0].data


def rotation(roll, pitch, yaw):
    """The rotation of a URDF: about the fixed axes x, y and z in this order."""
    (cx, cy, cz), (sx, sy, sz) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    about_x = [[1, 0, 0], [0, cx, -sx], [0, sx, cx]]
    about_y = [[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]]
    about_z = [[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]]
    return np.array(about_z) @ about_y @ about_x


def numbers(text):
    return [float(part) for part in text.split()]


def test_a_late_reader_receives_every_frame_as_a_link_that_no_joint_state_moves(in_left, robot):
    """By the rules of the format alone: the parsers on PyPI state no licence, or bring a lot with them."""
    text = described(in_left, robot)
    assert "encoding" not in text, "lxml refuses a text with one"
    root = ElementTree.fromstring(text)
    assert root.tag == "robot"
    links = [link.get("name") for link in root.iter("link")]
    assert links == ["left/base", *(f"left/{name}" for name in NAMES)]
    joints = list(root.iter("joint"))
    assert len({joint.get("name") for joint in joints}) == len(NAMES)
    assert {joint.get("type") for joint in joints} == {"floating"}
    assert {joint.find("parent").get("link") for joint in joints} == {"left/base"}
    assert [joint.find("child").get("link") for joint in joints] == links[1:]
    for joint, pose in zip(joints, expected(robot, np.zeros(6)).values(), strict=True):
        origin = joint.find("origin")
        np.testing.assert_allclose(numbers(origin.get("xyz")), pose[:3, 3], atol=1e-9)
        np.testing.assert_allclose(rotation(*numbers(origin.get("rpy"))), pose[:3, :3], atol=1e-9)
    discs = {link.get("name"): link.find("visual/geometry/cylinder") for link in root.iter("link")}
    radii = {name: float(disc.get("radius")) for name, disc in discs.items() if disc is not None}
    assert radii == dict.fromkeys(("left/base", "left/link0/end", "left/link1/end"), 0.05)


def test_the_discs_have_the_radius_of_a_tapering_link_there():
    robot = load_robot("tapered_helix")
    frames = frames_of(robot, Frames(base="base"), (), ())
    text = urdf(robot, "base", frames, lambda frame: np.eye(4))
    discs = {link.get("name"): link.find("visual/geometry/cylinder") for link in ElementTree.fromstring(text)}
    radii = {name: float(disc.get("radius")) for name, disc in discs.items() if disc is not None}
    assert radii == {"base": 0.012, "link0/end": 0.007}


def bent(node, robot, count=40):
    """Readings and poses of a bent arm, until the estimator knows it; returns the last stamp [ns]."""
    arm, q = SoftArm(load_robot(str(robot))), np.array([0.05, 2.0, -1.0, 0.02, 1.0, 1.5])
    tip = arm.pose(q, arm.length)
    tip[:3, 3] += tip[:3, 1] * 0.01
    names = node.estimator.arm.robot.chamber_names
    for k in range(1, count):
        receive(node, "sensors/pose0", messages.pose_stamped(tip, k * 5_000_000, "world"))
        receive(node, "chambers/state", messages.chambers(names, np.zeros(6), k * 5_000_000))
    return (count - 1) * 5_000_000


def check(moved, robot, q, prefix):
    """The transforms of one message are the frames of an arm with these coordinates."""
    assert {one.header.frame_id for one in moved} == {f"{prefix}base"}
    found = {one.child_frame_id: pose_of(one) for one in moved}
    assert list(found) == [f"{prefix}{name}" for name in NAMES]
    for name, pose in expected(robot, q).items():
        np.testing.assert_allclose(found[f"{prefix}{name}"], pose, atol=1e-12)


def test_the_frames_are_on_tf_at_the_time_of_the_estimate(in_left, robot):
    kind = pytest.importorskip("tf2_msgs.msg", reason="tf2_msgs is not installed: make tf2_msgs").TFMessage
    known = get_typestore(Stores.ROS2_JAZZY).hash_rihs01("tf2_msgs/msg/TFMessage")
    assert definition("tf2_msgs/msg/TFMessage").type_hash == known, "the type of every other ROS"
    estimator, reader = in_left(robot)
    moving, fixed = [], []
    reader.create_subscription(kind, "/tf", moving.append, qos.RELIABLE)
    reader.create_subscription(kind, "/tf_static", fixed.append, qos.LATCHED)
    (publisher,) = [one for one in estimator.publishers if one.topic_name == "/tf"]
    matched = publisher.get_subscription_count
    wait_until(
        lambda: (rclpy.spin_once(reader, timeout_sec=0.1), fixed and matched())[1], "/tf_static", every_s=0.0
    )
    (base,) = fixed[0].transforms
    assert (base.header.frame_id, base.child_frame_id) == ("world", "left/base")
    np.testing.assert_allclose(pose_of(base)[:3, 3], CHANGES["base_position"])
    np.testing.assert_allclose(pose_of(base)[:3, :3], matrix_from_quaternion(np.array(TURN)))
    seen = {}
    estimator.after_handover = lambda draw: (
        seen.update({estimator._ticks.estimated_ns: estimator.state}),
        draw(),
    )
    last_ns = bent(estimator, robot)
    wait_until(
        lambda: (rclpy.spin_once(reader, timeout_sec=0.1), len(moving) == len(seen))[1], "/tf", every_s=0.0
    )
    newest = moving[-1].transforms
    stamp_ns = messages.to_ns(newest[0].header.stamp)
    assert stamp_ns > last_ns - 50_000_000, "20 Hz"
    q = seen[stamp_ns].belief.q
    assert np.abs(q[1:3]).max() > 0.1, "it is bent"
    check(newest, robot, q, "left/")


class Message:
    """In the place of tf2_msgs/msg/TFMessage, where that is not installed."""

    def __init__(self, transforms):
        self.transforms = transforms


class Recorder:
    """A node that keeps what is published, by topic."""

    def __init__(self):
        self.sent = {}

    def create_publisher(self, kind, topic, quality):
        self.sent[topic] = found = []
        return SimpleNamespace(publish=found.append)

    def get_namespace(self):
        return "/left"

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=7))


@pytest.mark.parametrize(
    ("stated", "prefix"), [({}, "left/"), ({"base": "cell/two/base"}, "cell/two/"), ({"base": "base"}, "")]
)
def test_frames_stand_beside_the_base(monkeypatch, robot, stated, prefix):
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", SimpleNamespace(TFMessage=Message))
    node, arm = Recorder(), SoftArm(load_robot(str(robot)))
    config = EstimatorNodeConfig(robot=str(robot), frames=stated, imu_locations=[1.0])
    q = np.array([0.05, 2.0, -1.0, 0.02, 1.0, 1.5])
    ArmTransforms(node, arm, config).publish(q, 5_000_000_001)
    moved = node.sent["/tf"][0].transforms
    assert {messages.to_ns(one.header.stamp) for one in moved} == {5_000_000_001}
    check(moved, robot, q, prefix)
    # Parts of a refined link have no frames.
    refined = Recorder()
    ArmTransforms(refined, SoftArm(load_robot(str(robot)).refine(3)), config).publish(np.zeros(18), 0)
    check(refined.sent["/tf"][0].transforms, robot, np.zeros(6), prefix)


def test_without_tf2_msgs_the_estimator_starts_and_says_so(domain, monkeypatch, capfd):
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", None)
    with active(EstimatorNode) as node:
        assert not [one for one in node.publishers if one.topic_name.startswith("/tf")]
        assert captured(node, "robot_description") == []
    assert "no /tf: the package tf2_msgs is not installed" in capfd.readouterr().err


@pytest.mark.parametrize("name", ["tip", "pose1", "a b", "left/camera", "world"])
def test_a_place_has_a_name_of_its_own(name):
    with fails(ConfigError, key="places"):
        load_robot("tue_three_bellow").replace(places={name: {"at": 1.0}})
