"""The first message of each kind imports no module and compiles no kernel: both would hold up the loop."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.process

# A fresh process: this one has imported and compiled what others needed.
COUNT = """
import gc, sys
from tests.soro_ros.direct import fire, receive, request
import numpy as np
import rclpy
from numba.core.dispatcher import Dispatcher

def compiled():
    found = [one for one in gc.get_objects() if isinstance(one, Dispatcher)]
    return {f"{one.py_func.__module__}.{one.__name__} {s}" for one in found for s in one.signatures}

def count(name, callback, times=1):
    modules, kernels = set(sys.modules), compiled()  # takes longer than a hundred ticks
    for _ in range(times):
        callback()
    for new in [*sorted(set(sys.modules) - modules), *sorted(compiled() - kernels)]:
        print(f"{name}: {new}")
"""

CONTROLLER = """
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.duration import Duration
from rclpy.serialization import deserialize_message, serialize_message
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from soro_core.control.laws import Certainty
from soro_ros.conversion import learning, messages
from soro_ros.nodes.controller import ControllerNode

# The counting takes longer than the shipped age of samples.
settings = ("control.enable.sample_age_s:=10.0", "control.law:=composite", "control.probe_at_enable:='off'")
rclpy.init(args=["--ros-args", *(part for one in settings for part in ("-p", one))])
node = ControllerNode()
node.trigger_configure()
node.trigger_activate()
assert node.failure is None
names = ["link0/elongation", "link0/bending_x", "link0/bending_y"]
chambers = ["link0/chamber0", "link0/chamber1", "link0/chamber2"]

def arrived(message):
    return deserialize_message(serialize_message(message), type(message))

def tick():
    now = node.get_clock().now().nanoseconds
    receive(node, "chambers/state", arrived(messages.chambers(chambers, np.zeros(3), now)))
    certainty = Certainty(1e-12 * np.eye(6), positions=True)  # the learner takes this sample
    receive(node, "arm/covariance", arrived(learning.covariance(certainty, now)))
    receive(node, "arm/state", arrived(messages.arm_state(names, np.zeros(3), np.zeros(3), np.zeros(3), now)))

def tip(x):
    pose = np.eye(4)
    pose[:3, 3] = x, 0.0, 0.066
    return arrived(messages.pose_stamped(pose, 0, "world"))

def at(seconds):
    return Duration(seconds=seconds).to_msg()

def trajectory(**rows):
    points = [
        JointTrajectoryPoint(positions=[0.01 * k, 0.0, 0.0], time_from_start=at(k), **rows)
        for k in range(1, 4)
    ]
    return arrived(JointTrajectory(joint_names=names, points=points))

def follow(message):
    receive(node, "arm/reference/trajectory", message)

zero = [0.0, 0.0, 0.0]
def path(x):
    message = Path(poses=[tip(0.0), tip(x)])
    message.header.frame_id = "world"
    return arrived(message)

count("tick", tick)
for q, fits in (((1.0, 0.0, 0.0, 0.0), False), ((0.0, 0.0, 0.0, 1.0), True)):
    pose = PoseStamped(pose=messages.pose(np.array([0.0, 0.0, 0.064]), np.array(q)))
    count("pose", lambda: receive(node, "sensors/pose0", serialize_message(pose)))
    answers = []
    count("enable", lambda: answers.append(request(node, "~/enable")))
    assert answers[-1].success == fits
count("enabled tick", tick)
assert node.state.law.learner.passed_s > 0.0
assert node.diagnostics.status.message == "active"
for name, callback in (
    ("tip", lambda: receive(node, "arm/reference/tip", tip(0.01))),
    ("cubic spline", lambda: follow(trajectory())),
    ("cubic", lambda: follow(trajectory(velocities=zero))),
    ("quintic", lambda: follow(trajectory(velocities=zero, accelerations=zero))),
):
    count(name, callback)
    count(f"tick after {name}", tick)
    assert node.diagnostics.status.message == "active"
count("path", lambda: receive(node, "arm/reference/path", path(0.004)))
count("tick of a plan", tick, 100)
count("unreachable path", lambda: receive(node, "arm/reference/path", path(0.4)))
count("tick of a plan that fails", tick, 20)
count("unreachable", lambda: receive(node, "arm/reference/tip", tip(0.5)))
count("report", lambda: fire(node, 1.0))
"""

ESTIMATOR = """
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import Imu
from soro_core.adaptation import Learned
from soro_ros.conversion import learning, messages
from soro_ros.nodes.estimator import EstimatorNode

rclpy.init()
node = EstimatorNode()
node.trigger_configure()
node.trigger_activate()
assert node.failure is None
chambers = ["link0/chamber0", "link0/chamber1", "link0/chamber2"]
pose = np.eye(4)
pose[2, 3] = 0.064
stamp = node.get_clock().now().nanoseconds

def reading():
    global stamp
    stamp += 5_000_000
    receive(node, "chambers/state", messages.chambers(chambers, np.zeros(3), stamp))

def learned():
    theta = np.concatenate([[0.02], 0.01 * np.arange(14)])
    receive(node, "arm/learned", learning.learned(Learned(theta), stamp))

def imu():
    message = Imu()
    message.header.stamp = messages.to_time(stamp)
    message.linear_acceleration.z = 9.81
    receive(node, "sensors/imu0", message)

for name, callback in (
    ("first reading", reading),
    ("reading", reading),
    ("pose", lambda: receive(node, "sensors/pose0", messages.pose_stamped(pose, stamp, "world"))),
    ("reading after a pose", reading),
    ("imu", imu),
    ("reading after an imu sample", reading),
    ("learned", learned),
    ("reading after a learned force", reading),
    ("report", lambda: fire(node, 1.0)),
):
    count(name, callback)
"""


@pytest.mark.timeout(300)
@pytest.mark.parametrize("node", ["controller", "estimator"])
def test_the_first_message_of_each_kind_imports_and_compiles_nothing(domain, node):
    script = COUNT + {"controller": CONTROLLER, "estimator": ESTIMATOR}[node]
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
