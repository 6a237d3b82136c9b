"""What arm/motion answers to references on topics: accepted, refused, reached or aborted, and why."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from rclpy.duration import Duration
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from soro_ros.conversion import messages
from tests.soro_ros.direct import receive, request
from tests.soro_ros.test_motion_topic import NAMES, Ticked, controller

TIP, TRAJECTORY = "arm/reference/tip", "arm/reference/trajectory"


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    from tests.soro_ros.conftest import own_domain

    with own_domain(tmp_path_factory.mktemp("state")):
        yield


def send_tip(it: Ticked, x: float, stamp_s: float, frame: str = "world") -> None:
    message = PoseStamped(pose=messages.pose(np.array([x, 0.0, 0.066]), np.array([0.0, 0.0, 0.0, 1.0])))
    message.header.frame_id, message.header.stamp = frame, messages.to_time(round(stamp_s * 1e9))
    receive(it.node, TIP, message)


def send_trajectory(it: Ticked, *points: tuple[float, list[float]], stamp_s: float) -> None:
    rows = [
        JointTrajectoryPoint(positions=q, time_from_start=Duration(seconds=t).to_msg()) for t, q in points
    ]
    message = JointTrajectory(joint_names=NAMES, points=rows)
    message.header.stamp = messages.to_time(round(stamp_s * 1e9))
    receive(it.node, TRAJECTORY, message)


def answers(it: Ticked) -> list[tuple[str, str, float]]:
    """State, last part of the topic, and stamp [s], each once in a row."""
    found = []
    for report in it.reports:
        values = {pair.key: pair.value for pair in report.values}
        answer = (report.name, values["topic"].rpartition("/")[2], int(values["stamp_ns"]) * 1e-9)
        if not found or found[-1] != answer:
            found.append(answer)
    return found


def test_a_pose_is_answered_until_the_tip_is_there(alone):
    with controller() as it:
        send_tip(it, 0.01, stamp_s=1.0)
        assert answers(it) == [("moving", "tip", 1.0)]
        start_s = it.t_s
        it.until("reached")
        assert it.wanted == pytest.approx([0.01, 0.0, 0.066], abs=1e-4)
        assert it.t_s > start_s
        send_tip(it, 0.01, stamp_s=2.0)  # the arm is there
        send_tip(it, 0.3, stamp_s=3.0)
        assert "allowed: a point that the tip can reach" in it.reports[-1].message
        send_tip(it, 0.0, stamp_s=4.0, frame="camera")
        expected = [("moving", "tip", 1.0), ("reached", "tip", 1.0), ("reached", "tip", 2.0)]
        assert answers(it) == [*expected, ("refused", "tip", 3.0), ("refused", "tip", 4.0)]
        it.tick(50)
        assert it.states[-1] == "refused"
        assert it.wanted == pytest.approx([0.01, 0.0, 0.066], abs=1e-4)


@pytest.mark.slow
def test_a_stream_is_one_motion_that_is_reached_after_its_last_message(alone):
    with controller("control.reference.start_s:=0.05") as it:
        for k in range(30):
            send_tip(it, 0.0004 * k, stamp_s=1.0 + 0.1 * k)
            it.tick(20)
        assert it.states == ["moving"]
        it.until("reached")
        assert answers(it)[0] == ("moving", "tip", 1.0)
        assert answers(it)[-1][1:] == ("tip", pytest.approx(3.9))
        assert it.wanted == pytest.approx([0.0116, 0.0, 0.066], abs=1e-4)


def test_a_trajectory_is_reached_at_its_end(alone):
    with controller() as it:
        rest, bent = [0.02, 0.0, 0.0], [0.02, 5.0, 0.0]
        send_trajectory(it, (0.5, rest), (1.5, rest), (2.5, bent), stamp_s=1.0)
        start_s = it.t_s
        it.tick(250)
        assert it.states == ["moving"], "it rests on the way, where the tip is near"
        it.until("reached")
        assert it.t_s - start_s == pytest.approx(2.5, abs=0.1)
        send_trajectory(it, (0.5, [9.0, 0.0, 0.0]), stamp_s=2.0)
        assert answers(it)[-1] == ("refused", "trajectory", 2.0)


def test_what_ends_a_reference_before_its_goal_is_named(alone):
    with controller("control.motion.settle_s:=0.1") as it:
        it.follows = False
        send_tip(it, 0.01, stamp_s=1.0)
        assert "motion.reached_m" in it.until("lost")
        it.follows = True
        send_tip(it, 0.0, stamp_s=2.0)
        send_trajectory(it, (0.5, [0.02, 0.0, 0.0]), stamp_s=3.0)
        assert answers(it)[-2:] == [("replaced", "tip", 2.0), ("moving", "trajectory", 3.0)]
        it.send([0.0, 0.0, 0.066], [0.01, 0.0, 0.066], stamp_s=4.0)  # goes on until the path begins
        it.tick(2)
        it.until("reached")
        path = [(state, "path", 4.0) for state in ("planning", "moving", "reached")]
        assert answers(it)[-4:] == [path[0], ("replaced", "trajectory", 3.0), *path[1:]]
        send_tip(it, 0.0, stamp_s=5.0)
        request(it.node, "~/vent")
        assert answers(it)[-1] == ("vented", "tip", 5.0)
        send_tip(it, 0.0, stamp_s=6.0)
        assert answers(it)[-1] == ("refused", "tip", 6.0)
        assert "soro enable" in it.reports[-1].message
        assert request(it.node, "~/enable").success
        assert "refused" not in it.node.diagnostics.status.message
