"""Frames of what comes in: the configured one, or none; and names of the frames of what goes out."""

import numpy as np
import pytest
import rclpy
from nav_msgs.msg import Path
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu

from soro_core.errors import ConfigError
from soro_core.run_keys import Frames
from soro_lab.scene import load_scene
from soro_ros.conversion import messages
from soro_ros.nodes.controller import ControllerNode
from soro_ros.nodes.estimator import EstimatorNode
from soro_ros.nodes.exciter import ExciterNode
from soro_ros.nodes.shadow import ShadowNode
from soro_ros.topics.diagnostics import OK, WARN
from soro_ros.topics.twin_topics import TwinTopics
from tests.refused import fails
from tests.soro_ros.direct import active, captured, fire, receive, request, values

CHAMBERS = ("link0/chamber0", "link0/chamber1", "link0/chamber2")
COORDINATES = ("link0/elongation", "link0/bending_x", "link0/bending_y")
TICK_NS = 5_000_000


def upright(stamp_ns, frame, x=0.0):
    pose = np.eye(4)
    pose[:3, 3] = x, 0.0, 0.064
    return messages.pose_stamped(pose, stamp_ns, frame)


def ticks(node, first, frame, count=30):
    """Some ticks of an arm at rest with a pose sensor; returns the next one."""
    for k in range(first, first + count):
        receive(node, "sensors/pose0", upright(k * TICK_NS, frame))
        receive(node, "chambers/state", messages.chambers(CHAMBERS, np.zeros(3), k * TICK_NS))
    return first + count


@pytest.mark.parametrize(
    ("settings", "good", "bad", "key"),
    [
        ((), ("world", ""), "optitrack", "world (frames.world)"),
        (("frames.pose:=optitrack",), ("optitrack", ""), "world", "optitrack (frames.pose)"),
        (("frames.world:=map",), ("map",), "world", "map (frames.world)"),
    ],
)
def test_poses_in_another_frame_are_named_once_counted_and_never_used(
    domain, capfd, settings, good, bad, key
):
    with active(EstimatorNode, *settings) as node:
        said = f"sensors/pose0 refused: frame '{bad}'; allowed: {key}, or none"
        sent = captured(node, "arm/state")
        k = ticks(node, 1, bad)
        assert not sent, "without a sample there is no estimate"
        assert node.diagnostics.status.level == WARN
        assert said in node.diagnostics.status.message
        fire(node, 1.0)
        assert values(node)["refused sensors/pose0"] == "30"
        for frame in good:
            k = ticks(node, k, frame)
            assert (node.diagnostics.status.level, node.diagnostics.status.message) == (OK, "active")
        assert len(sent) >= 30
        before = node.state.last_s
        k = ticks(node, k, bad, 10)
        assert node.state.last_s == before
        assert node.diagnostics.status.message == f"active; {said}"
        fire(node, 1.0)
        assert values(node)["refused sensors/pose0"] == "40"
    assert capfd.readouterr().err.count(said) == 1


def test_a_tick_in_lockstep_does_not_wait_for_a_refused_sample(domain):
    settings = ("mode:=lockstep", "pose_rate_hz:=200.0", "imu_locations:=[]")
    with active(EstimatorNode, *settings) as node:
        sent = captured(node, "arm/state")
        for k in range(5):
            receive(node, "chambers/state", messages.chambers(CHAMBERS, np.zeros(3), k * TICK_NS))
            assert len(sent) == k, "it waits for a sample"
            receive(node, "sensors/pose0", upright(k * TICK_NS, "world" if k < 3 else "camera"))
            assert len(sent) == k + 1
        assert values_after(node)["refused sensors/pose0"] == "2"


def values_after(node):
    fire(node, 1.0)
    return values(node)


@pytest.mark.parametrize(("settings", "taken"), [((), True), (("frames.imu:=[imu_a]",), False)])
def test_an_imu_may_have_any_frame_until_its_name_is_stated(domain, settings, taken):
    with active(EstimatorNode, *settings) as node:
        for frame in ("imu_a", "another", ""):
            message = Imu()
            message.header.frame_id, message.orientation_covariance[0] = frame, -1.0
            message.linear_acceleration.z = 9.81
            receive(node, "sensors/imu0", message)
        refused = values_after(node).get("refused sensors/imu0", "0")
        assert refused == ("0" if taken else "1")


def test_the_exciter_does_not_begin_without_a_sample_that_it_may_use(domain):
    with active(ExciterNode, "pose_rate_hz:=100.0") as node:
        receive(node, "sensors/pose0", upright(TICK_NS, "optitrack"))
        receive(node, "chambers/state", messages.chambers(CHAMBERS, np.zeros(3), TICK_NS))
        answer = request(node, "~/enable")
        assert not answer.success
        assert "no sample" in answer.message
        assert "sensors/pose0 refused: frame 'optitrack'" in answer.message
        assert values_after(node)["refused sensors/pose0"] == "1"


