"""Motions along paths: how far the tip is from its timed reference, with a load that the law has to learn."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence

import numpy as np

from benchmarks.options import Options
from benchmarks.report import table
from soro_core.control import Reference
from soro_core.control.motions.motion_parts import PiecewiseMotion
from soro_core.control.motions.tip_path import corners
from soro_core.control.reference.active_reference import reference_ahead
from soro_core.loop import Loop, LoopState
from soro_core.planning.steps import finished
from soro_core.twin import Twin
from soro_lab.scene import Scene, load_scene
from soro_lab.scene.loop import loop_of

TITLE = "Motions of the tip"
# The law learns on the circle of the scene before the motion begins.
LEARNING_S = 10.0
HEIGHT_M = 0.066
SIDE_M = 0.010
PATHS: dict[str, np.ndarray] = {
    "line of 30 mm": np.array([[-0.015, 0.0, HEIGHT_M], [0.015, 0.0, HEIGHT_M]]),
    "square of 20 mm": corners(
        [
            np.array([x * SIDE_M, y * SIDE_M, HEIGHT_M])
            for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))
        ]
    ),
}
SPEED_M_S = 0.04
SEEDS = (1, 2, 3, 4, 5)
LAWS = ("composite", "adaptive")


# A controller in real time that gets its states directly.
LATENESS = """
import json, sys, time
import numpy as np, rclpy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from soro_ros.conversion import messages
from soro_ros.nodes.controller import ControllerNode
from tests.soro_ros.direct import after_publish, captured, receive, request

rclpy.init()
node = ControllerNode()
node.trigger_configure()
node.trigger_activate()
names = ["link0/elongation", "link0/bending_x", "link0/bending_y"]
chambers = ["link0/chamber0", "link0/chamber1", "link0/chamber2"]
sent, reports = [0.0], captured(node, "arm/motion")
after_publish(node, "chambers/command", lambda: sent.append(time.perf_counter()))
zero, period, due = np.zeros(3), 1.0 / 200.0, time.perf_counter()

def tick():
    global due
    due = max(due + period, time.perf_counter())
    time.sleep(max(due - time.perf_counter(), 0.0))
    now, q = node.get_clock().now().nanoseconds, getattr(node.state.point, "q", zero)
    receive(node, "chambers/state", messages.chambers(chambers, zero, now))
    started = time.perf_counter()
    receive(node, "arm/state", messages.arm_state(names, q, zero, zero, now))
    return 1e3 * (sent[-1] - started), 1e3 * (time.perf_counter() - started)

tick()
request(node, "~/enable_anyway")
plain = [tick() for _ in range(400)]
upright = np.array([0.0, 0.0, 0.0, 1.0])
poses = [messages.pose(np.array(p), upright) for p in json.load(sys.stdin)]
planned, taken = [], []
for k in range(5):
    path = Path(poses=[PoseStamped(pose=pose) for pose in poses])
    path.header.frame_id, path.header.stamp.sec = "world", k
    receive(node, "arm/reference/path", path)
    before = len(planned)
    while reports[-1].name == "planning" and len(planned) < before + 2000:
        planned.append(tick())
    taken.append(len(planned) - before)
