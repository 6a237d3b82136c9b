"""Worlds of the tests: fingers on one base around an object on a table that is lowered."""

import numpy as np

from soro_core import BaseState, SoftArm, load_robot
from soro_core.bodies import BallShape, BodyWorld, BoxShape, GroundShape, RigidBody, simulate_world

WEIGHT = 9.81
MASS = 0.03


def tilt(deg):
    """Quaternion of a rotation about y."""
    return [0.0, float(np.sin(np.deg2rad(deg) / 2)), 0.0, float(np.cos(np.deg2rad(deg) / 2))]


def ground(deg=0.0, **keys):
    return RigidBody(shape=GroundShape(), fixed=True, quaternion=tilt(deg), **keys)


def fingers(n=3, radius=0.035, robot="tue_three_bellow", **changes):
    base, arms = load_robot(f"config/robots/{robot}.yaml"), {}
    for k in range(n):
        a = 2.0 * np.pi * k / n
        arms[f"finger{k}"] = SoftArm(
            base.replace(
                name=f"finger{k}",
                base_quaternion=[float(np.cos(a / 2)), float(np.sin(a / 2)), 0.0, 0.0],
                base_position=[float(radius * np.cos(a)), float(radius * np.sin(a)), 0.0],
                **changes,
            )
        )
    return arms


def grip(shape=None, arms=None, friction=0.8, half=None, **keys):
    """Three fingers around an object at z = -60 mm, and a table below it."""
    shape = shape or BallShape(radius=0.016)
    if half is None:
        half = shape.radius if isinstance(shape, BallShape) else 0.5 * shape.length
    return BodyWorld(
        {
            "object": RigidBody(shape=shape, mass=MASS, position=[0.0, 0.0, -0.06], friction=friction),
            "table": RigidBody(
                shape=BoxShape(size=[0.02] * 3), fixed=True, position=[0.0, 0.0, -0.07 - half]
            ),
        },
        fingers() if arms is None else arms,
        **keys,
    )


def lowered(t):
    """A table that sinks from 1 s on by 20 mm/s."""
    return BaseState(displacement=[0.0, 0.0, -0.02 * min(max(t - 1.0, 0.0), 2.0)])


def close(world, pressure=60e3):
    """Pressures that close all fingers within 0.6 s."""
    return {name: lambda t: np.array([pressure * min(t / 0.6, 1.0), 0.0, 0.0]) for name in world.arms}


def grasp(world, t_end=2.0, dt=1e-3, **inputs):
    motions = {"table": lowered, **inputs.pop("motions", {})}
    return simulate_world(world, t_end=t_end, dt=dt, pressures=close(world), motions=motions, **inputs)


# Radius of the beams [m], and the gap with which the upper one begins.
RADIUS, BETWEEN = 0.01, 1e-4


def beam(name, radius=RADIUS, length=0.025, youngs=5e7, viscosity=2e4, chamber=False, **keys):
    """A straight round rod of eight links, without weight, along x; linear in its strains."""
    base = load_robot("config/robots/silicone_rod.yaml")
    link = base.links[0].model_dump(exclude_unset=True)
    link |= {"length": length, "radius": radius}
    link["material"] |= {"youngs_modulus": youngs, "shear_modulus": youngs / 3.0, "viscosity": viscosity}
    link["material"]["shear_correction"] = False
    if chamber:
        link["chambers"] = [{"angle_rad": 0.0, "alpha_eps": 0.0, "alpha_kappa": 9e-9}]
    return base.replace(name=name, gravity=[0.0, 0.0, 0.0], links=[link] * 8, **keys)


def crossing_beams(at, reach, viscosity=2e4, **keys):
    """One along x, one above it along y, which cross at these places along them."""
    half = float(np.sqrt(0.5))
    low = beam("low", viscosity=viscosity)
    high = beam(
        "high",
        viscosity=viscosity,
        base_quaternion=[-half, 0.0, 0.0, half],
        base_position=[at, -reach, 2.0 * RADIUS + BETWEEN],
    )
    arms = {"low": SoftArm(low), "high": SoftArm(high)}
    return BodyWorld({}, arms, **keys)


def lower_beam(depth, pull=0.0):
    """Motion of the upper base: down within 0.3 s, by the gap and a depth; along x from 0.5 s on."""

    def motion(t):
        down = (BETWEEN + depth) * (1.0 - np.cos(np.pi * min(t / 0.3, 1.0))) / 2.0
        along = pull * max(t - 0.5, 0.0)
        speed = (BETWEEN + depth) * np.pi / 0.6 * np.sin(np.pi * min(t / 0.3, 1.0))
        return BaseState(displacement=[along, 0.0, -down], velocity=[pull * (t > 0.5), 0.0, -speed])

    return motion