def test_the_shadow_compares_no_pose_in_another_frame(domain):
    with active(ShadowNode) as node:
        for k in range(3):
            receive(node, "chambers/state", messages.chambers(CHAMBERS, np.zeros(3), k * TICK_NS))
            receive(node, "sensors/pose0", upright(k * TICK_NS, ("optitrack", "world", "")[k]))
        assert values_after(node)["refused sensors/pose0"] == "1"
        assert values(node)["poses"] == "2"
        before = node._state
        receive(node, "chambers/state", messages.chambers(CHAMBERS, np.array([0.0, np.nan, 0.0]), 10**9))
        assert node._state is before


def test_a_pose_in_another_frame_does_not_let_a_controller_start(domain):
    with active(ControllerNode) as node:
        now_ns, zero = node.get_clock().now().nanoseconds, np.zeros(3)
        for frame in ("camera", "world"):
            receive(node, "chambers/state", messages.chambers(CHAMBERS, zero, now_ns))
            receive(node, "arm/state", messages.arm_state(COORDINATES, zero, zero, zero, now_ns))
            receive(node, "sensors/pose0", serialize_message(upright(now_ns, frame)))
            found = [request(node, f"~/{name}") for name in ("enable_anyway", "enable")]
            assert [one.success for one in found] == [frame == "world"] * 2
            if frame == "camera":
                assert all("sensors/pose0 refused: frame 'camera'" in one.message for one in found)


def test_references_are_in_the_configured_frames_and_so_is_what_the_controller_wants(domain):
    settings = ("frames.world:=map", "frames.base:=left/base", "control.check_at_enable:='off'")
    settings += ("control.probe_at_enable:='off'",)
    with active(ControllerNode, *settings) as node:
        wanted = captured(node, "arm/desired/tip")
        request(node, "~/enable")

        def tick():
            now_ns = node.get_clock().now().nanoseconds
            receive(node, "chambers/state", messages.chambers(CHAMBERS, np.zeros(3), now_ns))
            zero = np.zeros(3)
            receive(node, "arm/state", messages.arm_state(COORDINATES, zero, zero, zero, now_ns))

        tick()
        assert wanted[-1].header.frame_id == "map"
        refused = 0
        for topic, frame, allowed in (
            ("arm/reference/tip", "world", "map (frames.world), or none"),
            ("arm/reference/tip", "map", ""),
            ("arm/reference/tip", "", ""),
            ("arm/reference/path", "base", "left/base (frames.base), or none, or map (frames.world)"),
            ("arm/reference/path", "left/base", ""),
            ("arm/reference/path", "map", ""),
            ("arm/reference/path", "", ""),
        ):
            pose = upright(0, frame, 1e-3)
            message = pose if topic.endswith("tip") else Path(poses=[pose])
            message.header.frame_id = frame
            receive(node, topic, message)
            refused += bool(allowed)
            status = node.diagnostics.status
            assert values_after(node)["refused references"] == str(refused), (topic, frame)
            if allowed:
                assert status.message.startswith(f"reference refused: {topic}: header.frame_id"), (
                    status.message
                )
                assert f"'{frame}'" in status.message
                assert status.message.endswith(f"allowed: {allowed}")
            tick()


def test_the_twin_states_the_frames_that_the_estimator_expects(domain):
    scene = load_scene(
        "track_circle",
        {
            "frames": {"world": "map", "pose": "optitrack", "imu": ["gyro"]},
            "twin.imu.enabled": True,
            "twin.imu.locations": [0.5, 1.0],
        },
    )
    assert scene.estimator_node().frames == scene.controller_node().frames == scene.frames
    from soro_core.twin import Twin
    from soro_ros.conversion import qos

    rclpy.init()
    try:
        node = rclpy.create_node("twin", namespace="left")
        twin = Twin(scene.loaded_robot, scene.twin_node())
        topics = TwinTopics(node, scene.loaded_robot, twin, qos.RELIABLE, lockstep=False)
        sent = {name: captured(node, name) for name in ("sensors/pose0", "sensors/imu0", "sensors/imu1")}
        truth = captured(node, "truth/tip")
        state = twin.initial()
        for _ in range(5):
            state, seen = twin.observe(state)
            topics.publish_samples(seen, 0, lambda _: 0)
            topics.publish_truth(state, seen, 0)
            state = twin.step_pressures(state, state.air.pressure_pa)
        frames = [sent[name][0].header.frame_id for name in sent]
        assert frames == ["optitrack", "gyro", "left/imu1"]
        assert truth[0].header.frame_id == "map"
        node.destroy_node()
    finally:
        rclpy.shutdown()


@pytest.mark.parametrize(
    ("wrong", "key"),
    [
        ({"world": ""}, "world"),
        ({"world": "/map"}, "world"),
        ({"base": "a b"}, "base"),
        ({"base": "world"}, ""),
    ],
)
def test_names_that_cannot_be_frames_are_refused(wrong, key):
    with fails(ConfigError, key=key):
        Frames(**wrong)
