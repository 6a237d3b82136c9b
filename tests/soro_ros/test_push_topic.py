"""What pushes on the simulated arm by topic, the true force on it, and what moves its base."""

import signal
import subprocess
import sys

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.executors import SingleThreadedExecutor

from soro_ros.conversion import messages, qos
from soro_ros.conversion.force import force_of, wrench
from soro_ros.host import middleware
from soro_ros.nodes.twin import TwinNode
from soro_ros.topics.diagnostics import OK, WARN
from soro_ros.topics.intra_process import HANDED_OVER
from soro_ros.topics.twin_topics import PUSH_NS
from tests.patience import COMPILED_S
from tests.soro_ros.direct import active, captured, fire, receive, values
from tests.soro_ros.running import end, wait_until
from tests.warm import Popen

CHAMBERS = ("link0/chamber0", "link0/chamber1", "link0/chamber2")
TICK_NS = 5_000_000
FORCE = (0.05, 0.0, 0.0)


class LockstepTwin:
    """A twin node in lockstep, whose ticks are those of the commands that it is given."""

    def __init__(self, node):
        self.node, self.truth, self.tips = node, captured(node, "truth/wrench"), captured(node, "truth/tip")

    def push(self, force=FORCE, stamp_ns=0, frame="world"):
        receive(self.node, "external/wrench", wrench(force, stamp_ns, frame))

    def tick(self):
        """Advance by a tick; returns the true force [N] and the true tip [m] after it."""
        answered_ns = max(self.node._tick_ns() - TICK_NS, 0)  # what answers a tick acts from the next on
        command = messages.chambers(CHAMBERS, np.zeros(3), answered_ns)
        receive(self.node, "chambers/command", command, HANDED_OVER)
        return force_of(self.truth[-1]), messages.pose_arrays(self.tips[-1].pose)[0]


@pytest.fixture
def twin(domain):
    with active(TwinNode, "mode:=lockstep") as node:
        yield LockstepTwin(node)


