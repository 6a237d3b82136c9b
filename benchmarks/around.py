"""Ways around obstacles: 200 worlds of 3 to 6 balls in the way of a hanging arm of two links."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from soro_core import Robot, SoftArm, load_robot
from soro_core.arrays import Array
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
# Sets of balls that are drawn for a way.
_DRAWS = 20


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


def clearance(arm: SoftArm, q: Array, obstacles: Contacts) -> float:
    """Least clearance [m] of shapes (n, n_q) by dense samples of the arm, from one radius above its base."""
    radius = arm.robot.links[0].radius
    points = arm.poses(np.atleast_2d(q), np.linspace(radius, arm.length, 120))[..., :3, 3]
    gaps = [np.linalg.norm(points - one.centre, axis=-1).min() - one.radius for one in obstacles.spheres]
    return float(min(gaps)) - radius


def world(arm: SoftArm, seed: int) -> World:
    """Return a random world: 3 to 6 balls, clear of both ends of the straight way, which they block."""
    random = np.random.default_rng(seed)
    while True:
        shapes, start_pa = ends(arm, random)
        for _ in range(_DRAWS):
            found = balls(arm, shapes, random)
            if clearance(arm, shapes, found) < 0.0:
                return World(start_pa, arm.pose(shapes[-1], arm.length)[:3, 3], found)


def ends(arm: SoftArm, random: np.random.Generator) -> tuple[Array, Array]:
    """Return shapes (n, n_q) on a straight way in pressures, and the pressures at its begin (n_u,)."""
    low, high = arm.robot.input_range
    while True:
        begin, end = (random.uniform(low, high) * (random.random(arm.n_u) < 0.5) for _ in range(2))
        rows = [equilibrium(arm, begin)]
        for x in np.linspace(0.0, 1.0, 9)[1:]:
            rows.append(equilibrium(arm, begin + x * (end - begin), rows[-1]))
        tips = arm.poses(np.array(rows), arm.length)[:, :3, 3]
        if np.linalg.norm(tips[-1] - tips[0]) > 0.03:
            return np.array(rows), begin


def balls(arm: SoftArm, shapes: Array, random: np.random.Generator) -> Contacts:
    """Return 3 to 6 balls near shapes (n, n_q) of an arm and clear of the first and the last one."""
    wanted, found = random.integers(3, 7), ()
    while len(found) < wanted:
        at = arm.pose(shapes[random.integers(len(shapes))], random.uniform(0.3, 1.0) * arm.length)[:3, 3]
        centre, radius = at + random.normal(0.0, 0.02, 3), float(random.uniform(0.005, 0.012))
        one = Sphere(centre=tuple(centre), radius=radius, stiffness=1e3)
        if clearance(arm, shapes[[0, -1]], Contacts(spheres=(one,))) > MARGIN_M:
            found = (*found, one)
    return Contacts(spheres=found)


def planned(arm: SoftArm, one: World, shapes: int) -> tuple[WayAround | None, float]:
    """Return the way, if there is one, and the time of the processor [s]."""
    begun = time.process_time()
    try:
        way = plan_around(arm, one.start_pa, one.goal_m, one.obstacles, margin_m=MARGIN_M, shapes=shapes)
    except MotionError:
        return None, time.process_time() - begun
    return way, time.process_time() - begun
