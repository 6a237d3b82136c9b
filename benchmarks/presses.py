"""Measure presses on walls that the controller does not know: soft to stiff, rough, tilted, moving."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from benchmarks.options import Options
from benchmarks.report import met, table
from soro_core import Robot, SoftArm
from soro_core.config import with_changes
from soro_core.robot.link import Creep
from soro_lab.scene import Scene, load_scene
from soro_ros.study.closed_loop import ticks_of

# Where the tip meets the wall, the radius of the arm, when the wall begins to move, and for how long [m, s].
PLACE, RADIUS_M, MOVES_S, MOVES_FOR_S = np.array([0.017, 0.0, 0.066]), 0.013, 8.5, 1.5
# Times after the touch from which on the force is near its goal, and at it [s].
NEAR_S, AT_S, AFTER_S = 1.2, 2.0, 4.5
# Time of the creep [s].
CREEP_S = 8.0

NOTE = (
    f"Presses in `press_wall` (10 g unknown). Largest error of the true force [mN] from {NEAR_S:g} s and "
    f"from {AT_S:g} s after the touch, largest force beyond the goal, and RMS error of the estimate. "
    "Goals: 10 %; 2 % or 1.5 mN; 10 % or 3 mN. Moving wall: 5 % or 5 mN after 2 s, while it moves. With "
    "creep: 5 %."
)


class Case(NamedTuple):
    """A press along x: force [N], wall, and what the arm is beside its file.

    Attributes
    ----------
    name : str
    goal_n : float
    stiffness, friction, tilt_deg, moves_m_s : float
        Of the wall [N/m, 1, degrees up from x, m/s along x].
    creep : float
        Further creep of the true arm in `CREEP_S`, as a part of its stiffness.
    holds_s : float
        How long it is held [s].
    goal : pair of float
        Largest error from `AT_S` on, as a part of the force and in N.
    """

    name: str
    goal_n: float = 0.05
    stiffness: float = 2000.0
    friction: float = 0.3
    tilt_deg: float = 0.0
    moves_m_s: float = 0.0
    creep: float = 0.0
    holds_s: float = AFTER_S
    goal: tuple[float, float] = (0.02, 1.5e-3)


CASES = (
    Case("2,000 N/m, mu 0.3", 0.02),
    Case("2,000 N/m, mu 0.3", 0.05),
    Case("2,000 N/m, mu 0.3", 0.1),
    Case("2,000 N/m, mu 0.3", 0.2),
    Case("200 N/m, mu 0.8", 0.05, 200.0, 0.8),
    Case("20,000 N/m, mu 0", 0.05, 20e3, 0.0),
    Case("20,000 N/m, mu 0.8", 0.1, 20e3, 0.8),
    Case("tilted 30 degrees up", 0.05, tilt_deg=30.0),
    Case("comes at 10 mm/s", 0.05, moves_m_s=-0.01, goal=(0.05, 5e-3)),
    Case("leaves at 10 mm/s", 0.05, moves_m_s=0.01, goal=(0.05, 5e-3)),
    Case("held for 60 s, creep of 25 % in 8 s", 0.05, creep=0.25, holds_s=60.0, goal=(0.05, 0.0)),
)


def scene_of(case: Case) -> Scene:
    """Return its scene: `press_wall` without devices."""
    tilt = np.deg2rad(case.tilt_deg)
    normal = -np.array([np.cos(tilt), 0.0, np.sin(tilt)])
    wall = {
        "point": (PLACE - RADIUS_M * normal).tolist(),
        "normal": normal.tolist(),
        "stiffness": case.stiffness,
        "damping": 1.0,
        "friction": case.friction,
        "velocity_m_s": [case.moves_m_s, 0.0, 0.0],
        "from_s": MOVES_S,
        "to_s": MOVES_S + MOVES_FOR_S,
    }
    keys: dict[str, Any] = {
        "mode": "lockstep",
        "platform": "",
        "duration_s": 8.0 + case.holds_s,
        "twin.wall": wall,
        "controller.reference.press_n": [case.goal_n, 0.0, 0.0],
    }
    return load_scene("press_wall", keys)


def row(case: Case) -> list[str]:
    """Return what a press shows."""
    scene, goal = scene_of(case), case.goal_n
    ticks = list(ticks_of(scene, _creeping(scene.loaded_robot, case.creep)))
    times, force, felt = np.array([(t.t_s, -t.seen.contact_n[0], _felt(t.estimate)) for t in ticks]).T
    if not np.any(force > 1e-3):
        last = ticks[-1].command
        why = "no contact" if last is None else last.status.note
        return [f"{case.name}: {why}", f"{1e3 * goal:g}", "", "", "", "", met(False)]
    since = times - times[np.argmax(force > 1e-3)]
    if case.moves_m_s:
        counts = (since > AT_S) & (times < MOVES_S + MOVES_FOR_S)
        if not np.any(counts):
            return [f"{case.name}: touched too late", f"{1e3 * goal:g}", "", "", "", "", met(False)]
        since, force, felt = since[counts], force[counts], felt[counts]
    error, late = np.abs(force - goal), since > AT_S
    near, at = float(np.max(error[since > NEAR_S])), float(np.max(error[late]))
    over = float(np.max(force)) - goal
    estimate = float(np.sqrt(np.nanmean((felt - force)[late] ** 2)))
    part, least = case.goal
    is_met = at <= max(part * goal, least) and over <= max(0.1 * goal, 3e-3)
    is_met = is_met and (bool(case.moves_m_s) or near <= 0.1 * goal)
    first, *cells = (f"{1e3 * value:.1f}" for value in (near, at, over, estimate))
    return [case.name, f"{1e3 * goal:g}", "" if case.moves_m_s else first, *cells, met(is_met)]


def _creeping(robot: Robot, part: float) -> Robot:
    """Return the robot with more creep."""
    (link,), own = robot.links, np.diag(SoftArm(robot).stiffness_matrix(np.zeros(3)))
    branch = Creep(tau=(CREEP_S,), stiffness=tuple(part * own))
    return robot.replace(links=(with_changes(link, creep=(*link.creep, branch)),)) if part else robot


def _felt(estimate: Any) -> float:
    """Return the estimated force on the wall along x [N]."""
    return float("nan") if estimate.external is None else -float(estimate.external.force_n[0])


def rows(options: Options) -> Iterator[list[str]]:
    """Give a row for each press."""
    for case in options.pick(CASES, CASES[1:2]):
        options.say(f"force: press, {case.name}, {1e3 * case.goal_n:g} mN")
        yield row(case)


def section(options: Options) -> str:
    """Return the table."""
    header = ["press along x on a wall", "mN", "off after 1.2 s", "after 2 s", "beyond", "estimate off", ""]
    return table(header, list(rows(options)))
