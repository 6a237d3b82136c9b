"""What is asked of a part: the goal, the loads, the dimensions that vary, and their limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from soro_core.arrays import Array
from soro_core.config import with_changes
from soro_core.errors import ConfigError
from soro_core.files.units import Quantity, unit_of
from soro_design.parts.file import LoadSweep, PartFile, check_part, material_of
from soro_design.parts.geometry import RodGeometry, StatedGeometry
from soro_design.parts.mesh_geometry import MeshGeometry
from soro_design.shape.figures import GOALS

COMMAND = "soro design shape"
# Counts of elements; the search halves all but `across`.
COUNTS = ("around", "across", "between", "along", "plug")
DIGITS = 5


@dataclass(frozen=True)
class Varied:
    """A dimension that varies.

    Attributes
    ----------
    key : str
        Of the geometry.
    low, high : float
        Bounds, in the unit of the key.
    is_count : bool
        Whether it is a whole number.
    """

    key: str
    low: float
    high: float
    is_count: bool


@dataclass(frozen=True)
class ShapeTask:
    """The task of a search.

    Attributes
    ----------
    file : PartFile
        The part to start from.
    goal : str
        Of `soro_design.shape.figures.GOALS`; more is better.
    sweep : LoadSweep
        Its loads.
    varied : tuple of Varied
        What varies.
    max_stretch, min_wall_m : float
        Greatest principal stretch, and least thickness of a wall [m].
    """

    file: PartFile
    goal: str
    sweep: LoadSweep
    varied: tuple[Varied, ...]
    max_stretch: float
    min_wall_m: float

    @property
    def geometry(self) -> StatedGeometry:
        """Of the part to start from."""
        assert not isinstance(self.file.geometry, MeshGeometry)  # checked when the task is made
        return self.file.geometry

    def point_of(self, geometry: StatedGeometry) -> Array:
        """Return the dimensions as a point of the unit cube, at its nearest side where they lie outside."""
        shares = [(getattr(geometry, one.key) - one.low) / (one.high - one.low) for one in self.varied]
        return np.asarray(np.clip(shares, 0.0, 1.0))

    def values(self, point: Array) -> dict[str, Any]:
        """Return the dimensions at a point of the unit cube, of five digits or whole."""
        found: dict[str, Any] = {}
        for one, share in zip(self.varied, point, strict=True):
            value = one.low + float(share) * (one.high - one.low)
            rounded = min(max(float(f"{value:.{DIGITS}g}"), one.low), one.high)
            found[one.key] = round(value) if one.is_count else rounded
        return found

    def snap(self, point: Array) -> Array:
        """Return the point of the nearest design whose whole numbers are whole."""
        whole = [
            (round(one.low + share * (one.high - one.low)) - one.low) / (one.high - one.low)
            if one.is_count
            else share
            for one, share in zip(self.varied, point, strict=True)
        ]
        return np.array(whole, dtype=float)

    def design(self, point: Array) -> PartFile:
        """Return the part at a point.

        Raises
        ------
        ConfigError
            If there is no such part.
        """
        changed = with_changes(self.file, geometry=with_changes(self.geometry, **self.values(point)))
        check_part(changed, COMMAND)
        return changed

    def is_allowed(self, point: Array) -> bool:
        """Whether there is such a part, with walls that are thick enough."""
        try:
            geometry = self.design(point).geometry
        except ConfigError:
            return False
        return wall_of(geometry) >= self.min_wall_m

    def excess(self, stretch: float) -> float:
        """Return by how much a stretch is beyond the limit, as a share of the elongation that is allowed."""
        return (stretch - 1.0) / (self.max_stretch - 1.0) - 1.0


def wall_of(geometry: Any) -> float:
    """Return the least thickness of a wall [m]."""
    return float(geometry.least_wall_m)


def coarse(file: PartFile) -> PartFile:
    """Return a part on a mesh of half as many elements but across walls, whose bending needs them."""
    geometry = file.geometry
    least = {"around": 2} if isinstance(geometry, RodGeometry) else {}

    def halved(key: str, count: Any) -> Any:
        if isinstance(count, tuple):
            return tuple(halved(key, one) for one in count)
        return max(-(-count // 2), least.get(key, 1))

    halves = [key for key in COUNTS if key != "across" and hasattr(geometry, key)]
    counts = {key: halved(key, getattr(geometry, key)) for key in halves}
    return with_changes(file, geometry=with_changes(geometry, **counts))


def make_task(
    file: PartFile,
    goal: str,
    vary: list[str],
    sweep: str = "",
    pressure_pa: float | None = None,
    limits: tuple[float | None, float] = (None, 0.0),
) -> ShapeTask:
    """Return the task of a command line.

    Parameters
    ----------
    file : PartFile
    goal : str
        Of `soro_design.shape.figures.GOALS`.
    vary : list of str
        KEY=LOW:HIGH each, with units.
    sweep : str
        Name of one of the file; default: the first with a pressure.
    pressure_pa : float, optional
        Greatest pressure, to which those of the sweep are scaled.
    limits : tuple of float
        Greatest stretch, by default, None, that at which the material breaks; least thickness of a wall [m].

    Raises
    ------
    ConfigError
        One line for what is not allowed.
    """
    geometry, (max_stretch, min_wall_m) = file.geometry, limits
    if isinstance(geometry, MeshGeometry):
        raise ConfigError(COMMAND, "geometry.kind", "mesh", "a part of stated dimensions")
    if goal not in GOALS:
        raise ConfigError(COMMAND, "--goal", goal, ", ".join(GOALS))
    if goal == "bend" and geometry.space == "axisymmetric":
        raise ConfigError(COMMAND, "--goal", goal, f"{geometry.kind} cannot bend: stroke, force, stiffness")
    varied = tuple(_varied(text, geometry) for text in vary)
    if not varied or len({one.key for one in varied}) < len(varied):
        raise ConfigError(COMMAND, "--vary", vary, "one KEY=LOW:HIGH or more, each key once")
    if max_stretch is None:
        strength = material_of(file).strength
        if strength is None:
            allowed = f"a number above 1; the file of {file.material} has no limit"
            raise ConfigError(COMMAND, "--max-stretch", None, allowed)
        max_stretch = strength.break_stretch
    if not 1.0 < max_stretch < np.inf:
        raise ConfigError(COMMAND, "--max-stretch", max_stretch, "a number above 1")
    loads = _sweep(file, sweep, pressure_pa)
    return ShapeTask(file, goal, loads, varied, max_stretch, min_wall_m)


def _varied(text: str, geometry: StatedGeometry) -> Varied:
    key, _, bounds = text.partition("=")
    fields = type(geometry).model_fields
    names = [name for name in fields if _is_dimension(geometry, name)]
    if key not in names:
        raise ConfigError(COMMAND, "--vary", key, f"of {geometry.kind}: {', '.join(names)}")
    if ":" not in bounds:
        raise ConfigError(COMMAND, f"--vary {key}", bounds, "LOW:HIGH, such as 1mm:2mm")
    quantity = Quantity(unit_of(key), -np.inf, np.inf, "")
    low, high = (quantity.number(one, COMMAND, f"--vary {key}") for one in bounds.split(":", 1))
    is_count = fields[key].annotation is int
    if is_count and not (low.is_integer() and high.is_integer()):
        raise ConfigError(COMMAND, f"--vary {key}", bounds, "whole numbers")
    if not low < high:
        raise ConfigError(COMMAND, f"--vary {key}", bounds, "LOW:HIGH, the lower bound first")
    return Varied(key, low, high, is_count)


def _is_dimension(geometry: StatedGeometry, name: str) -> bool:
    value = getattr(geometry, name)
    return isinstance(value, int | float) and name not in COUNTS


def _sweep(file: PartFile, name: str, pressure_pa: float | None) -> LoadSweep:
    pressed = [one for one in file.sweeps if any(one.pressures_pa)]
    found = [one for one in pressed if name in ("", one.name)]
    if not found:
        names = ", ".join(one.name for one in pressed) or "none: add one to the part file"
        raise ConfigError(COMMAND, "--sweep", name, f"a sweep with a pressure: {names}")
    sweep = found[0]
    if pressure_pa is None:
        return sweep
    if not 0.0 < pressure_pa < np.inf:
        raise ConfigError(COMMAND, "--pressure", pressure_pa, "above 0")
    factor = pressure_pa / max(abs(one) for one in sweep.pressures_pa)
    return with_changes(sweep, pressures_pa=tuple(factor * one for one in sweep.pressures_pa))
