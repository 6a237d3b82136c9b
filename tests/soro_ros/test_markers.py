"""The markers of an arm, as subscribers and readers of bags receive them."""

import time
from pathlib import Path

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, PoseArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.highlevel import AnyReader
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from soro_core.model import SoftArm
from soro_core.robot import load_robot
from soro_lab.bag import BagReader, BagWriter, Topic
from soro_lab.scene import MarkersConfig
from soro_ros.conversion import force, messages
from soro_ros.conversion.interfaces import definition
from soro_ros.host import middleware
from soro_ros.nodes.markers import MarkersNode
from soro_ros.view.markers import TOPIC, ArmMarkers, MarkerBytes
from tests.soro_ros.direct import fire, receive

BAG = Path(__file__).parents[2] / "bags" / "track_circle_lockstep_2s"
TYPE = "visualization_msgs/msg/MarkerArray"


def recorded(kinds):
    """Messages of the recorded run by their topic without the namespace, in their order."""
    with BagReader(BAG) as reader:
        for item in reader.messages():
            topic = item.topic.removeprefix("/track_circle/")
            if topic in kinds:
                yield topic, deserialize_message(item.data, kinds[topic].kind)


def fed(until=None):
    """The markers after the recorded run, with the newest message of each topic."""
    markers, newest = ArmMarkers(load_robot("tue_three_bellow"), MarkersConfig()), {}
    for topic, message in recorded(markers.inputs):
        markers.inputs[topic].take(message)
        newest[topic] = message
    return markers, newest


def drawn(markers):
    found = deserialize_message(markers.take(), MarkerArray).markers
    return {(marker.ns, marker.id): marker for marker in found}


def points(marker):
    return np.array([[p.x, p.y, p.z] for p in marker.points])


def test_bytes_are_the_message():
    rng = np.random.default_rng(1)
    sizes, stamp = (3, 0, 5), Time(sec=12, nanosec=34)
    made = [Marker(ns=name, id=k, text="x" * k) for k, name in enumerate(("a", "bcd", "efghi"))]
    made[2].colors = [ColorRGBA(r=0.5)] * 5
    written = MarkerBytes(made, sizes)
    for _ in range(2):
        xyz = [rng.normal(size=(n, 3)) for n in sizes]
        rgba = rng.random((3, 4)).astype(np.float32)
        for marker, place, colour in zip(made, xyz, rgba, strict=True):
            marker.header.stamp = stamp
            marker.color = ColorRGBA(**dict(zip("rgba", colour.tolist(), strict=True)))
            marker.points = [Point(x=x, y=y, z=z) for x, y, z in place.tolist()]
        wanted = MarkerArray(markers=made)
        found = written.of(stamp, rgba, xyz)
        assert len(found) == len(serialize_message(wanted))
        assert deserialize_message(found, MarkerArray) == wanted


def test_skin_frames_and_trails_are_those_of_the_run():
    markers, newest = fed()
    backbone = messages.transforms(newest["arm/backbone"])
    found = drawn(markers)
    assert {marker.header.frame_id for marker in found.values()} == {"world"}
    assert {messages.to_ns(marker.header.stamp) for marker in found.values()} == {
        messages.to_ns(newest["arm/backbone"].header.stamp)
    }
    radius = load_robot("tue_three_bellow").links[0].radius
    for (name, _), marker in found.items():
        if name == "skin":
            away = np.linalg.norm(points(marker)[:, None] - backbone[:, :3, 3], axis=-1).min(axis=1)
            assert away.max() < 1.1 * radius
    tip, wanted = newest["arm/tip"].pose.pose.position, newest["arm/desired/tip"].pose.position
    assert points(found["tip", 0])[-1] == pytest.approx([tip.x, tip.y, tip.z])
    assert points(found["reference", 0])[-1] == pytest.approx([wanted.x, wanted.y, wanted.z])
    moved = np.linalg.norm(np.diff(points(found["tip", 0]), axis=0), axis=1)
    assert 0 < moved.max() < 0.005  # a line, not a heap of far points
    axes = points(found["frames", 0]).reshape(-1, 3, 2, 3)
    assert axes[-1, :, 0] == pytest.approx(np.tile(backbone[-1, :3, 3], (3, 1)))
    assert (axes[-1, 2, 1] - axes[-1, 2, 0]) / (2 * radius) == pytest.approx(backbone[-1, :3, 2])
    assert len(found["frames", 0].colors) == len(found["frames", 0].points)
    assert markers.take() is None  # until the backbone moves on


def test_frames_are_twice_the_radius_where_they_stand():
    robot = load_robot("tapered_helix")
    markers, backbone = (
        ArmMarkers(robot, MarkersConfig()),
        SoftArm(robot).poses(np.zeros(3), [0.0, 0.06, 0.12]),
    )
    message = PoseArray(poses=[messages.pose_of(pose) for pose in backbone])
    markers.inputs["arm/backbone"].take(message)
    axes = points(drawn(markers)["frames", 0]).reshape(-1, 3, 2, 3)
    lengths = np.linalg.norm(axes[:, :, 1] - axes[:, :, 0], axis=-1)
    assert lengths == pytest.approx(np.array([[0.024] * 3, [0.014] * 3]))


