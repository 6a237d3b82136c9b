"""Squeeze of random objects by three fingers that know neither weight nor friction."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from benchmarks.bodies import hand
from benchmarks.options import Options
from benchmarks.report import table
from soro_core import SoftArm
from soro_core.arrays import Array
from soro_core.bodies import (
    BallShape,
    BodyMotion,
    BodyWorld,
    BoxShape,
    CylinderShape,
    RigidBody,
    simulate_world,
)
from soro_core.grasping import Finger, Squeeze, SqueezeRun, SqueezeSettings, SqueezeTrial, simulate_squeeze

TITLE = "Squeeze"
OBJECTS, POINTS, STEP_S = 100, 12, 1e-3
# How much the stiffness of each true finger may differ from the model's, and the place of the object along
# x and y from the middle [m].
STIFFNESS, OFF_M = 0.05, 1.5e-3
# Strain and curvatures by a pose with 0.1 mm of noise; place at which fingers touch [m], without load:
# under the pressures of an open hand they are longer by 8 %.
NOISE, TOUCH_M = np.array([1.5e-3, 0.05, 0.05]), 0.058
# The table sinks slowly first; times from its begin [s], and how far [m].
BEGIN_S, SINKS_S, SUNK_M, END_S = 2.5, (12.0, 13.0), (8e-3, 38e-3), 17.0
# Pressures of the squeeze by brute force, least of which holds is enough [Pa].
BRUTE_PA = (30e3, 60e3, 90e3)
# An object that is held has come down by less, and in the last second by less [m].
FALLEN_M, CREPT_M = 15e-3, 3e-4
GRAVITY, TICK_S = 9.81, 0.01
_GENTLE = SqueezeSettings(force_n=0.01, crush_n=0.6)
# The hands: whether something tracks the object, and how they squeeze.
HANDS = (
    ("object tracked", True, _GENTLE),
    ("object not tracked, 0.1 N at first", False, _GENTLE.model_copy(update={"force_n": 0.1})),
)


@dataclass(frozen=True)
class Case:
    """A random object between random fingers."""

    kind: str
    mass: float
    friction: float
    world: Callable[[BodyMotion], BodyWorld]
    """By the motion of the table."""

    @property
    def needed_n(self) -> float:
        """Weight over friction [N]."""
        return self.mass * GRAVITY / self.friction


def model() -> dict[str, SoftArm]:
    """Return the fingers as the hand knows them."""
    return dict(hand(1, "ball", POINTS).arms)


def case(seed: int) -> Case:
    """Return an object of 5 to 60 g, mu 0.3 to 1."""
    random = np.random.default_rng(seed)
    kind = ("ball", "cylinder", "box")[seed % 3]
    radius, length = random.uniform(0.013, 0.018), random.uniform(0.02, 0.04)
    across = random.uniform(0.022, 0.028, 2)
    shape: BallShape | CylinderShape | BoxShape = {
        "ball": BallShape(radius=radius),
        "cylinder": CylinderShape(radius=radius, length=length),
        "box": BoxShape(size=(*across, length)),
    }[kind]
    half = radius if kind == "ball" else 0.5 * length
    mass, friction = random.uniform(0.005, 0.06), random.uniform(0.3, 1.0)
    place = [*random.uniform(-OFF_M, OFF_M, 2), -0.06]
    turn = random.uniform(0.0, 0.5 * np.pi)
    arms = {name: _other(arm, random) for name, arm in model().items()}

    def world(motion: BodyMotion) -> BodyWorld:
        body = RigidBody(
            shape=shape,
            mass=mass,
            friction=friction,
            position=place,
            quaternion=(0.0, 0.0, np.sin(0.5 * turn), np.cos(0.5 * turn)),
        )
        at = (0.0, 0.0, place[2] - half - 0.01)
        below = RigidBody(shape=BoxShape(size=(0.02, 0.02, 0.02)), fixed=True, position=at, motion=motion)
        return BodyWorld({"object": body, "table": below}, arms, points_per_link=POINTS)

    return Case(kind, mass, friction, world)


def _other(arm: SoftArm, random: np.random.Generator) -> SoftArm:
    """Return a finger whose stiffness is another one."""
    links = [link.model_dump(exclude_unset=True) for link in arm.robot.links]
    for link in links:
        bend, axial = 1.0 + random.uniform(-STIFFNESS, STIFFNESS, 2)
        link["k_b"] = [bend * link["k_b"][0], bend * link["k_b"][1], link["k_b"][2]]
        link["k_e"] = [axial * link["k_e"][0], axial * link["k_e"][1], link["k_e"][2]]
    return SoftArm(arm.robot.replace(links=links))


def is_held(t: Array, height: Array) -> bool:
    """Whether an object is held at the end of a run."""
    late = height[np.searchsorted(t, t[-1] - 1.0)]
    return bool(height[0] - height[-1] < FALLEN_M and late - height[-1] < CREPT_M)


def is_holdable(one: Case) -> bool:
    """Whether one of some pressures, the same in all fingers, holds it."""
    world = one.world(BodyMotion(at_s=(2.0, 3.0), displacement_m=(0.0, 0.0, 0.0, 0.0, 0.0, -SUNK_M[1])))
    for pressure in BRUTE_PA:
        inputs = {
            name: lambda t, p=pressure: np.array([p * min(t / 1.5, 1.0), 0.0, 0.0]) for name in world.arms
        }
        result = simulate_world(world, t_end=5.0, dt=STEP_S, pressures=inputs)
        if result.status.ok and is_held(result.t, result.place["object"][:, 2]):
            return True
    return False


def squeezed(one: Case, seed: int, tracked: bool, settings: SqueezeSettings) -> SqueezeRun:
    """Return the run of a squeeze."""
    motion = BodyMotion(
        at_s=(BEGIN_S, *(BEGIN_S + s for s in SINKS_S)),
        displacement_m=(0.0, 0.0, 0.0, 0.0, 0.0, -SUNK_M[0], 0.0, 0.0, -SUNK_M[1]),
    )
    fingers = [Finger(arm, np.array([1.0, 0.0, 0.0]), TOUCH_M, NOISE) for arm in model().values()]
    return simulate_squeeze(
        one.world(motion),
        Squeeze(fingers, settings),
        "object",
        t_end=END_S,
        trial=SqueezeTrial(tracked_m=5e-5 if tracked else None, tick_s=TICK_S, step_s=STEP_S, seed=seed),
    )


def measured(seed: int) -> list[SqueezeRun]:
    """Return the run of each hand around an object; none where it cannot be held."""
    one = case(seed)
    if not is_holdable(one):
        return []
    return [squeezed(one, seed, tracked, settings) for _, tracked, settings in HANDS]


def run(options: Options) -> str:
    """Measure and write."""
    seeds = range(options.pick(OBJECTS, 2))
    with ProcessPoolExecutor(options.jobs) as pool:
        runs = dict(zip(seeds, pool.map(measured, seeds), strict=True))
    return written({seed: found for seed, found in runs.items() if found}, len(seeds))


def written(runs: Mapping[int, list[SqueezeRun]], number: int) -> str:
    """Return the text for the runs of the holdable ones of a number of objects."""
    cases = {seed: case(seed) for seed in runs}
    kinds = [one.kind for one in cases.values()]
    counts = ", ".join(str(kinds.count(kind)) for kind in ("ball", "cylinder", "box"))
    rows = [["objects; holdable; of these balls, cylinders, boxes", f"{number}; {len(kinds)}; {counts}"]]
    for k, (words, _, settings) in enumerate(HANDS):
        held: dict[str, list[float]] = {kind: [] for kind in kinds}
        for seed, found in runs.items():
            ran, one = found[k], cases[seed]
            if len(ran.t) == round(END_S / TICK_S) and is_held(ran.t, ran.height_m):
                held[one.kind].append(float(ran.normal_n.sum(axis=1).max()) / one.needed_n)
        by_kind = ", ".join(f"{kind} {len(one)}" for kind, one in held.items())
        total = sum(map(len, held.values()))
        share = f"{total}; {100.0 * total / max(len(runs), 1):.0f} %; {by_kind}"
        rows.append([f"{words}: held of the holdable", share])
        for kind, ratio in held.items():
            if ratio:
                above = sum(one > 1.3 for one in ratio)
                text = f"{np.median(ratio):.2f}; {max(ratio):.2f}; {above}"
                rows.append([f"{words}: {kind}: largest sum of normal forces over weight / mu", text])
        most = max(float(found[k].normal_n.max(initial=0.0)) for found in runs.values())
        rows.append([f"{words}: largest normal force; limit", f"{most:.3f}; {settings.crush_n:g} N"])
    pressures = ", ".join(f"{1e-3 * p:g}" for p in BRUTE_PA)
    return (
        "Three fingers of one link with poses of 0.1 mm of noise, whose stiffness is up to "
        f"{100 * STIFFNESS:g} % from the model's; objects of 5 to 60 g, mu 0.3 to 1, {1e3 * OFF_M:g} mm or "
        "less along x and y from the middle, on a table that sinks "
        f"{1e3 * SUNK_M[0]:g} mm in {SINKS_S[0]:g} s and is gone a second later. "
        f"Holdable: one of {pressures} kPa in all fingers holds it. Sums of normal forces: of objects "
        f"that are held; median, largest, how many are above 1.3.\n\n{table(['', ''], rows)}"
    )
