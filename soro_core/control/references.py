"""The configured reference of a robot, and gains spread over its coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.control.config import ControllerConfig, ReferenceConfig
from soro_core.control.kinematics import elongation_for_pressure
from soro_core.control.trajectory import Circle, Hold, Reference
from soro_core.errors import ConfigError
from soro_core.model import SoftArm
from soro_core.robot import Robot

Array: TypeAlias = NDArray[np.float64]

_STRETCH = ("elongation", "shear_x", "shear_y")


def strains(robot: Robot) -> list[tuple[int, str]]:
    """Return (link, strain) of every coordinate."""
    parts = [name.split("/") for name in robot.coordinate_names]
    return [(int(part[0].removeprefix("link")), part[1]) for part in parts]


def per_coordinate(robot: Robot, values: Sequence[float], key: str, by_kind: bool = False) -> Array:
    """Spread values over the coordinates: one each, one a strain of a link, or by kind.

    Raises
    ------
    ConfigError
        If the number of values fits neither.
    """
    found = strains(robot)
    if by_kind:
        return np.array([values[0] if strain in _STRETCH else values[1] for _, strain in found])
    n, links = len(found), len(robot.links)
    if len(values) == n:
        return np.array(values, dtype=np.float64)
    if n == links * len(values):
        return np.tile(np.array(values, dtype=np.float64), links)
    raise ConfigError(
        "controller", key, list(values), f"{n} values, one a coordinate, or {n // links}, for a link"
    )


def coordinate_limits(robot: Robot, config: ReferenceConfig) -> Array:
    """Return the largest absolute value of each coordinate (n_q,) that a reference may have."""
    return np.array(
        [
            config.stretch_limit if strain in _STRETCH else config.bend_limit_rad / robot.links[link].length
            for link, strain in strains(robot)
        ]
    )


def configured_reference(arm: SoftArm, config: ControllerConfig, q: Array, t: float) -> Reference:
    """Return the reference that the configuration asks for, from time `t` on, the arm being in `q`."""
    settings, robot = config.reference, arm.robot
    if settings.kind == "hold":
        return Hold(q)
    if settings.kind == "set_point":
        return Hold(per_coordinate(robot, settings.set_point, "reference.set_point"))
    kinds = [strain for _, strain in strains(robot)]
    across = np.array([float(kind == "bending_x") for kind in kinds])
    along = np.array([float(kind == "bending_y") for kind in kinds])
    stretch = np.array([float(kind == "elongation") for kind in kinds])
    if not (across.any() and along.any()):
        raise ConfigError(
            "controller", "reference.kind", "circle", "set_point or hold for an arm without two bendings"
        )
    elongation = settings.elongation
    if settings.choose_elongation:
        low = np.full(arm.n_u, config.pressures.minimum_pa)
        high = np.full(arm.n_u, config.pressures.maximum_pa)
        bent = settings.curvature_per_m * across
        elongation = elongation_for_pressure(arm, bent, stretch, settings.mean_pressure_pa, low, high)
    return Circle(elongation * stretch, across, along, settings.curvature_per_m, settings.period_s, t)
