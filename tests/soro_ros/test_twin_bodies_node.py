"""The twin node beside bodies: arms and bodies make their ticks together, also in real time."""

import numpy as np
import pytest
import rclpy
import yaml
from geometry_msgs.msg import WrenchStamped

from soro_core.robot import load_robot, save_robot
from soro_core.twin.world import ArmWorld
from soro_ros.conversion import messages
from soro_ros.nodes.twin import TwinNode
from tests.soro_ros.direct import captured, receive

BALL = {"shape": {"kind": "ball", "radius": 0.01}, "mass": 0.1, "position": [0.0, 0.5, 1.0]}
# Far from both arms.
WALL = {"shape": {"kind": "box", "size": [0.02, 0.2, 0.2]}, "fixed": True, "position": [0.0, 0.0, 0.5]}


@pytest.fixture
def nodes(domain, tmp_path):
    """Two twins beside bodies, in real time, of one world."""
    file = tmp_path / "bodies.yaml"
    file.write_text(yaml.safe_dump({"bodies": {"ball": BALL, "wall": WALL}}))
    robot = tmp_path / "apart.yaml"
    save_robot(load_robot("tue_three_bellow").replace(base_position=(-1.0, 0.0, 0.0)), robot)
    keys = {"mode": "real_time", "bodies_file": str(file), "refine": 1}
    each = {"/hand/left/twin": keys, "/hand/right/twin": {**keys, "robot": str(robot)}}
    settings = tmp_path / "settings.yaml"
    settings.write_text(yaml.safe_dump({name: {"ros__parameters": own} for name, own in each.items()}))
    rclpy.init(args=["--ros-args", "--params-file", str(settings)])
    world = ArmWorld()
    made = [TwinNode(f"/hand/{name}", world) for name in ("left", "right")]
    try:
        for node in made:
            assert node.trigger_configure().name == "SUCCESS", node.failure
        yield made
    finally:
        for node in made:
            node.destroy_node()
        rclpy.shutdown()


def test_one_timer_makes_the_ticks_of_arms_and_bodies_in_real_time(nodes):
    left, right = nodes
    heard, contacts = captured(left, "/hand/bodies/ball/pose"), captured(left, "/hand/bodies/contacts")
    left.trigger_activate()
    assert not left._timers_active  # its time begins with that of the other one
    right.trigger_activate()
    assert [len(node._timers_active) for node in nodes] == [0, 1]
    right._start_s -= 0.1  # 20 ticks are due, and what has passed since
    right._advance_real_time()
    tick = left.state.tick
    assert 20 <= tick == right.state.tick
    assert len(heard) == len(contacts) == tick
    fallen = BALL["position"][2] - np.array([one.pose.position.z for one in heard])
    np.testing.assert_allclose(fallen, 0.5 * 9.81 * (0.005 * np.arange(tick)) ** 2, atol=1e-9)
    stamps = np.array([messages.to_ns(one.header.stamp) for one in heard])
    np.testing.assert_allclose(np.diff(stamps), 5e6)


def test_a_push_beside_bodies_is_refused(nodes):
    left, _ = nodes
    message = WrenchStamped()
    message.wrench.force.x = 1.0
    receive(left, "external/wrench", message)
    assert np.all(left._push.now()[0] == 0.0)
