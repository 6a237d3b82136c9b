"""Ways around obstacles: 200 worlds of 3 to 6 balls in the way of a hanging arm of two links."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from benchmarks.options import Options
from benchmarks.report import table
from soro_core import Robot, SoftArm, load_robot
from soro_core.arrays import Array
from soro_core.config import parse
from soro_core.control import ControllerConfig
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.planning.around import WayAround, plan_around
from soro_core.planning.motion_error import MotionError
from soro_core.robot.surroundings import Contacts, Sphere

TITLE = "Ways around obstacles"
WORLDS, MARGIN_M, LOAD_KG = 200, 2e-3, 0.02
# Shapes of a plan; those of the search that says which worlds have a way take about a minute.
SHAPES, LONG = 40_000, 1_200_000
# Worlds whose way the twin follows.
FOLLOWED = 10


def two_links() -> Robot:
    """Return the three-bellow arm twice, hanging."""
    one = load_robot("tue_three_bellow")
    links = [link.model_dump() for link in one.links] * 2
    return one.replace(links=links, base_quaternion=[1.0, 0.0, 0.0, 0.0], name="two_links")


@dataclass(frozen=True)
class World:
    """Balls around a way whose two ends are free."""

    start_pa: Array
    goal_m: Array
    obstacles: Contacts
    is_blocked: bool
    """Whether the arm meets a ball on the straight way in pressures."""


def clearance(arm: SoftArm, q: Array, obstacles: Contacts) -> float:
    """Least clearance [m] of shapes (n, n_q) by dense samples of the arm, from one radius above its base."""
    radius = arm.robot.links[0].radius
    points = arm.poses(np.atleast_2d(q), np.linspace(radius, arm.length, 120))[..., :3, 3]
    gaps = [np.linalg.norm(points - one.centre, axis=-1).min() - one.radius for one in obstacles.spheres]
    return float(min(gaps)) - radius


def world(arm: SoftArm, seed: int) -> World:
    """Return a random world: 3 to 6 balls, each near the straight way and clear of its ends."""
    random = np.random.default_rng(seed)
    low, high = arm.robot.input_range
    while True:
        begin, end = (random.uniform(low, high) * (random.random(arm.n_u) < 0.5) for _ in range(2))
        rows = [equilibrium(arm, begin)]
        for x in np.linspace(0.0, 1.0, 9)[1:]:
            rows.append(equilibrium(arm, begin + x * (end - begin), rows[-1]))
        tips = arm.poses(np.array(rows), arm.length)[:, :3, 3]
        if np.linalg.norm(tips[-1] - tips[0]) > 0.03:
            break
    shapes, wanted, balls = np.array(rows), random.integers(3, 7), ()
    while len(balls) < wanted:
        at = arm.pose(shapes[random.integers(len(shapes))], random.uniform(0.3, 1.0) * arm.length)[:3, 3]
        centre, radius = at + random.normal(0.0, 0.02, 3), float(random.uniform(0.005, 0.012))
        one = Sphere(centre=tuple(centre), radius=radius, stiffness=1e3)
        if clearance(arm, shapes[[0, -1]], Contacts(spheres=(one,))) > MARGIN_M:
            balls = (*balls, one)
    found = Contacts(spheres=balls)
    return World(begin, tips[-1], found, clearance(arm, shapes, found) < 0.0)


def planned(arm: SoftArm, one: World, shapes: int) -> tuple[WayAround | None, float]:
    """Return the way, if there is one, and the time of the processor [s]."""
    begun = time.process_time()
    try:
        way = plan_around(arm, one.start_pa, one.goal_m, one.obstacles, margin_m=MARGIN_M, shapes=shapes)
    except MotionError:
        return None, time.process_time() - begun
    return way, time.process_time() - begun
