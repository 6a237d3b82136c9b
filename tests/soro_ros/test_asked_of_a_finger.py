"""What a hand asks of a finger in lockstep counts from its tick, in whatever order a recorder noted it."""

import numpy as np
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from soro_core.config import with_changes
from soro_lab.scene import load_scene
from soro_ros.conversion import messages
from soro_ros.ticks.controller_ticks import ControllerTicks
from soro_ros.topics.ports import NodeOutputs

TICK_NS, TICKS = 5_000_000, 40
# Shapes by the tick that they are asked for.
ASKED = {3: [0.02, -1.0, 0.0], 17: [0.04, -3.0, 0.1], 30: [0.03, -2.0, 0.0]}


def commands(order):
    """Set points of a finger; `order` sorts (topic, tick) of the messages that it gets."""
    arm = load_scene("grasp_ball", {"mode": "lockstep"}).each[0]
    robot, found = arm.loaded_robot, []

    def publish(topic, message):
        if topic == "chambers/command":
            found.append(list(message.effort))

    config = with_changes(arm.controller_node(), enabled=True, hand=True)
    ticks = ControllerTicks(config, f"/{arm.name}/controller", NodeOutputs(publish))
    still = np.zeros(robot.n_q)

    def make(topic, k):
        if topic == "chambers/state":
            return messages.chambers(robot.chamber_names, np.zeros(3), k * TICK_NS)
        if topic == "arm/state":
            return messages.arm_state(robot.coordinate_names, still, still, still, k * TICK_NS)
        message = JointTrajectory()
        message.header.stamp = messages.to_time(k * TICK_NS)
        if k in ASKED:
            message.joint_names = robot.coordinate_names
            message.points = [JointTrajectoryPoint(positions=ASKED[k])]
        return message

    topics = "chambers/state", "arm/state", "arm/reference/trajectory"
    sent = [(topic, k) for k in range(1, TICKS) for topic in topics]
    for topic, k in sorted(sent, key=order):
        ticks.inputs[topic].take(make(topic, k))
    return found


def test_the_order_in_which_topics_come_does_not_matter():
    live = commands(lambda one: one[1])
    assert len(live) == TICKS - 1
    assert len({tuple(one) for one in live}) > 3  # it follows what is asked
    assert commands(lambda one: (one[0] != "arm/reference/trajectory", one[1])) == live
    assert commands(lambda one: (one[0] == "arm/reference/trajectory", one[1])) == live
