"""References by topic: what the first one takes in the callback, and how late a stream is followed."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np

from benchmarks.options import Options
from benchmarks.report import table
from soro_core.control import Reference
from soro_core.loop import LoopState
from soro_core.twin import Twin
from soro_lab.scene import load_scene
from soro_lab.scene.loop import loop_of

TITLE = "References by topic"
RADIUS_M, PERIOD_S, HEIGHT_M = 0.012, 6.0, 0.066
# The first seconds are the way to the circle.
FROM_S, SECONDS = 5.0, 11.0
RATES = (5, 20, 50, 200)

FIRST = """
import json, time
import numpy as np, rclpy
from rclpy.duration import Duration
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from soro_ros.conversion import messages
from soro_ros.nodes.controller import ControllerNode
from tests.soro_ros.direct import receive

rclpy.init()
node = ControllerNode()
node.trigger_configure()
node.trigger_activate()
pose = np.eye(4)
pose[:3, 3] = 0.01, 0.0, 0.066
tip = messages.pose_stamped(pose, 0, "world")
names = ["link0/elongation", "link0/bending_x", "link0/bending_y"]
points = [
    JointTrajectoryPoint(positions=[0.01 * k, 0.0, 0.0], time_from_start=Duration(seconds=k).to_msg())
    for k in range(1, 4)
]
trajectory = JointTrajectory(joint_names=names, points=points)
found = []
for topic, message in 2 * (("arm/reference/tip", tip), ("arm/reference/trajectory", trajectory)):
    begin = time.perf_counter()
    receive(node, topic, message)
    found.append(1e3 * (time.perf_counter() - begin))
print(json.dumps(found))
"""


def run(options: Options) -> str:
    """Measure and write."""
    return f"{first(options)}\n\n{streams(options)}"


def first(options: Options) -> str:
    """The first and the second message of each kind, in fresh processes."""
    runs = []
    for k in range(options.pick(5, 1)):
        options.say(f"first reference, process {k + 1}")
        environment = {**os.environ, "ROS_DOMAIN_ID": "99"}
        done = subprocess.run([sys.executable, "-c", FIRST], capture_output=True, text=True, env=environment)
        if done.returncode != 0:
            raise RuntimeError(done.stderr)
        runs.append(json.loads(done.stdout.splitlines()[-1]))
    low, high = np.min(runs, axis=0), np.max(runs, axis=0)
    kinds = ("first tip", "first trajectory", "second tip", "second trajectory")
    rows = [[kind, f"{a:.1f} to {b:.1f}"] for kind, a, b in zip(kinds, low, high, strict=True)]
    return table([f"callback, ms ({len(runs)} fresh processes)", "least to most"], rows)


def streams(options: Options) -> str:
    """A circle on arm/reference/tip at several rates, in lockstep on the twin."""
    rows = []
    for hz in options.pick(RATES, RATES[-1:]):
        options.say(f"stream at {hz} Hz")
        t, wanted, tip = follow(hz)
        (late, off), (tip_late, tip_off) = (lag(t, path) for path in (wanted, tip))
        rows.append(
            [hz, f"{1e3 * late:.0f}", f"{1e3 * off:.2f}", f"{1e3 * tip_late:.0f}", f"{1e3 * tip_off:.2f}"]
        )
    head = [
        "messages a second",
        "reference late, ms",
        "off the circle, mm RMS",
        "tip late, ms",
        "off, mm RMS",
    ]
    return (
        f"A circle of {1e3 * RADIUS_M:.0f} mm in {PERIOD_S:g} s, pose by pose, in lockstep on the twin of "
        f"the three-bellow arm without load; from {FROM_S:g} s on.\n\n{table(head, rows)}"
    )


def circle(t: np.ndarray | float) -> np.ndarray:
    """Positions (..., 3) [m] that are sent at time `t` [s]."""
    phase = 2.0 * np.pi * np.asarray(t) / PERIOD_S
    return np.stack(
        [RADIUS_M * np.cos(phase), RADIUS_M * np.sin(phase), np.full_like(phase, HEIGHT_M)], axis=-1
    )


def follow(hz: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (n,), and positions (n, 3) of the reference and of the true tip."""
    changes = {
        "platform": "",
        "mode": "lockstep",
        "twin.payload_kg": 0.0,
        "controller.reference.kind": "hold",
    }
    scene = load_scene("track_circle", changes)
    twin, loop = Twin(scene.loaded_robot, scene.twin_node()), loop_of(scene)
    sent: list[Reference] = []

    def newest(t: float, state: LoopState) -> Reference:
        if t * hz >= len(sent):
            sent.append(loop.controller.tip(state.controller, circle(t)))
        return sent[-1]

    ticks = loop.run(twin, round(SECONDS / twin.dt), twin.dt, reference=newest, before_s=-twin.dt)
    rows = [
        (tick.t_s, tick.command.tip_reference[:3, 3], tick.seen.tip[:3, 3])
        for tick in ticks
        if tick.command.status.ok
    ]
    times, wanted, tip = zip(*rows, strict=True)
    return np.array(times), np.array(wanted), np.array(tip)


def lag(t: np.ndarray, path: np.ndarray) -> tuple[float, float]:
    """Delay [s] at which a path is nearest to the circle that was sent, and RMS distance from it then [m]."""
    late = t > FROM_S
    delays = np.arange(0.0, 0.8, 0.001)
    errors = [np.sqrt(np.mean(np.sum((path[late] - circle(t[late] - x)) ** 2, axis=1))) for x in delays]
    best = int(np.argmin(errors))
    return float(delays[best]), float(errors[best])
