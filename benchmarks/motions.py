"""Motions along paths: how far the tip is from its timed reference, with a load that the law has to learn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.options import Options
from benchmarks.report import table
from soro_core.config import config_folder, read_yaml
from soro_core.control import Reference
from soro_core.control.following import reference_ahead
from soro_core.control.motion import finished
from soro_core.control.motion_parts import Motion
from soro_core.control.tip_path import corners
from soro_core.loop import Loop, LoopState, loop_of
from soro_core.scene import Scene, load_scene
from soro_core.twin import Twin

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


def run(options: Options) -> str:
    """Measure and write."""
    rows = []
    for controller in options.pick(controllers(), controllers()[:1]):
        for name, path in list(PATHS.items())[: options.pick(None, 1)]:
            found = []
            for seed in options.pick(SEEDS, SEEDS[:1]):
                options.say(f"{controller}: {name}, seed {seed}")
                found.append(error(controller, path, seed, options.pick(LEARNING_S, 4.0)))
            errors, largest, factors = np.array(found).T
            low, mean, high = (1e3 * f(errors) for f in (np.min, np.mean, np.max))
            rows.append(
                [
                    controller,
                    name,
                    f"{mean:.3f}",
                    f"{low:.3f} to {high:.3f}",
                    f"{1e3 * largest.max():.2f}",
                    f"{factors.max():.2f}",
                ]
            )
    head = ["controller file", "motion", "RMS, mm", "least to most", "largest, mm", "factor of time"]
    return (
        f"The twin of `track_circle` (20 g, four links) in lockstep: {LEARNING_S:g} s on its "
        f"circle, then the motion at {1e3 * SPEED_M_S:g} mm/s, at rest at corners. Tip to its reference from "
        f"the begin of the path to its end; mean of seeds {SEEDS[0]} to {SEEDS[-1]}.\n\n{table(head, rows)}"
    )


def controllers() -> list[str]:
    """Names of the shipped controller files for the robot of the scene."""
    robot, files = load_scene("track_circle").robot, sorted((config_folder() / "controllers").glob("*.yaml"))
    return [file.stem for file in files if read_yaml(file).get("robot") == robot]


def error(controller: str, path: np.ndarray, seed: int, learning_s: float) -> tuple[float, float, float]:
    """RMS and largest distance [m] of the tip from its reference on a path, and the factor of time."""
    changes = {
        "platform": "",
        "mode": "lockstep",
        "seed": seed,
        "controller": controller,
        "controller.motion.speed_m_s": SPEED_M_S,
    }
    motion, off = follow(load_scene("track_circle", changes), path, learning_s)
    return float(np.sqrt(np.mean(off**2))), float(off.max()), motion.factor


def follow(scene: Scene, path: np.ndarray, learning_s: float) -> tuple[Motion, np.ndarray]:
    """The motion, and distances [m] of the true tip from its reference at the ticks of the path."""
    twin, loop = Twin(scene.loaded_robot, scene.twin_node()), loop_of(scene)
    planned: list[Motion] = []

    def reference(t: float, state: LoopState) -> Reference | None:
        if t >= learning_s and not planned:
            planned.append(motion_from(loop, state, path, t, twin.dt))
        return planned[-1] if planned else None

    off, ticks = [], loop.run(twin, round((learning_s + 60.0) / twin.dt), twin.dt, reference=reference)
    for tick in ticks:
        if not planned or tick.t_s <= planned[0].path_s:
            continue
        if tick.t_s > planned[0].end_s:
            break
        if not tick.command.status.ok:
            raise RuntimeError(tick.command.status.message)
        off.append(tick.seen.tip[:3, 3] - tick.command.tip_reference[:3, 3])
    return planned[0], np.linalg.norm(np.array(off), axis=1)


def motion_from(loop: Loop, state: LoopState, path: Sequence[np.ndarray], t: float, dt: float) -> Motion:
    """The motion that begins at the last tick before `t` [s], planned at once."""
    controller, following = loop.controller, state.controller.following
    begin = reference_ahead(controller.bounds, following, 0.0)
    return finished(controller.planner(state.controller, dt).plan(begin, np.asarray(path), None, t - dt))
