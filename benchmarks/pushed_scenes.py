"""The external force where the sensors are others than one pose at the tip: pushes in scenes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from benchmarks.options import Options
from benchmarks.report import met, table
from soro_lab.scene import load_scene
from soro_ros.study.closed_loop import ticks_of

# The arm rests at a point and is pushed for a while; the mean of its end counts [s].
PUSH_S, LEAVES_S, LAST_S = 8.0, 11.0, 1.0
FORCES_N = (0.1, 0.2)
# Goal of the issue for these sensors, as a part of the force.
GOAL = 0.04
_LINKS = {"controller.reference": {"kind": "path", "start_s": 2, "path_m": [[0.02, 0.0, -0.317]]}}
_ONE = {"controller.reference": {"kind": "path", "start_s": 2, "path_m": [[0.01, 0.0, 0.066]]}}
CASES: tuple[tuple[str, str, Mapping[str, Any], tuple[float, float, float]], ...] = (
    ("two links, two poses, in the plane of the bend", "two_links", _LINKS, (1.0, 0.0, 0.0)),
    ("two links, two poses, across it", "two_links", _LINKS, (0.0, 1.0, 0.0)),
    ("one link, IMU and pose", "imu_only", {**_ONE, "twin.pose.enabled": True}, (0.0, 1.0, 0.0)),
)


def row(
    name: str, scene: str, keys: Mapping[str, Any], direction: tuple[float, ...], force_n: float
) -> list[str]:
    """Return what one push shows, across the backbone."""
    true = force_n * np.array(direction)
    wrench = {"at_s": [PUSH_S, LEAVES_S], "force_n": [true.tolist(), [0.0, 0.0, 0.0]], "change": "step"}
    run = {"mode": "lockstep", "platform": "", "duration_s": LEAVES_S, "twin.wrench": wrench, **keys}
    errors, inside, first = [], [], "-"
    for tick in ticks_of(load_scene(scene, run)):
        external = tick.estimate.external
        if external is None or tick.t_s < PUSH_S:
            continue
        first = f"{tick.t_s - PUSH_S:.2f}" if external.stage == "contact" and first == "-" else first
        if tick.t_s > LEAVES_S - LAST_S:
            across = tick.seen.tip[:3, :2].T  # along the backbone little is known
            error, covariance = across @ (external.force_n - true), across @ external.covariance @ across.T
            errors.append(error)
            inside.append(float(error @ np.linalg.solve(covariance, error)) < 4.0)
    mean = float(np.linalg.norm(np.mean(errors, axis=0)))
    share = 100 * float(np.mean(inside))
    cells = [
        f"{1e3 * force_n:g}",
        f"{1e3 * mean:.2f}",
        f"{100 * mean / force_n:.1f} %",
        f"{share:.0f} %",
        first,
    ]
    return [name, *cells, met(mean <= GOAL * force_n)]


def rows(options: Options) -> Iterator[list[str]]:
    """Give a row for each case and force."""
    for name, scene, keys, direction in options.pick(CASES, CASES[2:]):
        for force_n in options.pick(FORCES_N, FORCES_N[:1]):
            options.say(f"force: {name}, {1e3 * force_n:g} mN")
            yield row(name, scene, keys, direction, force_n)


def section(options: Options) -> str:
    """Return the table."""
    header = ["what", "force mN", "error mN", "of the force", "within 2 deviations", "contact s", ""]
    return table(header, list(rows(options)))
