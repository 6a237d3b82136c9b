"""Each field of the messages that nodes read, at its extremes: no node ends, no command leaves the limits."""

import contextlib
import itertools
import threading
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseArray, PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Path
from rclpy.time import Time
from sensor_msgs.msg import Imu
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from soro_core.adaptation import Learned
from soro_core.adaptation.external_force import ExternalForce
from soro_core.control.laws import Certainty
from soro_core.errors import ConfigError
from soro_core.robot import load_robot
from soro_core.twin.config import ShadowConfig, TwinConfig
from soro_lab.scene import (
    ControllerNodeConfig,
    EstimatorNodeConfig,
    ExciterNodeConfig,
    MarkersConfig,
)
from soro_ros.conversion import force, learning, messages
from soro_ros.nodes.controller import ControllerNode
from soro_ros.nodes.estimator import EstimatorNode
from soro_ros.nodes.exciter import ExciterNode
from soro_ros.nodes.player import Player
from soro_ros.nodes.recorder import Recorder
from soro_ros.nodes.regulator import RegulatorNode
from soro_ros.nodes.shadow import ShadowNode
from soro_ros.nodes.twin import TwinNode
from soro_ros.nodes.viewer import Viewer
from soro_ros.process import parameters
from soro_ros.topics.intra_process import HANDED_OVER
from soro_ros.topics.pose_source import PoseSource
from soro_ros.view.access import Access
from soro_ros.view.markers import ArmMarkers
from soro_ros.view.moment import TOPICS, Moment, Received
from tests.soro_ros.direct import active, captured, receive, request, values
from tests.soro_ros.extremes import LARGE, TINY, extremes
from tests.soro_ros.test_frames import CHAMBERS, COORDINATES, TICK_NS, upright

HIGHEST_PA = 100e3
EMPTY, WARM = np.zeros(3), np.array([10e3, 12e3, 14e3])


def numbers(message):
    """Every float of a message."""
    for name, kind in message.get_fields_and_field_types().items():
        value = getattr(message, name)
        if hasattr(value, "get_fields_and_field_types"):
            yield from numbers(value)
        elif kind.startswith("sequence<") or "[" in kind:
            for item in value:
                yield from numbers(item) if hasattr(item, "get_fields_and_field_types") else (item,)
        else:
            yield value


def assert_finite(sent):
    """No message has a number that is not finite, and none a pressure out of range."""
    for message in sent:
        floats = [x for x in numbers(message) if isinstance(x, float)]
        assert np.isfinite(floats).all(), message


def pressures(pa, stamp_ns):
    return messages.chambers(CHAMBERS, pa, stamp_ns)


def imu(stamp_ns):
    message = Imu()
    message.header.stamp = messages.to_time(stamp_ns)
    message.linear_acceleration.z, message.orientation.w = 9.81, 1.0
    return message


def at_rest(stamp_ns):
    return messages.arm_state(COORDINATES, EMPTY, EMPTY, EMPTY, stamp_ns)


def path(stamp_ns):
    message = Path(poses=[upright(stamp_ns, "", x) for x in (0.0, 0.002, 0.004)])
    message.header.stamp = messages.to_time(stamp_ns)
    return message


def trajectory(stamp_ns):
    points = [
        JointTrajectoryPoint(
            positions=[0.05 * k, 0.0, 0.0],
            velocities=[0.0] * 3,
            accelerations=[0.0] * 3,
            time_from_start=Duration(sec=k),
        )
        for k in (1, 2)
    ]
    message = JointTrajectory(joint_names=list(COORDINATES), points=points)
    message.header.stamp = messages.to_time(stamp_ns)
    return message


def covariance(stamp_ns):
    return learning.covariance(Certainty(1e-12 * np.eye(6), positions=True), stamp_ns)


def learned(stamp_ns):
    return learning.learned(Learned(np.zeros(1 + 3 * 4)), stamp_ns)


def each(*makers):
    """Each topic's message with each of its fields at each extreme; `stamp_ns` is that of the others."""
    for topic, make in makers:
        for what, changed in extremes(make(TICK_NS)):
            if hasattr(changed, "header") and "stamp" not in what:

                def at(stamp_ns, changed=changed):
                    changed.header.stamp = messages.to_time(stamp_ns)
                    return changed

            else:

                def at(stamp_ns, changed=changed):
                    return changed

            yield f"{topic}: {what}", topic, at


def give_all(node, makers, good, *information):
    """Give each message between good ones; what raised, by message."""
    raised = []
    for k, (what, topic, at) in zip(itertools.count(1), each(*makers)):
        stamp_ns = good(3 * k)
        try:
            receive(node, topic, at(stamp_ns), *information)
            good(3 * k + 1)
        except Exception as error:
            raised.append(f"{what}: {type(error).__name__}: {error}")
    return raised