def test_skin_has_the_colour_of_the_measured_pressure():
    markers, newest = fed()
    state = newest["chambers/state"]
    order = np.argsort(state.effort)
    found = drawn(markers)
    # core is skin 0, then the chambers in their order
    grey = [
        max(abs(found["skin", 1 + k].color.r - 0.9), abs(found["skin", 1 + k].color.b - 0.9)) for k in order
    ]
    state.effort = [90000.0] * 3
    markers.inputs["chambers/state"].take(state)
    markers.inputs["arm/backbone"].take(newest["arm/backbone"])
    full = drawn(markers)
    assert grey[2] > grey[0]
    assert full["skin", 1].color.b == pytest.approx(0xB2 / 255, abs=1e-6)
    assert full["skin", 1].color.r == pytest.approx(0.0, abs=1e-6)


def test_the_cause_of_a_latch_stands_above_the_arm():
    markers, newest = fed()
    take = {name: given.take for name, given in markers.inputs.items()}
    assert ("latch", 0) not in drawn(markers)
    take["chambers/latch"](DiagnosticStatus(level=DiagnosticStatus.ERROR, message="vented: no command"))
    take["arm/backbone"](newest["arm/backbone"])
    assert drawn(markers)["latch", 0].text == "vented: no command"
    take["chambers/latch"](DiagnosticStatus(level=DiagnosticStatus.OK, message="open"))
    take["arm/backbone"](newest["arm/backbone"])
    assert ("latch", 0) not in drawn(markers)


def test_a_force_is_an_arrow_from_the_tip_while_it_is_fresh():
    markers, newest = fed()
    backbone = newest["arm/backbone"]
    stamp_ns, tip = messages.to_ns(backbone.header.stamp), messages.transforms(backbone)[-1, :3, 3]
    take = markers.inputs["arm/wrench"].take
    for values in ([0.1, 0.0, -0.05], [np.nan, 0.0, 0.0]):  # the second is no force
        take(force.wrench(values, stamp_ns, "world"))
        arrow = drawn(markers)["force", 0]
        assert arrow.type == Marker.ARROW
        assert points(arrow) == pytest.approx(np.array([tip, tip + 0.2 * np.array([0.1, 0.0, -0.05])]))
        markers.inputs["arm/backbone"].take(backbone)
    take(force.wrench([0.1, 0.0, 0.0], stamp_ns - 1_100_000_000, "world"))
    assert ("force", 0) not in drawn(markers)


def test_what_is_no_pose_is_not_drawn():
    markers, newest = fed()
    markers.take()
    backbone, wanted = newest["arm/backbone"], newest["arm/desired/tip"]
    before = markers._reference.points()
    wanted.pose.position.x = float("nan")
    wanted.header.stamp.sec += 1
    markers.inputs["arm/desired/tip"].take(wanted)
    assert markers._reference.points() == pytest.approx(before)
    backbone.poses[3].orientation.w = float("inf")
    markers.inputs["arm/backbone"].take(backbone)
    assert markers.take() is None


def test_a_run_that_begins_again_has_a_new_trail():
    markers, newest = fed()
    tip = newest["arm/tip"]
    tip.header.stamp = Time(sec=0, nanosec=5)
    markers.inputs["arm/tip"].take(tip)
    assert np.ptp(markers._tip.points(), axis=0).max() == 0.0


def test_a_subscriber_receives_the_markers_and_a_bag_keeps_them(domain, tmp_path):
    middleware.init(["--ros-args", "-r", "__ns:=/arm1", "-p", "robot:=tue_three_bellow"])
    node, other = MarkersNode(), rclpy.create_node("rviz", namespace="arm1")
    received = []
    other.create_subscription(MarkerArray, TOPIC, received.append, 5)
    executor = SingleThreadedExecutor()
    executor.add_node(other)
    node.trigger_configure()
    assert node.failure is None
    node.trigger_activate()
    given = list(recorded(node._markers.inputs))
    deadline = time.monotonic() + 20
    while not received:
        assert time.monotonic() < deadline
        for topic, message in given:
            receive(node, topic, message)
        fire(node, 0.05)
        executor.spin_once(timeout_sec=0.1)
    assert [marker.ns for marker in received[-1].markers].count("skin") == 6
    about = definition(TYPE)
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic(Topic("/arm1/arm/markers", TYPE, about.text, about.encoding, about.type_hash))
        writer.write("/arm1/arm/markers", bytes(serialize_message(received[-1])), 1)
    with AnyReader([tmp_path / "bag"]) as reader:
        ((connection, _, raw),) = reader.messages()
        read = reader.deserialize(raw, connection.msgtype)
    assert read.markers[1].points[7].z == received[-1].markers[1].points[7].z
    node.trigger_deactivate()
    while received[-1].markers[0].action != Marker.DELETEALL:
        assert time.monotonic() < deadline
        executor.spin_once(timeout_sec=0.1)
    executor.shutdown()
    rclpy.try_shutdown()