print(json.dumps([plain, planned, taken, reports[-1].name]))
"""


def run(options: Options) -> str:
    """Measure and write."""
    return f"{tracking(options)}\n\n{lateness(options)}"


def lateness(options: Options) -> str:
    """What a tick of the controller takes while a motion is planned."""
    options.say("ticks beside a plan")
    path = json.dumps(PATHS["square of 20 mm"].tolist())
    environment = {**os.environ, "ROS_DOMAIN_ID": "99"}
    done = subprocess.run(
        [sys.executable, "-c", LATENESS], input=path, capture_output=True, text=True, env=environment
    )
    if done.returncode != 0:
        raise RuntimeError(done.stderr)
    plain, planned, taken, state = json.loads(done.stdout.splitlines()[-1])
    rows = []
    for name, ticks in (("without a plan", plain), ("while the square is planned", planned)):
        command, whole = np.array(ticks).T
        late = 100.0 * np.mean(whole > 5.0)
        figures = [f"{np.percentile(values, q):.2f}" for values in (command, whole) for q in (50, 99)]
        rows.append([name, len(command), *figures, f"{late:.1f}"])
    head = ["ticks", "number", "command, p50 ms", "p99", "whole tick, p50 ms", "p99", "beyond 5 ms, %"]
    return (
        "Time of a tick at 200 Hz in a node in real time, from the state to the command and to its end, the "
        f"slice of the plan included. A plan of the square takes {min(taken)} to {max(taken)} ticks "
        f"({len(taken)} plans, the last one {state}).\n\n{table(head, rows)}"
    )


def tracking(options: Options) -> str:
    """How far the tip is from its timed reference."""
    rows = []
    for law in options.pick(LAWS, LAWS[:1]):
        for name, path in list(PATHS.items())[: options.pick(None, 1)]:
            found = []
            for seed in options.pick(SEEDS, SEEDS[:1]):
                options.say(f"{law}: {name}, seed {seed}")
                found.append(error(law, path, seed, options.pick(LEARNING_S, 4.0)))
            errors, largest, factors = np.array(found).T
            low, mean, high = (1e3 * f(errors) for f in (np.min, np.mean, np.max))
            rows.append(
                [
                    law,
                    name,
                    f"{mean:.3f}",
                    f"{low:.3f} to {high:.3f}",
                    f"{1e3 * largest.max():.2f}",
                    f"{factors.max():.2f}",
                ]
            )
    head = ["law", "motion", "RMS, mm", "least to most", "largest, mm", "factor of time"]
    return (
        f"The twin of `track_circle` (20 g, four links) in lockstep: {LEARNING_S:g} s on its "
        f"circle, then the motion at {1e3 * SPEED_M_S:g} mm/s, at rest at corners. Tip to its reference from "
        f"the begin of the path to its end; mean of seeds {SEEDS[0]} to {SEEDS[-1]}.\n\n{table(head, rows)}"
    )


def error(law: str, path: np.ndarray, seed: int, learning_s: float) -> tuple[float, float, float]:
    """RMS and largest distance [m] of the tip from its reference on a path, and the factor of time."""
    changes = {
        "platform": "",
        "mode": "lockstep",
        "seed": seed,
        "controller.law": law,
        "controller.motion.speed_m_s": SPEED_M_S,
    }
    motion, off = follow(load_scene("track_circle", changes), path, learning_s)
    return float(np.sqrt(np.mean(off**2))), float(off.max()), motion.factor


def follow(scene: Scene, path: np.ndarray, learning_s: float) -> tuple[PiecewiseMotion, np.ndarray]:
    """The motion, and distances [m] of the true tip from its reference at the ticks of the path."""
    twin, loop = Twin(scene.loaded_robot, scene.twin_node()), loop_of(scene)
    planned: list[PiecewiseMotion] = []

    def reference(t: float, state: LoopState) -> Reference | None:
        if t >= learning_s and not planned:
            planned.append(motion_from(loop, state, path, t, twin.dt))
        return planned[-1] if planned else None

    n, off = round((learning_s + 60.0) / twin.dt), []
    ticks = loop.run(twin, n, twin.dt, reference=reference, before_s=-twin.dt)
    for tick in ticks:
        if not planned or tick.t_s <= planned[0].path_s:
            continue
        if tick.t_s > planned[0].end_s:
            break
        if not tick.command.status.ok:
            raise RuntimeError(tick.command.status.message)
        off.append(tick.seen.tip[:3, 3] - tick.command.tip_reference[:3, 3])
    return planned[0], np.linalg.norm(np.array(off), axis=1)


def motion_from(
    loop: Loop, state: LoopState, path: Sequence[np.ndarray], t: float, dt: float
) -> PiecewiseMotion:
    """The motion that begins at the last tick before `t` [s], planned at once."""
    controller, following = loop.controller, state.controller.following
    begin = reference_ahead(controller.bounds, following, 0.0)
    return finished(controller.planner(state.controller, dt).plan(begin, np.asarray(path), None, t - dt))