def test_estimator(domain):
    with active(EstimatorNode, "imu_locations:=[1.0]") as node:
        sent = [captured(node, topic) for topic in ("arm/state", "arm/tip", "arm/covariance", "arm/backbone")]

        def good(k):
            receive(node, "sensors/pose0", upright(k * TICK_NS, "world"))
            receive(node, "sensors/imu0", imu(k * TICK_NS))
            receive(node, "chambers/state", pressures(EMPTY, k * TICK_NS))
            return k * TICK_NS

        raised = give_all(
            node,
            [
                ("chambers/state", lambda t: pressures(WARM, t)),
                ("sensors/pose0", lambda t: upright(t, "world")),
                ("sensors/imu0", imu),
                ("arm/learned", learned),
            ],
            good,
        )
        assert not raised, "\n".join(raised)
        for messages_ in sent:
            assert_finite(messages_)
        for k in range(10_001, 10_021):
            last_ns = good(k)
        assert messages.to_ns(sent[0][-1].header.stamp) == last_ns, "it goes on"


@pytest.mark.slow
def test_controller(domain):
    with active(ControllerNode, "enabled:=true", "state_age_s:=1.0") as node:
        commands, rest = captured(node, "chambers/command"), captured(node, "arm/desired/tip")

        def good(k):
            stamp_ns = node.get_clock().now().nanoseconds
            receive(node, "chambers/state", pressures(EMPTY, stamp_ns))
            receive(node, "arm/covariance", covariance(stamp_ns))
            receive(node, "arm/state", at_rest(stamp_ns))
            return stamp_ns

        raised = give_all(
            node,
            [
                ("chambers/state", lambda t: pressures(WARM, t)),
                ("arm/covariance", covariance),
                ("arm/state", at_rest),
                ("arm/reference/tip", lambda t: upright(t, "world", 0.005)),
                ("arm/reference/trajectory", trajectory),
                ("arm/reference/path", path),
            ],
            good,
        )
        assert not raised, "\n".join(raised)
        assert_finite(commands + rest)
        assert all(0.0 <= x <= HIGHEST_PA for one in commands for x in one.effort)


def test_shadow(domain):
    with active(ShadowNode) as node:
        sent = [captured(node, f"arm/shadow/{name}") for name in ("tip", "state", "difference")]

        def good(k):
            receive(node, "sensors/pose0", upright(k * TICK_NS, "world"))
            receive(node, "chambers/state", pressures(EMPTY, k * TICK_NS))
            node.diagnose()
            return k * TICK_NS

        raised = give_all(
            node,
            [("chambers/state", lambda t: pressures(WARM, t)), ("sensors/pose0", lambda t: upright(t, ""))],
            good,
        )
        assert not raised, "\n".join(raised)
        for messages_ in sent:
            assert_finite(messages_)
        for k in range(10_001, 10_021):
            last_ns = good(k)
        assert messages.to_ns(sent[1][-1].header.stamp) == last_ns, "it goes on"


def test_exciter(domain):
    with active(ExciterNode, "pose_rate_hz:=200.0") as node:
        commands, now_ns = captured(node, "chambers/command"), 10**18
        node.get_clock = lambda: SimpleNamespace(now=lambda: Time(nanoseconds=now_ns))

        def good(k):
            nonlocal now_ns
            now_ns = 10**18 + k * TICK_NS
            receive(node, "sensors/pose0", upright(now_ns, "world"))
            receive(node, "chambers/state", pressures(EMPTY, now_ns))
            return now_ns

        good(0)
        assert request(node, "~/enable").success
        raised = give_all(
            node,
            [
                ("chambers/state", lambda t: pressures(WARM, t)),
                ("sensors/pose0", lambda t: upright(t, "world")),
            ],
            good,
        )
        assert not raised, "\n".join(raised)
        assert_finite(commands)
        assert all(0.0 <= x <= HIGHEST_PA for one in commands for x in one.effort)
        node.diagnose()
        assert (values(node)["phase"], values(node)["reason"]) == ("running", ""), "it goes on"
        last_ns = good(1_000)
        assert messages.to_ns(commands[-1].header.stamp) == last_ns


def latch(stamp_ns):
    return DiagnosticStatus(level=b"\2", message="vented", values=[KeyValue(key="latched", value="true")])


FELT = ExternalForce(np.array([0.05, 0.0, 0.0]), 1e-6 * np.eye(3), "free", True)


def drawn_messages():
    pose = messages.pose_stamped(np.eye(4), TICK_NS, "world")
    tip = PoseWithCovarianceStamped(header=pose.header)
    tip.pose.pose = pose.pose
    backbone = PoseArray(header=pose.header, poses=[pose.pose, upright(0, "").pose])
    return {
        "arm/backbone": backbone,
        "arm/tip": tip,
        "arm/desired/tip": pose,
        "arm/wrench": force.wrench(FELT.force_n, TICK_NS, "world"),
        "arm/wrench/covariance": force.covariance(FELT, TICK_NS),
        "chambers/state": pressures(WARM, TICK_NS),
        "chambers/latch": latch(0),
        "/diagnostics": DiagnosticArray(header=pose.header, status=[latch(0)]),
    }


