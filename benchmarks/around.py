"""Ways around obstacles: 200 worlds of 3 to 6 balls in the way of a hanging arm of two links."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from benchmarks.options import Options
from benchmarks.report import table
from soro_core import Loop, Robot, SoftArm, load_robot
from soro_core.arrays import Array
from soro_core.config import parse
from soro_core.control import Controller, ControllerConfig, Reference
from soro_core.control.motions.motion_parts import PiecewiseMotion
from soro_core.control.motions.way_around import route_around
from soro_core.control.reference.active_reference import reference_ahead
from soro_core.estimation import Estimator
from soro_core.loop import LoopState
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.planning.around import WayAround, plan_around
from soro_core.planning.motion_error import MotionError
from soro_core.planning.steps import finished
from soro_core.robot.surroundings import Contacts, Sphere
from soro_core.twin import Twin

TITLE = "Ways around obstacles"
WORLDS, MARGIN_M, LOAD_KG = 200, 2e-3, 0.02
# Shapes of a plan; those of the search that says which worlds have a way take about a minute.
SHAPES, LONG = 40_000, 1_200_000
# Worlds whose way the twin follows.
FOLLOWED = 10
# Sets of balls that are drawn for a way.
_DRAWS = 20
# Part of the range of the pressures that the ends of these ways leave at both ends.
_INNER = 0.05
# Time before and after a motion in the twin [s]; most ticks, and ticks between two looks at the arm.
_SETTLED_S, _TICKS, _EACH = 1.0, 20_000, 5


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
    wanted, found = random.integers(3, 7), tuple[Sphere, ...]()
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


def followed(robot: Robot, seed: int) -> tuple[float, float] | None:
    """Return the least clearance [m] of the arm in the twin, and the end of its tip from the goal [m].

    The way begins where the arm hangs without pressure, and ends where no chamber is at an end of its range:
    the controller keeps away from there. None where it finds no way.
    """
    random = np.random.default_rng(seed)
    arm = SoftArm(robot)
    rest = equilibrium(arm, np.zeros(arm.n_u))
    low, high = robot.input_range
    inner = low + _INNER * (high - low), high - _INNER * (high - low)
    while True:
        pressure = np.clip(ends(arm, random)[1], *inner)
        shapes = np.array([equilibrium(arm, x * pressure, rest) for x in np.linspace(0.0, 1.0, 9)])
        found = balls(arm, shapes, random)
        if clearance(arm, shapes, found) < 0.0:
            break
    goal = arm.pose(shapes[-1], arm.length)[:3, 3]
    config = parse({"law": "composite", "reference": {"kind": "hold"}}, ControllerConfig, "benchmark")
    controller = Controller(robot.replace(contacts=found.model_dump()), config)
    loop, twin, motions = Loop(Estimator(robot), controller), Twin(robot), list[PiecewiseMotion]()

    def reference(t: float, state: LoopState) -> Reference | None:
        if t >= _SETTLED_S and not motions and state.controller.following is not None:
            planner = controller.planner(state.controller, twin.dt)
            begin = reference_ahead(controller.bounds, state.controller.following, 0.0)
            route = finished(route_around(planner, begin.q, goal))
            motions.append(finished(planner.motion(route, begin, t - twin.dt)))
        return motions[-1] if motions else None

    least, tip = np.inf, goal
    try:
        for tick in loop.run(twin, _TICKS, twin.dt, reference=reference, before_s=-twin.dt):
            if motions and tick.t_s > motions[0].end_s + _SETTLED_S:
                break
            if tick.plant.tick % _EACH == 0:
                least = min(least, clearance(twin.plant.arm, tick.plant.arm.q, found))
            tip = tick.seen.tip[:3, 3]
    except MotionError:
        return None
    return least, float(np.linalg.norm(tip - goal))


def run(options: Options) -> str:
    """Measure and write."""
    robot = two_links()
    arm = SoftArm(robot.replace(tip_mass=LOAD_KG))
    planned(arm, world(arm, 0), SHAPES)  # compiles
    times, gaps, looked, unsolved, solvable = [], [], [], 0, 0
    for seed in range(options.pick(WORLDS, 2)):
        options.say(f"ways around: world {seed}")
        one = world(arm, seed)
        way, seconds = planned(arm, one, SHAPES)
        times.append(seconds)
        if way is not None:
            gaps.append(clearance(arm, way.q, one.obstacles))
            looked.append(way.shapes)
            continue
        unsolved += 1
        solvable += planned(arm, one, options.pick(LONG, 100))[0] is not None
    number, solved = len(times), len(times) - unsolved
    share = 100.0 * solved / max(solved + solvable, 1)
    rows = [
        ["worlds; solved; of those that a search of a minute solves", f"{number}; {solved}; {share:.1f} %"],
        ["time, median and longest", f"{np.median(times):.3f} and {max(times):.2f} s"],
        ["shapes that were looked at, median", f"{np.median(looked):.0f}"],
        ["least clearance by dense samples", f"{1e3 * min(gaps):.2f} mm of {1e3 * MARGIN_M:g}"],
    ]
    asked, ran = options.pick(FOLLOWED, 1), []
    for seed in range(asked):
        options.say(f"ways around: twin, world {seed}")
        found = followed(robot.replace(tip_mass=LOAD_KG), seed)
        if found is not None:
            ran.append(found)
    rows.append(["worlds in the twin; refused by its controller", f"{asked}; {asked - len(ran)}"])
    if ran:
        least, off = np.array(ran).T
        rows.append(["least clearance in the twin", f"{1e3 * least.min():.2f} mm"])
        rows.append(["tip from the goal at the end, largest", f"{1e3 * off.max():.2f} mm"])
    return (
        f"Three-bellow arm twice, hanging, with {1e3 * LOAD_KG:g} g; 3 to 6 balls of 5 to 12 mm, clear of "
        "both ends of a straight way in pressures, which they block. Times of the processor, one core, with "
        f"{SHAPES} shapes at most; a search of a minute looks at {LONG}. The twin has four links a link, and "
        f"begins where the arm hangs without pressure.\n\n{table(['', ''], rows)}"
    )
