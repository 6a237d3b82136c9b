"""What each ingredient of a robot costs, against the same arm with all of them off."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks import kernels
from benchmarks.options import Options
from benchmarks.report import figure, table
from benchmarks.timing import per_call
from soro_core import Shake, SoftArm, robot_from_dict, simulate
from soro_core.pneumatics import ValveModel

TITLE = "Cost of each ingredient"
LINKS = 4
MATERIAL = {"youngs_modulus": 5e5, "shear_modulus": 5e5 / 3, "shear_correction": False}
LINK: dict[str, Any] = {"length": 0.05, "radius": 0.015, "density": 1100.0, "material": MATERIAL}
LAW = {"material": None, "k_e": [8000.0, 3000.0, 20.0], "k_b": [0.4, 0.1, 0.5]}
CHAMBERS = [{"angle_rad": 2.1 * i, "area_m2": 5e-5, "offset_m": 0.008} for i in range(3)]
TENDONS = [{"angle_rad": 2.1 * i, "offset_m": 0.008} for i in range(3)]
SHAKE = Shake(frequency_hz=5.0, amplitude_m=(0.01, 0.0, 0.0), amplitude_rad=(0.0, 0.2, 0.0))
CREEP = [{"tau": 0.05, "stiffness": [100.0, 1e-3, 1e-3]}]
HYSTERESIS = [{"stiffness": [100.0, 1e-3, 1e-3], "range": [0.05, 1.0, 1.0]}]
SIX = ("elongation", "bending_x", "bending_y", "torsion", "shear_x", "shear_y")

LINEAR = {name: {"basis": "legendre", "order": 1} for name in SIX[:3]}


def by_place(key: str, *values: float) -> list[dict[str, float]]:
    """Sections at equal distances along a link."""
    step = LINK["length"] / (len(values) - 1)
    return [{"place": k * step, key: value} for k, value in enumerate(values)]


# Random states bend the four links of 0.2 m about the world's z: a wall in reach, and one out of reach.
WALL = {"point": [0.0, 0.0, 0.1], "normal": [0.0, 0.0, -1.0], "stiffness": 50.0}
LOSSES = {"damping": 1.0, "friction": 0.5}
AWAY = {**WALL, **LOSSES, "point": [0.0, 0.0, 9.0]}
BALL = {"centre": [0.0, 0.0, 0.15], "radius": 0.05, "stiffness": 50.0, **LOSSES}
ONE_A_LINK = [0.03, 0.08, 0.13, 0.18]

# Name: keys of the link, keys of the robot, arguments of SoftArm, force at the tip [N, N m].
Ingredient = tuple[dict[str, Any], dict[str, Any], dict[str, Any], float]
INGREDIENTS: dict[str, Ingredient] = {
    "all off": ({}, {}, {}, 0.0),
    "gravity": ({}, {"gravity": [0.0, 0.0, -9.81]}, {}, 0.0),
    "tip mass": ({}, {"tip_mass": 0.02}, {}, 0.0),
    "wrench at the tip": ({}, {}, {}, 0.01),
    "point masses, one a link": (
        {},
        {"point_masses": [{"place": s, "mass": 0.02} for s in ONE_A_LINK]},
        {},
        0.0,
    ),
    "wrenches, one a link": ({}, {"wrench_places": ONE_A_LINK}, {}, 0.01),
    "plane out of reach, 1 point a link": (
        {},
        {"contacts": {"planes": [AWAY], "points_per_link": 1}},
        {},
        0.0,
    ),
    "plane out of reach, 5 points a link": ({}, {"contacts": {"planes": [AWAY]}}, {}, 0.0),
    "plane, 5 points a link": ({}, {"contacts": {"planes": [WALL]}}, {}, 0.0),
    "plane, with damping and friction": ({}, {"contacts": {"planes": [{**WALL, **LOSSES}]}}, {}, 0.0),
    "sphere, with damping and friction": ({}, {"contacts": {"spheres": [BALL]}}, {}, 0.0),
    "tip held": ({}, {"tip_constraint": {"point": [0.0, 0.0, 0.2]}}, {}, 0.0),
    "viscosity of the material": ({"material": {**MATERIAL, "viscosity": 300.0}}, {}, {}, 0.0),
    "damping by coordinate": ({"damping": [0.1, 1e-6, 1e-6]}, {}, {}, 0.0),
    "hyper-elastic law, deformed angle": (LAW, {}, {}, 0.0),
    "hyper-elastic law, geometric angle": (LAW, {"bend_angle": "geometric"}, {}, 0.0),
    "creep, one branch": ({"creep": CREEP}, {}, {}, 0.0),
    "hysteresis": ({"hysteresis": HYSTERESIS}, {}, {}, 0.0),
    "three chambers a link": ({"chambers": CHAMBERS}, {}, {}, 0.0),
    "their area by strain": ({"chambers": [{**one, "area_slope": -5.0} for one in CHAMBERS]}, {}, {}, 0.0),
    "their air as states, behind valves": ({"chambers": CHAMBERS}, {}, {}, 0.0),
    "three straight tendons along all links": ({}, {"tendons": TENDONS}, {}, 0.0),
    "three helical tendons along all links": (
        {},
        {"tendons": [{**one, "turns": 1.0} for one in TENDONS]},
        {},
        0.0,
    ),
    "a base that shakes": ({}, {}, {}, 0.0),
    "all six strains": ({"strains": {name: {} for name in SIX}}, {}, {}, 0.0),
    "radius by place, at the ends": (
        {"radius": None, "sections": by_place("radius", 0.015, 0.008)},
        {},
        {},
        0.0,
    ),
    "radius by place, at five": (
        {"radius": None, "sections": by_place("radius", 0.015, 0.014, 0.012, 0.01, 0.008)},
        {},
        {},
        0.0,
    ),
    "rest curvature and torsion": (
        {"rest_curvature_per_m": [5.0, 2.0], "rest_torsion_per_m": 10.0},
        {},
        {},
        0.0,
    ),
    "linear strains": ({"strains": LINEAR}, {}, {}, 0.0),
    "linear strains, rest torsion by place": (
        {"strains": LINEAR, "sections": by_place("rest_torsion_per_m", 0.0, 10.0)},
        {},
        {},
        0.0,
    ),
    "method mde, 20 steps a link": ({}, {}, {"method": "mde"}, 0.0),
}
TOGETHER: Ingredient = (
    {**LAW, "damping": [0.1, 1e-6, 1e-6], "creep": CREEP, "hysteresis": HYSTERESIS}
    | {"chambers": INGREDIENTS["their area by strain"][0]["chambers"]},
    {"gravity": [0.0, 0.0, -9.81], "tip_mass": 0.02},
    {},
    0.01,
)


def run(options: Options) -> str:
    """Measure and write."""
    cases = {**INGREDIENTS, "all losses, loads and chambers": TOGETHER}
    if options.quick:
        cases = {name: cases[name] for name in ("all off", "gravity", "all losses, loads and chambers")}
    calls, steps = {}, {}
    for name, case in cases.items():
        options.say(name)
        arm = make(case)
        q, qd = states(arm)
        calls[name] = kernels.in_a_loop(arm, q, qd, pressure(arm), internal=0.01, force=case[3])
        steps[name] = stepping(
            arm, q[0], ValveModel() if "behind valves" in name else None, SHAKE if "base" in name else None
        )
    options.say("timing")
    call_s, step_s = per_call(calls, options.repeats), per_call(steps, options.repeats)
    base, base_step = call_s["all off"], step_s["all off"]
    rows = [
        [
            name,
            figure(1e6 * call_s[name]),
            f"{100 * (call_s[name] / base - 1):+.0f}",
            figure(1e6 * step_s[name]),
            f"{100 * (step_s[name] / base_step - 1):+.0f}",
        ]
        for name in cases
    ]
    head = ["ingredient", "forward dynamics, us", "more, %", "step of trapezoidal, us", "more, %"]
    intro = (
        f"{LINKS} links of three strains, linear material without viscosity, no gravity; each ingredient by "
        "itself on top of that. A step is one of 0.5 ms of `simulate`; the iterations that it needs differ. "
        "Air is a state of the step alone: forward dynamics takes pressures. A base that moves too is one of "
        "the step, with its function of time in Python."
    )
    return f"{intro}\n\n{table(head, rows)}"


def make(case: Ingredient) -> SoftArm:
    """Arm with one ingredient."""
    link, keys, arguments, _ = case
    merged = {key: value for key, value in {**LINK, **link}.items() if value is not None}
    return SoftArm(
        robot_from_dict({"links": [merged] * LINKS, "gravity": [0.0, 0.0, 0.0], **keys}), **arguments
    )


def states(arm: SoftArm, count: int = 64) -> tuple[np.ndarray, np.ndarray]:
    """Random states, (count, n_q)."""
    rng = np.random.default_rng(0)
    bent = ["bending" in name or "torsion" in name for name in arm.robot.coordinate_names]
    scale = np.where(bent, 5.0, 0.05)
    q = np.clip(rng.normal(size=(count, arm.n_q)), -3, 3) * scale
    return q, rng.normal(size=q.shape) * 5 * scale


def pressure(arm: SoftArm) -> np.ndarray:
    """1e4 Pa in all chambers, 0.5 N in all tendons."""
    return np.repeat([1e4, 0.5], [len(arm.robot.chamber_names), len(arm.robot.tendons)])


def stepping(
    arm: SoftArm, q0: np.ndarray, valves: ValveModel | None, base: Shake | None = None
) -> Callable[[int], None]:
    """Run of n steps."""
    held = pressure(arm)

    def run(n: int) -> None:
        done = 0
        while done < n:
            part = min(n - done, 100)
            result = simulate(
                arm, 0.2 * q0, t_end=part * 5e-4, dt=5e-4, pressure=held, valves=valves, base=base
            )
            if not result.status.ok:
                raise RuntimeError(result.status)
            done += part

    return run
