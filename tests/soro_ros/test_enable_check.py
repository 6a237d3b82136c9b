"""~/enable with samples that are missing, old or wrong."""

import contextlib
import time

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu, JointState

from soro_ros.conversion import messages, qos
from soro_ros.host import middleware
from soro_ros.nodes.controller import ControllerNode
from soro_ros.topics.diagnostics import ERROR, OK
from tests.soro_ros.conftest import own_domain
from tests.soro_ros.direct import receive, request
from tests.soro_ros.running import wait_until

NAMES = ["link0/elongation", "link0/bending_x", "link0/bending_y"]
CHAMBERS = ["link0/chamber0", "link0/chamber1", "link0/chamber2"]


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    with own_domain(tmp_path_factory.mktemp("state")):
        yield


@contextlib.contextmanager
def controller(*settings):
    middleware.init(["--ros-args", *(part for setting in settings for part in ("-p", setting))])
    try:
        node = ControllerNode()
        node.trigger_configure()
        assert node.failure is None
        node.trigger_activate()
        yield node
        node.destroy_node()
    finally:
        rclpy.shutdown()


def see(node, pressure_pa=0.0, upside_down=None, up_m_s2=None):
    """A reading, an estimate, and samples of the sensors that are there."""
    now_ns, zero = node.get_clock().now().nanoseconds, np.zeros(3)
    receive(node, "chambers/state", messages.chambers(CHAMBERS, np.full(3, pressure_pa), now_ns))
    receive(node, "arm/state", messages.arm_state(NAMES, zero, zero, zero, now_ns))
    if upside_down is not None:
        pose = np.diag([1.0, -1.0, -1.0, 1.0]) if upside_down else np.eye(4)
        pose[2, 3] = 0.064 * pose[2, 2]
        receive(node, "sensors/pose0", serialize_message(messages.pose_stamped(pose, now_ns, "world")))
    if up_m_s2 is not None:
        imu = Imu()
        imu.linear_acceleration.x, imu.linear_acceleration.z = up_m_s2
        imu.orientation_covariance[0] = -1.0
        receive(node, "sensors/imu0", serialize_message(imu))


def answer(node, service="enable"):
    response = request(node, f"~/{service}")
    return response.success, response.message


def test_an_arm_is_enabled_once_it_is_seen_at_rest_without_pressure(alone):
    with controller() as node:
        success, text = answer(node)
        assert not success
        assert "no chambers/state" in text
        assert "no arm/state" in text
        assert answer(node, "enable_anyway")[0] is False  # without samples there is nothing to control
        see(node, pressure_pa=5e3)
        success, text = answer(node)
        assert not success
        assert "link0/chamber0 is at 5.0 kPa" in text
        see(node, upside_down=True)
        success, text = answer(node)
        assert not success
        assert "sensors/pose0" in text
        assert "[1.000, 0.000, 0.000, 0.000]" in text
        see(node, upside_down=False, up_m_s2=(9.8, 0.0))
        success, text = answer(node)
        assert not success
        assert "sensors/imu0 is 90 degrees" in text
        see(node, upside_down=False, up_m_s2=(0.0, 9.8))
        assert answer(node) == (True, "enabled")
        # Enabled already: not checked.
        see(node, pressure_pa=50e3, upside_down=True)
        assert answer(node) == (True, "enabled")


@pytest.mark.parametrize("service", ["enable", "enable_anyway"])
def test_an_arm_whose_latch_is_closed_is_not_enabled(alone, service):
    """Its probe would find no pressure, and blame a valve; also where it was enabled before the trip."""
    closed = DiagnosticStatus(level=ERROR, message="vented: vent requested")
    with controller() as node:
        see(node)
        receive(node, "chambers/latch", closed)
        assert answer(node, service) == (False, "the arm is vented: soro reset first")
        receive(node, "chambers/latch", DiagnosticStatus(level=OK, message="open"))
        see(node)
        assert answer(node, service)[0]
        receive(node, "chambers/latch", closed)
        assert answer(node, service) == (False, "the arm is vented: soro reset first")


def test_a_sensor_that_has_fallen_silent_refuses(alone, monkeypatch):
    with controller() as node:
        see(node, upside_down=False)
        now = time.monotonic
        monkeypatch.setattr(time, "monotonic", lambda: now() + 2.0)
        see(node)
        success, text = answer(node)
        monkeypatch.undo()
        assert not success
        assert "sensors/pose0 is 2.0 s old" in text


def test_zero_is_commanded_while_the_check_takes_its_time(alone):
    """The driver trips on commands that stay away for a tenth of a second."""
    commands = []
    with controller("rate_hz:=1000.0") as node:
        listener = rclpy.create_node("listener")
        topic = node.resolve_topic_name("chambers/command")
        listener.create_subscription(JointState, topic, commands.append, qos.loop(False))
        wait_until(lambda: node.count_subscribers(topic), "the listener")
        see(node, upside_down=True)
        begin_ns = node.get_clock().now().nanoseconds
        assert answer(node)[0] is False
        end_ns = node.get_clock().now().nanoseconds

        def during():
            rclpy.spin_once(listener, timeout_sec=0.05)
            return [one for one in commands if begin_ns < messages.to_ns(one.header.stamp) < end_ns]

        wait_until(lambda: len(during()) > 1, "commands of the time of the check")
        assert all(list(one.effort) == [0.0, 0.0, 0.0] for one in during())
        # Samples that have waited are older than the last command, which the driver refuses.
        receive(node, "arm/state", messages.arm_state(NAMES, *np.zeros((3, 3)), begin_ns))
        see(node)

        def stamps():
            return [messages.to_ns(one.header.stamp) for one in commands]

        wait_until(lambda: during() and stamps()[-1] > end_ns, "the next command")
        assert begin_ns not in stamps()
        # Nor does the first command of an enabled controller answer an older one.
        see(node, upside_down=False)
        late_ns = node.get_clock().now().nanoseconds
        receive(node, "chambers/state", messages.chambers(CHAMBERS, np.zeros(3), late_ns))
        assert answer(node)[0] is True
        receive(node, "arm/state", messages.arm_state(NAMES, *np.zeros((3, 3)), late_ns))
        enabled_ns = node.get_clock().now().nanoseconds
        see(node, upside_down=False)
        wait_until(lambda: during() and stamps()[-1] > enabled_ns, "the first command of the law")
        assert late_ns not in stamps()
        listener.destroy_node()


@pytest.mark.parametrize(
    ("how", "service"), [("warn", "enable"), ("refuse", "enable_anyway"), ("off", "enable")]
)
def test_a_finding_may_only_warn(alone, capfd, how, service):
    with controller(f"control.check_at_enable:='{how}'") as node:
        if how != "off":
            see(node, pressure_pa=5e3, upside_down=True)
        success, text = answer(node, service)
        assert success
        for part in ("link0/chamber0", "sensors/pose0"):
            assert (part in text) == (how != "off")
            assert (part in capfd.readouterr().err) == (how != "off") or part == "sensors/pose0"
