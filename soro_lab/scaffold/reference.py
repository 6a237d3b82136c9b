"""A first reference that an arm can follow within its range of pressures."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.control.motions.kinematics import elongation_for_pressure
from soro_core.errors import ModelError
from soro_core.model import SoftArm
from soro_core.model.equilibrium.rest_forces import RestForces
from soro_core.model.equilibrium.statics import equilibrium, stable_equilibrium
from soro_core.robot import Robot
from soro_core.robot.coordinates import StrainFields, strain_fields

# Bend of a link and of the whole arm on the circle, at most [rad].
LINK_BEND, ARM_BEND = 0.8, 1.2
# What is left to the feedback: below, part of the mean pressure, and above, part of the range.
LOWER, UPPER = 0.2, 0.15
# Part of the largest curvature that these pressures hold.
USED = 0.8
_SHRINK, _STEPS, _POINTS, _MISSED = 0.85, 40, 12, 1e-3
# Mean pressures of a circle that are tried, parts of the range: a soft arm gets too long with high ones.
MEANS = (0.5, 0.35, 0.25, 0.15, 0.1, 0.05)
# Pressures of a resting place: middle and swing over the chambers of a link, parts of the range.
MIDDLE, SWING = 0.4, 0.25
# Largest elongation of either.
LONGEST = 0.35


@dataclass(frozen=True)
class FirstReference:
    """A reference.

    Attributes
    ----------
    kind : str
        circle, set_point or hold.
    curvature_per_m, mean_pressure_pa : float
        Of a circle.
    set_point : tuple of float
        Of a set point: the coordinates.
    """

    kind: str
    curvature_per_m: float = 0.0
    mean_pressure_pa: float = 0.0
    set_point: tuple[float, ...] = ()


def first_reference(robot: Robot) -> FirstReference:
    """Return a circle where the chambers of every link drive all its strains, else a resting place."""
    arm = SoftArm(robot)
    fields = strain_fields(robot)
    if all(link.n_q == 3 for link in robot.links) and _rank(arm) == arm.n_q:
        low, high = robot.pressure_range_pa
        for part in MEANS:
            mean = float(f"{low + part * (high - low):.4g}")
            curvature = _circle(arm, fields, mean)
            if curvature > 0.0:
                return FirstReference("circle", curvature, mean)
    place = _resting_place(arm, fields)
    if place is None:
        return FirstReference("hold")
    return FirstReference("set_point", set_point=tuple(float(f"{x:.4g}") for x in place))


def reached_tip(robot: Robot, reference: FirstReference) -> Array:
    """Return a place [m] where the tip can rest, away from where the reference holds it on average (3,).

    Raises
    ------
    ModelError
        If the arm has no rest there.
    """
    arm, (low, high) = SoftArm(robot), robot.pressure_range_pa
    mean = reference.mean_pressure_pa if reference.kind == "circle" else low
    first = np.array([name.endswith("/chamber0") for name in robot.chamber_names])
    q = stable_equilibrium(arm, mean + np.where(first, 0.2 * min(high - mean, 0.5 * (high - low)), 0.0))
    return np.asarray(arm.pose(q, arm.length)[:3, 3])


def rests(robot: Robot, parts: int) -> bool:
    """Return whether the arm has a stable rest at its lowest pressures, found from the straight arm.

    Parameters
    ----------
    robot : Robot
    parts : int
        Links for each of the robot: an arm of more links buckles under a smaller load.
    """
    arm = SoftArm(robot.refine(parts))
    low = np.full(arm.n_u, max(robot.pressure_range_pa[0], 0.0))
    try:
        q = equilibrium(arm, low)
    except ModelError:
        return False
    return RestForces(arm, low).is_stable(q)


def _rank(arm: SoftArm) -> int:
    actuation = arm.actuation_matrix(np.zeros(arm.n_q))
    size = np.max(np.abs(actuation), axis=1, keepdims=True)
    return int(np.linalg.matrix_rank(actuation / np.where(size > 0.0, size, 1.0), tol=1e-6))


def _circle(arm: SoftArm, fields: StrainFields, mean_pa: float) -> float:
    """Return a curvature [1/m] of every link that the pressures hold all round; 0 without one.

    Parameters
    ----------
    arm : SoftArm
    fields : StrainFields
        Of the robot.
    mean_pa : float
        Mean pressure [Pa gauge].
    """
    low, high = arm.robot.pressure_range_pa
    span = high - low
    ends = np.full(arm.n_u, low), np.full(arm.n_u, high)
    across, along, stretch = (fields.of(s) * fields.uniform for s in ("bending_x", "bending_y", "elongation"))
    longest = max(link.length for link in arm.robot.links)
    curvature = min(LINK_BEND / longest, ARM_BEND / arm.length)
    for _ in range(_STEPS):
        middle = elongation_for_pressure(arm, fields, curvature * across, stretch, mean_pa, *ends)
        if middle > LONGEST:
            return 0.0
        turns = 2.0 * math.pi * np.arange(_POINTS) / _POINTS
        ring = [middle * stretch + curvature * (math.cos(x) * across + math.sin(x) * along) for x in turns]
        if all(_held(arm, q, low + LOWER * (mean_pa - low), high - UPPER * span) for q in ring):
            return float(f"{USED * curvature:.2g}")
        curvature *= _SHRINK
    return 0.0


def _held(arm: SoftArm, q: Array, low: float, high: float) -> bool:
    """Whether pressures of a range hold the arm at rest.

    Parameters
    ----------
    arm : SoftArm
    q : ndarray (n_q,)
        Coordinates.
    low, high : float
        Range [Pa gauge].
    """
    from scipy.optimize import lsq_linear

    actuation = arm.actuation_matrix(q)
    unit = np.max(np.abs(actuation), axis=1) * (high - low)
    load = (arm.gravity_force(q) + arm.elastic_force(q)) / unit
    found = lsq_linear(
        actuation * (high - low) / unit[:, None], load, (low / (high - low), high / (high - low))
    )
    return bool(np.max(np.abs(found.fun)) < _MISSED)


def _resting_place(arm: SoftArm, fields: StrainFields) -> Array | None:
    """Return coordinates (n_q,) of a stable rest, bent away from angle 0; None without one."""
    low, high = arm.robot.pressure_range_pa
    angles = np.array([chamber.angle_rad for link in arm.robot.links for chamber in link.chambers])
    lengths = np.where(fields.stretch, LINK_BEND / LONGEST, fields.length)
    for size in (1.0, 0.5, 0.25, 0.12, 0.06):
        target = np.clip(size * (low + (high - low) * (MIDDLE + SWING * np.cos(angles))), low, high)
        q = np.zeros(arm.n_q)
        try:
            for part in (0.25, 0.5, 0.75, 1.0):
                q = equilibrium(arm, part * target, q)
        except ModelError:
            continue
        if np.max(fields.peaks(q) * lengths) < LINK_BEND and RestForces(arm, target).is_stable(q):
            return q
    return None
