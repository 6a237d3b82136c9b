"""Which services the buttons call: real nodes of two arms in one process."""

import pytest
import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from soro_ros.host import middleware
from soro_ros.view.live import Buttons
from tests.soro_ros.conftest import own_domain
from tests.soro_ros.running import wait_until

ARMS = {
    "arm/regulator": ("vent", "reset"),
    "arm/controller": ("vent", "reset", "enable"),
    "arm2/regulator": ("vent", "reset"),
}


@pytest.fixture
def arms(tmp_path_factory):
    """Two arms: what was called, and a function that presses a button and waits for the answers."""
    with own_domain(tmp_path_factory.mktemp("state")):
        middleware.init()
        called, told, executor = [], [], EventsExecutor()

        def answering(service):
            def answer(request, response):
                called.append(service)
                response.success, response.message = service != "arm/controller/enable", "done"
                return response

            return answer

        for arm, services in ARMS.items():
            namespace, _, name = arm.partition("/")
            node = Node(name, namespace=namespace)
            for service in services:
                node.create_service(Trigger, f"~/{service}", answering(f"{arm}/{service}"))
            if name == "regulator":
                node.create_publisher(JointState, "chambers/state", 1)
            executor.add_node(node)
        viewer = Node("viewer", namespace="arm")
        executor.add_node(viewer)
        buttons = Buttons(viewer, told.append)

        def press(button, answers):
            called.clear()
            told.clear()
            buttons.press(button)
            wait_until(
                lambda: executor.spin_once(timeout_sec=0.02) or buttons.work() or len(told) == answers, button
            )
            return sorted(called), sorted(told)

        try:
            yield press
        finally:
            buttons.close()
            executor.shutdown()
            rclpy.shutdown()


def test_vent_is_for_all_nodes_of_this_arm_and_reset_for_the_one_with_the_latch(arms):
    called, told = arms("vent", 2)
    assert called == ["arm/controller/vent", "arm/regulator/vent"]
    assert told == ["arm/controller/vent: done", "arm/regulator/vent: done"]
    assert arms("reset", 1)[0] == ["arm/regulator/reset"]
    assert arms("enable", 1) == (["arm/controller/enable"], ["arm/controller/enable: refused: done"])


def test_a_button_that_nobody_serves_says_so(arms):
    assert arms("dance", 1) == ([], ["dance: no node in /arm offers it"])
