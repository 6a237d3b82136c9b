"""One link of a high order against many of constant strain: a follower force, and a taper under a weight."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import solve_bvp, solve_ivp
from scipy.optimize import root

from benchmarks import kernels
from benchmarks.options import Options
from benchmarks.report import figure, table
from benchmarks.terms import states
from benchmarks.timing import per_call
from soro_core import SoftArm, robot_from_dict
from soro_core.arrays import Array

TITLE = "One link of a high order against many of constant strain"
LENGTH, RADIUS, TIP_RADIUS = 0.2, 0.012, 0.006
YOUNG, DENSITY, GRAVITY = 5e5, 1100.0, 9.81
MATERIAL = {"youngs_modulus": YOUNG, "shear_modulus": YOUNG / 3, "shear_correction": False}
STIFFNESS = YOUNG * np.pi * RADIUS**4 / 4
FOLLOWERS = (4.0, 12.0)  # of EI / L^2
WEIGHT_N = 0.15
ORDERS, PIECES = (1, 2, 3, 4, 6), (1, 2, 4, 8, 16, 32)
LOADS = np.linspace(0.1, 1.0, 10)
WEIGHTLESS = {"gravity": [0.0, 0.0, 0.0]}


def run(options: Options) -> str:
    """Measure and write."""
    models = [(1, order) for order in options.pick(ORDERS, (4,))]
    models += [(n, 0) for n in options.pick(PIECES, (8,))]
    uniform, taper, steps = {"radius": RADIUS}, tapered(0.0, 1.0), {}
    of_followers, of_taper = [follower(k) for k in FOLLOWERS], weighed()
    rows, calls = [], {}
    for n, order in models:
        name = f"{n} of constant strain" if order == 0 else f"{n} of order {order}"
        options.say(name)
        arm, shaped = arm_of(n, order, uniform), arm_of(n, order, taper)
        off = [miss(arm, pushed(arm, k), tip) for k, tip in zip(FOLLOWERS, of_followers, strict=True)]
        off.append(miss(shaped, hung(shaped), of_taper))
        if order == 0:
            off.append(miss(stepped := arm_of(n, order, steps), hung(stepped), of_taper))
        for key, one in ((name, arm), (f"{name}, taper", shaped)):
            calls[key] = kernels.in_a_loop(one, *states(one), pressure=0.0, internal=0.0, force=0.0)
        rows.append([name, arm.n_q, *(f"{value:.1e}" for value in off), *["-"] * (4 - len(off))])
    options.say("timing")
    took = {key: figure(1e6 * value) for key, value in per_call(calls, options.repeats).items()}
    rows = [[*row, took[row[0]], took[f"{row[0]}, taper"]] for row in rows]
    head = ["links", "coordinates", *(f"follower {k:g} EI/L^2" for k in FOLLOWERS), "taper", "taper as steps"]
    return f"{INTRO}\n\n{table([*head, 'us', 'us, taper'], rows)}"


INTRO = (
    f"A rod of {1e3 * LENGTH:g} mm that bends in one plane; distance of the tip at rest from that of the "
    "rod's differential equation, in parts of the length. One link of Legendre polynomials, or equal links "
    "of constant strain. Follower: a force that stays across the tip, without gravity. Taper: radius "
    f"{1e3 * RADIUS:g} to {1e3 * TIP_RADIUS:g} mm, clamped level, its own weight and {WEIGHT_N:g} N at the "
    "tip; `as steps`: links of the radius in their middle, without `sections`. us: forward dynamics in a "
    "compiled loop."
)


def miss(arm: SoftArm, q: Array, wanted: Array) -> float:
    """Distance of the tip in the plane from x and z, over the length."""
    return float(np.linalg.norm(arm.pose(q, arm.length)[[0, 2], 3] - wanted) / LENGTH)


def tapered(begin: float, end: float) -> dict[str, Any]:
    """Section of a part of the taper, between two places from 0 to 1."""
    ends = [RADIUS + x * (TIP_RADIUS - RADIUS) for x in (begin, end)]
    length = LENGTH * (end - begin)
    return {"sections": [{"place": s, "radius": r} for s, r in zip((0.0, length), ends, strict=True)]}


def arm_of(links: int, order: int, section: dict[str, Any]) -> SoftArm:
    """Arm of a section, split; of none, links of the radius of the taper in their middle."""
    field = {"basis": "legendre", "order": order} if order else {"basis": "constant"}
    common = {"length": LENGTH, "density": DENSITY, "material": MATERIAL, "strains": {"bending_x": field}}
    if section:
        return SoftArm(robot_from_dict({"links": [{**common, **section}], **WEIGHTLESS}).refine(links))
    radii = RADIUS + (np.arange(links) + 0.5) / links * (TIP_RADIUS - RADIUS)
    each = [{**common, "length": LENGTH / links, "radius": float(radius)} for radius in radii]
    return SoftArm(robot_from_dict({"links": each, **WEIGHTLESS}))


def pushed(arm: SoftArm, force: float) -> Array:
    """Coordinates at rest under a follower force, in EI / L^2."""
    wrench = np.array([0.0, 0.0, 0.0, force * STIFFNESS / LENGTH**2, 0.0, 0.0])
    return _rest(arm, lambda q: arm.elastic_force(q) - arm.jacobian(q, arm.length).T @ wrench)


def hung(arm: SoftArm) -> Array:
    """Coordinates at rest under the weights."""
    heavy = SoftArm(arm.robot.replace(gravity=[GRAVITY, 0.0, 0.0], tip_mass=WEIGHT_N / GRAVITY))
    return _rest(heavy, lambda q: heavy.elastic_force(q) + heavy.gravity_force(q))


def _rest(arm: SoftArm, residual: Callable[[Array], Array]) -> Array:
    """Root of the force while its load grows to all of it."""
    q = np.zeros(arm.n_q)
    for share in LOADS:
        q = np.asarray(root(partial(_balance, arm, residual, share), q, tol=1e-13).x)
    if np.abs(residual(q)).max() > 1e-8 * np.abs(arm.elastic_force(q)).max():
        raise RuntimeError(f"{arm.robot}: no rest")
    return q


def _balance(arm: SoftArm, residual: Callable[[Array], Array], share: float, q: Array) -> Array:
    return share * residual(q) + (1.0 - share) * arm.elastic_force(q)


def follower(force: float) -> Array:
    """Tip of the rod, integrated from the tip, whose frame the force stays in: angle, moment, x and z."""
    across = force * STIFFNESS / LENGTH**2

    def rates(_: float, y: Array) -> list[float]:
        return [y[1] / STIFFNESS, -across * np.cos(y[0]), np.sin(y[0]), np.cos(y[0])]

    back = solve_ivp(rates, (LENGTH, 0.0), np.zeros(4), method="DOP853", rtol=1e-12, atol=1e-14)
    angle, _, x, z = back.y[:, -1]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return np.asarray(turn @ np.array([-x, -z]))


def weighed() -> Array:
    """Tip of the tapered rod: angle, moment, weight beyond, x and z."""

    def rates(s: Array, y: Array) -> Array:
        radius = RADIUS + s / LENGTH * (TIP_RADIUS - RADIUS)
        stiffness, per_m = YOUNG * np.pi * radius**4 / 4, GRAVITY * DENSITY * np.pi * radius**2
        return np.array([y[1] / stiffness, -y[2] * np.cos(y[0]), -per_m, np.sin(y[0]), np.cos(y[0])])

    def ends(a: Array, b: Array) -> Array:
        return np.array([a[0], b[1], b[2] - WEIGHT_N, a[3], a[4]])

    s = np.linspace(0.0, LENGTH, 400)
    found = solve_bvp(rates, ends, s, np.zeros((5, len(s))), tol=1e-10, max_nodes=100_000)
    if not found.success:
        raise RuntimeError(found.message)
    return np.asarray(found.y[3:, -1])