def test_markers():
    robot, raised = load_robot("tue_three_bellow"), []
    drawn = ArmMarkers(robot, MarkersConfig())
    usual = drawn_messages()
    for topic, (_, take, _) in drawn.inputs.items():
        for what, changed in extremes(usual[topic]):
            try:
                take(changed)
                drawn.take()
                for name, (_, usual_take, _) in drawn.inputs.items():
                    usual_take(usual[name])
                assert drawn.take() is not None
            except Exception as error:
                raised.append(f"{topic}: {what}: {type(error).__name__}: {error}")
    assert not raised, "\n".join(raised)


@pytest.fixture
def page():
    pytest.importorskip("viser", reason="the extra `view` is not installed")
    from soro_ros.view.page import ViewerPage
    from soro_ros.view.server import ViewServer

    server = ViewServer(Access(), 18480)
    yield ViewerPage(server, load_robot("tue_three_bellow"))
    server.stop()


@pytest.mark.process
def test_viewer(page):
    raised, usual = [], drawn_messages()
    received = Received("/arm")
    for topic in TOPICS:
        for what, changed in extremes(usual[topic]):
            try:
                received.take(topic, changed, 0.0)
                page.show([Moment(), received.moment(0.0)], at_once=True)
                for name in TOPICS:
                    received.take(name, usual[name], 0.0)
                assert received.moment(0.0).error_m == 0.0
            except Exception as error:
                raised.append(f"{topic}: {what}: {type(error).__name__}: {error}")
    assert not raised, "\n".join(raised)


def test_twin_with_commands(domain):
    with active(TwinNode, "mode:=lockstep", "duration_s:=0.0", "pose.enabled:=true") as node:
        seen, truth = captured(node, "chambers/state"), captured(node, "truth/chambers")
        information = HANDED_OVER
        raised = []
        makers = [
            ("chambers/command", lambda t: pressures(WARM, t)),
            ("chambers/commands", lambda t: Float64MultiArray(data=list(WARM))),
        ]
        for what, topic, at in each(*makers):
            try:
                receive(node, topic, at(node._tick_ns()), information)
                receive(node, "chambers/command", pressures(WARM, node._tick_ns()), information)
            except Exception as error:
                raised.append(f"{what}: {type(error).__name__}: {error}")
        assert not raised, "\n".join(raised)
        assert_finite(seen + truth)
        assert all(-5e3 <= x <= HIGHEST_PA for one in truth for x in one.effort)


def test_twin_of_measured_pressures(domain):
    with active(TwinNode, "pressures:=measured", "rate_hz:=200.0") as node:
        sent = captured(node, "truth/state")

        def good(k):
            receive(node, "chambers/state", pressures(EMPTY, k * TICK_NS))
            return k * TICK_NS

        raised = give_all(node, [("chambers/state", lambda t: pressures(WARM, t))], good)
        assert not raised, "\n".join(raised)
        assert_finite(sent)
        for k in range(10_001, 10_021):
            last_ns = good(k)
        assert messages.to_ns(sent[-1].header.stamp) == last_ns, "it goes on"


@pytest.fixture
def tracker(domain):
    """Publishes a pose every 20 ms, as a program of its own."""
    context, ended = rclpy.Context(), threading.Event()
    context.init()
    node = rclpy.create_node("tracker", context=context)
    publisher = node.create_publisher(PoseStamped, "/pose", 10)

    def publish():
        while not ended.wait(0.02):
            publisher.publish(upright(TICK_NS, ""))

    thread = threading.Thread(target=publish)
    thread.start()
    yield
    ended.set()
    thread.join()
    node.destroy_node()
    context.try_shutdown()


def test_pose_of_a_command(tracker):
    with PoseSource("/pose") as source:
        for what, changed in extremes(upright(TICK_NS, "")):
            source._on_pose(changed)
            assert messages.is_possible(source.newest()), what


MODELS = (
    ControllerNodeConfig,
    EstimatorNodeConfig,
    ExciterNodeConfig,
    MarkersConfig,
    Player.config_model,
    Recorder.config_model,
    RegulatorNode.config_model,
    ShadowConfig,
    TwinConfig,
    Viewer.config_model,
)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
@pytest.mark.parametrize("value", [*LARGE, *TINY, *(-x for x in (*LARGE, *TINY)), np.nan, np.inf, -np.inf])
def test_every_float_parameter_has_bounds(model, value):
    """At the start and by `ros2 param set`, which check a value in the same way."""
    accepted = []
    for name, (default, _) in parameters._flatten(model):
        if isinstance(default, list) and default and isinstance(default[0], float):
            extreme = [value, *default[1:]]
        elif isinstance(default, float):
            extreme = value
        else:
            continue
        with contextlib.suppress(ConfigError):
            parameters.checked({name: extreme}, model, "test")
            accepted.append(name)
    assert not accepted
