"""Arms and rigid bodies together: speed of a grasp, what it holds, and its pull-out by step and points."""

from __future__ import annotations

from functools import partial

import numpy as np

from benchmarks.options import Options
from benchmarks.report import table
from benchmarks.timing import CLOCK
from soro_core import BaseState, SoftArm, load_robot
from soro_core.bodies import (
    BallShape,
    BodyWorld,
    BoxShape,
    CylinderShape,
    RigidBody,
    WorldResult,
    simulate_world,
)

TITLE = "Bodies"
ROBOT = "config/robots/tue_three_bellow.yaml"
MASS_KG = 0.03
# Fingers close in 0.6 s, the table sinks from 1 s on, and a pull of 0.5 N/s begins.
CLOSED_S, LOWERED_S, PULLED_S = 0.6, 1.0, 1.6
OBJECTS = ("ball", "cylinder")
# By the number of links: radius of the object, how far its centre is above the place of the tips [m], and the
# pressure. From 55 kPa on, two links push harder than they are stiff sideways: the object turns out of them.
RADIUS_M, ABOVE_M, CLOSED_PA = {1: 0.016, 2: 0.021}, {1: 0.004, 2: 0.02}, {1: 60e3, 2: 45e3}


def run(options: Options) -> str:
    """Measure and write."""
    return f"{speed(options)}\n\n{pull_out(options)}"


def hand(links: int, name: str, points: int) -> BodyWorld:
    """Three fingers around an object on a table."""
    radius = RADIUS_M[links]
    shape = BallShape(radius=radius) if name == "ball" else CylinderShape(radius=radius, length=0.03)
    half = radius if name == "ball" else 0.015
    base = load_robot(ROBOT)
    length, arms = base.length * links, {}
    for k in range(3):
        a = 2.0 * np.pi * k / 3
        arms[f"finger{k}"] = SoftArm(
            base.replace(
                links=[link.model_dump() for link in base.links] * links,
                base_quaternion=[float(np.cos(a / 2)), float(np.sin(a / 2)), 0.0, 0.0],
                base_position=[float(0.035 * np.cos(a)), float(0.035 * np.sin(a)), 0.0],
            )
        )
    height = ABOVE_M[links] - length
    bodies = {
        "object": RigidBody(shape=shape, mass=MASS_KG, position=[0.0, 0.0, height], friction=0.8),
        "table": RigidBody(
            shape=BoxShape(size=[0.02] * 3), fixed=True, position=[0.0, 0.0, height - 0.01 - half]
        ),
    }
    return BodyWorld(bodies, arms, points_per_link=points)


def grasp(world: BodyWorld, t_end: float, dt: float, pull_n_s: float = 0.0) -> WorldResult:
    """Close, lower the table, and pull."""

    def close(t: float) -> np.ndarray:
        pressure = np.zeros(next(iter(world.arms.values())).n_u)
        pressure[::3] = CLOSED_PA[len(pressure) // 3] * min(t / CLOSED_S, 1.0)
        return pressure

    result = simulate_world(
        world,
        t_end=t_end,
        dt=dt,
        pressures=dict.fromkeys(world.arms, close),
        motions={"table": lambda t: BaseState(displacement=[0.0, 0.0, -0.02 * max(t - LOWERED_S, 0.0)])},
        wrenches={"object": lambda t: [0.0, 0.0, 0.0, 0.0, 0.0, -pull_n_s * max(t - PULLED_S, 0.0)]},
    )
    if not result.status.ok:
        raise RuntimeError(result.status)
    return result


def speed(options: Options) -> str:
    """Times real time of three fingers and an object, and how it is held."""
    rows = []
    t_end = options.pick(4.0, 1.7)
    for links in (1, 2):
        for name in OBJECTS:
            options.say(f"three fingers of {links} links and a {name}")
            world = hand(links, name, 6)
            grasp(world, 0.01, 1e-3)
            timed = partial(grasp, world, t_end, 1e-3)
            taken = [CLOCK.time(timed) for _ in range(options.pick(5, 1))]
            result = timed()
            late = result.t > t_end - 0.5
            height = result.place["object"][late, 2]
            creep = abs(np.polyfit(result.t[late], height, 1)[0])
            balance = np.abs(result.contact_force("object")[late, 2] / (MASS_KG * 9.81) - 1.0).max()
            held = "yes" if height[-1] > result.place["object"][0, 2] - 0.01 else "no"
            rows.append(
                [f"{links}", name, f"{t_end / min(taken):.1f}", held, f"{balance:.0e}", f"{1e6 * creep:.0e}"]
            )
    head = ["links", "object", "times real time", "held", "weight balance", "creep, um/s"]
    setting = (
        f"Three fingers and an object of {1e3 * MASS_KG:g} g at 1 ms; balance and creep over the last 0.5 s."
    )
    return f"{setting}\n\n{table(head, rows)}"


def pull_out(options: Options) -> str:
    """Force at which the object has been drawn out by 10 mm."""
    cases = options.pick([(1e-3, 6), (5e-4, 6), (2.5e-4, 6), (1e-3, 3), (1e-3, 12), (1e-3, 24)], [(1e-3, 6)])
    rows = []
    for dt, points in cases:
        forces = []
        for name in OBJECTS:
            options.say(f"pull-out of a {name}: {1e3 * dt:g} ms, {points} points")
            result = grasp(hand(1, name, points), 3.2, dt, 0.5)
            height = result.place["object"][:, 2]
            out = int(np.argmax(height < height[round(PULLED_S / dt)] - 0.01))
            forces.append(f"{0.5 * (result.t[out] - PULLED_S):.4f}" if out else "not out")
        rows.append([f"{1e3 * dt:g}", f"{points}", *forces])
    head = ["step, ms", "points a link", *(f"{name}, N" for name in OBJECTS)]
    return f"Pull-out, one link: force at which the object has moved by 10 mm.\n\n{table(head, rows)}"
