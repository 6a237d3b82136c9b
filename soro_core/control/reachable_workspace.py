"""Where the tip rests under the pressures that an arm may have."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ModelError, short
from soro_core.model import SoftArm
from soro_core.model.checks import number, require
from soro_core.model.equilibrium.statics import stable_equilibrium

# Combinations of pressures, at most so many; every chamber has at least two levels.
MOST = 1000
# Directions about the base, for the radius that the tip reaches in each.
_DIRECTIONS = 12


@dataclass(frozen=True)
class Reachable:
    """Places of the tip at rest.

    Attributes
    ----------
    tip_m : ndarray (n, 3)
        Positions in the world [m].
    pressure_pa : ndarray (n, n_u)
        Their pressures [Pa gauge], then tensions of the tendons [N].
    q : ndarray (n, n_q)
        Their coordinates.
    rest_m : ndarray (3,)
        Position at the lowest pressures [m].
    failed : int
        Combinations of pressures for which no stable rest was found.
    """

    tip_m: Array
    pressure_pa: Array
    q: Array
    rest_m: Array
    failed: int

    def numbers(self) -> list[tuple[str, str]]:
        """Return names and values for a table."""
        low, high = _in_mm(self.tip_m.min(axis=0)), _in_mm(self.tip_m.max(axis=0))
        rows = [(f"{axis}, mm", f"{a:.1f} to {b:.1f}") for axis, a, b in zip("xyz", low, high, strict=True)]
        away = self.tip_m - self.rest_m
        angle, radius = np.arctan2(away[:, 1], away[:, 0]), np.hypot(away[:, 0], away[:, 1])
        sector = np.floor((angle + math.pi) / (2.0 * math.pi) * _DIRECTIONS).astype(int) % _DIRECTIONS
        reach = [radius[sector == k].max(initial=0.0) for k in range(_DIRECTIONS)]
        rows += [
            ("sideways in the best direction, mm", f"{1e3 * max(reach):.1f}"),
            (f"sideways in the worst of {_DIRECTIONS} directions, mm", f"{1e3 * min(reach):.1f}"),
            ("tip at the lowest pressures, mm", ", ".join(f"{x:.1f}" for x in _in_mm(self.rest_m))),
            ("combinations of pressures", f"{len(self.tip_m)}, {self.failed} without a stable rest"),
        ]
        return rows


def reachable(
    arm: SoftArm,
    minimum_pa: float | None = None,
    maximum_pa: float | None = None,
    load_kg: float = 0.0,
) -> Reachable:
    """Return where the tip rests under a grid of pressures, and of tensions of the tendons.

    Parameters
    ----------
    arm : SoftArm
        Model.
    minimum_pa, maximum_pa : float, optional
        Range of the pressures [Pa gauge]; default that of the robot. Tendons have their own, from 0 N.
    load_kg : float
        Mass at the tip beside that of the robot [kg].

    Returns
    -------
    Reachable

    Raises
    ------
    ModelError
        If an argument is not allowed, or the arm has no stable rest under any of them.
    """
    require(arm, SoftArm, "arm", "a SoftArm")
    low, high = arm.robot.pressure_range_pa
    low, high = low if minimum_pa is None else minimum_pa, high if maximum_pa is None else maximum_pa
    for name, value in (("minimum_pa", low), ("maximum_pa", high)):
        if not math.isfinite(number(value)):
            raise ModelError(f"{name}: got {short(value)}; allowed is a finite number", name)
    least = min(0.0, arm.robot.pressure_range_pa[0])
    if not least <= low <= high:
        allowed = f"{least:g} Pa to maximum_pa, {high:g} Pa"
        raise ModelError(f"minimum_pa: got {low:g} Pa; allowed is {allowed}", "minimum_pa")
    if not 0.0 <= number(load_kg) < math.inf:
        raise ModelError(f"load_kg: got {short(load_kg)}; allowed is 0 or more", "load_kg")
    lowest, highest = arm.robot.input_range
    chambers = len(arm.robot.chamber_names)  # what the arguments bound; tendons follow
    lowest[:chambers], highest[:chambers] = low, high
    grid = pressure_grid(lowest, highest)
    found: list[tuple[Array, Array]] = []
    for pressure in grid:
        try:
            q = stable_equilibrium(arm, pressure, found[-1][1] if found else None, load_kg)
        except ModelError:
            continue
        found.append((pressure, q))
    if not found:
        raise ModelError(f"{arm.robot.name} has no stable rest under any pressure", "load")
    pressures, coordinates = (np.array(rows) for rows in zip(*found, strict=True))
    tips = arm.poses(coordinates, arm.length)[:, :3, 3]
    return Reachable(tips, pressures, coordinates, tips[0], len(grid) - len(found))


def _in_mm(position_m: Array) -> Array:
    """Return a position [m] in tenths of a millimetre, as [mm], without a negative zero."""
    return np.asarray(np.round(1e3 * position_m, 1) + 0.0)


def pressure_grid(minimum_pa: Array, maximum_pa: Array) -> Array:
    """Return at most `MOST` combinations of pressures (n, n_u), the lowest ones first."""
    n = len(minimum_pa)
    levels = max(2, int(MOST ** (1.0 / n) + 1e-9))
    # Of many chambers, evenly spread combinations of the lowest and the highest pressures.
    numbers = range(0, levels**n, max(1, levels**n // MOST))
    digits = np.array([[k // levels**i % levels for i in reversed(range(n))] for k in numbers])
    return np.asarray(minimum_pa + digits / (levels - 1) * (maximum_pa - minimum_pa))