def test_a_push_moves_the_tip_is_the_true_force_and_ends_at_its_age(twin):
    rest = twin.tick()[1]
    twin.push()
    found = [twin.tick() for _ in range(PUSH_NS // TICK_NS + 40)]
    acting = np.array([force for force, _ in found])
    count = PUSH_NS // TICK_NS
    assert acting[:count].tolist() == [pytest.approx(FORCE)] * count
    assert not acting[count:].any()
    assert {one.header.frame_id for one in twin.truth} == {"world"}
    assert messages.to_ns(twin.truth[-1].header.stamp) == messages.to_ns(twin.tips[-1].header.stamp)
    assert found[count - 1][1][0] - rest[0] > 5e-3
    assert found[-1][1][0] < found[count - 1][1][0], "it springs back"


def test_a_push_counts_from_its_stamp_and_a_newer_one_replaces_it(twin):
    for _ in range(150):
        twin.tick()
    now_ns = twin.node._tick_ns()
    twin.push(stamp_ns=now_ns - PUSH_NS + 2 * TICK_NS)
    assert [bool(twin.tick()[0].any()) for _ in range(4)] == [True, True, False, False]
    twin.push()
    twin.tick()
    twin.push((0.0, -0.02, 0.0))
    assert twin.tick()[0] == pytest.approx([0.0, -0.02, 0.0])


@pytest.mark.parametrize(
    ("bad", "why"),
    [
        ({"force": (np.nan, 0.0, 0.0)}, "at most 100 N and 10 N m along each axis, finite"),
        ({"force": (0.0, np.inf, 0.0)}, "finite"),
        ({"force": (0.0, 0.0, -101.0)}, "at most 100 N"),
        ({"stamp_ns": 10**18}, "in the future"),
        ({"stamp_ns": TICK_NS}, "old; allowed: at most 0.5 s"),
        ({"frame": "camera"}, "frame 'camera'; allowed: world (frames.world), or none"),
    ],
)
def test_what_is_no_push_is_refused_with_one_line(twin, capfd, bad, why):
    for _ in range(PUSH_NS // TICK_NS + 3):
        twin.tick()
    capfd.readouterr()
    for _ in range(3):
        twin.push(**bad)
    assert not twin.tick()[0].any()
    (line,) = [line for line in capfd.readouterr().err.splitlines() if "external/wrench" in line]
    assert why in line
    if "frame" in bad:
        fire(twin.node, 1.0)
        assert values(twin.node)["refused external/wrench"] == "3"
        assert twin.node.diagnostics.status.level == WARN
    twin.push(frame="")
    assert twin.tick()[0] == pytest.approx(FORCE)
    assert twin.node.diagnostics.status.level == OK


@pytest.fixture
def carried(domain):
    with active(TwinNode, "mode:=lockstep", "base_by_topic:=true") as node:
        yield LockstepTwin(node)


def base_pose(place=(0.0, 0.0, 0.0), quaternion=(0.0, 0.0, 0.0, 1.0), stamp_ns=0, frame="world"):
    message = messages.pose_stamped(np.eye(4), stamp_ns, frame)
    message.pose = messages.pose(np.array(place), np.array(quaternion))
    return message


def test_the_arm_rides_on_the_base_that_a_topic_moves(carried):
    rest = carried.tick()[1]
    receive(carried.node, "base/pose", base_pose((0.02, 0.0, 0.0)))
    tips = np.array([carried.tick()[1] for _ in range(400)])
    assert np.ptp(tips[:, 0]) > 0.02, "the arm swings on its base"
    assert tips[-1] == pytest.approx(rest + np.array([0.02, 0.0, 0.0]), abs=1e-4)
    half = np.sqrt(0.5)
    for k in range(1, 5):  # a quarter turn about its own axis, in steps
        turn = 0.125 * np.pi * k
        receive(
            carried.node,
            "base/pose",
            base_pose((0.02, 0.0, 0.0), (0.0, 0.0, np.sin(turn / 2), np.cos(turn / 2))),
        )
        carried.tick()
    for _ in range(100):
        carried.tick()
    quaternion = messages.pose_arrays(carried.tips[-1].pose)[1]
    assert abs(quaternion @ [0.0, 0.0, half, half]) == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize(
    ("bad", "why"),
    [
        ({"place": (np.nan, 0.0, 0.0)}, "finite numbers, and a quaternion of length 1"),
        ({"quaternion": (0.0, 0.0, 0.0, 0.0)}, "a quaternion of length 1"),
        (
            {"place": (0.5, 0.0, 0.0)},
            "0.5 m and 0 rad from the last pose; allowed: at most 0.2 m and 0.5 rad",
        ),
        ({"stamp_ns": 10**18}, "in the future"),
        ({"stamp_ns": TICK_NS}, "0.010 s older than the last; allowed: in their order"),
        ({"frame": "camera"}, "frame 'camera'; allowed: world (frames.world), or none"),
    ],
)
def test_what_is_no_pose_of_the_base_is_refused_with_one_line(carried, capfd, bad, why):
    for _ in range(3):
        carried.tick()
    receive(carried.node, "base/pose", base_pose(stamp_ns=3 * TICK_NS))
    rest = carried.tick()[1]
    capfd.readouterr()
    for _ in range(3):
        receive(carried.node, "base/pose", base_pose(**{"place": (0.02, 0.0, 0.0), **bad}))
    assert [carried.tick()[1] for _ in range(20)][-1] == pytest.approx(rest, abs=1e-4)
    (line,) = [line for line in capfd.readouterr().err.splitlines() if "base/pose" in line]
    assert why in line


def test_a_base_at_rest_has_no_topic(twin):
    assert not [one for one in twin.node.subscriptions if one.topic_name.endswith("base/pose")]


@pytest.mark.process
def test_a_publisher_of_any_program_pushes_a_twin_in_real_time(domain):
    command = [sys.executable, "-m", "soro_ros.nodes.twin", "--ros-args", "-r", "__ns:=/alone"]
    process = Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    middleware.init([])
    node, heard = rclpy.create_node("hand", namespace="/alone"), []
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        publisher = node.create_publisher(WrenchStamped, "external/wrench", 10)
        node.create_subscription(WrenchStamped, "truth/wrench", heard.append, qos.SENSOR)

        def is_there(force):
            executor.spin_once(timeout_sec=0.02)
            return bool(heard) and force_of(heard[-1]) == pytest.approx(force)

        wait_until(lambda: is_there([0.0, 0.0, 0.0]), "a twin that runs", COMPILED_S, every_s=0.0)

        def pushes():
            publisher.publish(wrench(FORCE, 0, ""))
            return is_there(FORCE)

        wait_until(pushes, "the push", every_s=0.0)
        wait_until(lambda: is_there([0.0, 0.0, 0.0]), "the end of a push that nobody repeats", every_s=0.0)
    finally:
        end(process, signal.SIGINT)
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
