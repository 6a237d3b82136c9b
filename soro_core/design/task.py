"""Task files of topology optimisation, config/design/*.yaml."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from soro_core.config import Strict, find_config, parse, read_yaml
from soro_core.errors import ConfigError
from soro_core.fem.material import Material, load_material, material_from_dict

Positive = Annotated[float, Field(gt=0.0)]
Share = Annotated[float, Field(gt=0.0, lt=1.0)]
Pair = Annotated[tuple[float, float], Field(strict=False)]
Range = Annotated[tuple[Positive, Positive], Field(strict=False)]
Axis = Literal["x", "y"]


class Box(Strict):
    """A rectangle; a side that is left out is that of the whole grid.

    Parameters
    ----------
    kind : str
        box.
    x_m, y_m : tuple of float
        From and to [m].
    """

    kind: Literal["box"]
    x_m: Pair | None = None
    y_m: Pair | None = None


class Disc(Strict):
    """What lies within a radius of a point.

    Parameters
    ----------
    kind : str
        disc.
    centre_m : tuple of float
        The point [m].
    radius_m : float
        The radius [m].
    """

    kind: Literal["disc"]
    centre_m: Pair
    radius_m: Positive


Region = Annotated[Box | Disc, Field(discriminator="kind")]
Regions = Annotated[tuple[Region, ...], Field(strict=False)]


class Held(Strict):
    """Nodes that do not move.

    Parameters
    ----------
    where : Box or Disc
        The nodes.
    along : tuple of str
        Directions in which they do not move: x, y or both.
    """

    where: Region
    along: Annotated[tuple[Axis, ...], Field(strict=False, min_length=1)]


class Stiffest(Strict):
    """The least work of the pressure on a linear part in plane stress.

    Parameters
    ----------
    kind : str
        stiffest.
    youngs_modulus_pa, poisson_ratio : float
        Of the material.
    """

    kind: Literal["stiffest"]
    youngs_modulus_pa: Positive
    poisson_ratio: Annotated[float, Field(ge=0.0, lt=0.5)]


class Farthest(Strict):
    """The greatest motion of a patch against a spring, for its energy: least -u_out / SE^m.

    Parameters
    ----------
    kind : str
        farthest.
    material : str or mapping
        Name or file of a material, or its keys.
    poisson_ratio : float
        In place of that of the material.
    output : Box
        Nodes whose mean motion counts.
    direction : tuple of float
        Wanted; its length plays no part.
    spring_pa : float
        Stiffness of the spring per thickness [N/m2]; of a ring the whole of it per 1 m [N/m2].
    energy_exponent : float
        m: the greater, the stiffer the part.
    """

    kind: Literal["farthest"]
    material: str | dict[str, Any]
    poisson_ratio: Annotated[float, Field(ge=0.0, lt=0.5)] | None = None
    output: Box
    direction: Pair
    spring_pa: Annotated[float, Field(ge=0.0)]
    energy_exponent: Annotated[float, Field(ge=0.0, le=1.0)] = 0.6

    def law(self, where: str) -> Material:
        """Return the material; `where` is named in errors."""
        found = (
            load_material(self.material)
            if isinstance(self.material, str)
            else material_from_dict(self.material, where)
        )
        if self.poisson_ratio is None:
            return found
        return material_from_dict({**found.model_dump(), "poisson_ratio": self.poisson_ratio}, where)


class Air(Strict):
    """How densities let air through, docs/design.md (T3).

    Parameters
    ----------
    threshold, sharpness : float
        Density at which a wall becomes tight, and how suddenly.
    contrast : float
        Conductivity of solid over that of void.
    depth_m : float
        Way into a wall within which the pressure falls to a tenth [m].
    """

    threshold: Share = 0.1
    sharpness: Positive = 8.0
    contrast: Share = 1e-7
    depth_m: Positive


class Schedule(Strict):
    """How the task gets harder as the iterations go on.

    Parameters
    ----------
    iterations : int
        All of them.
    ramp : int
        Over the first ones pressure and penalty rise.
    pressure_pa : tuple of float
        At the inlet, from and to [Pa].
    penalty : tuple of float
        Exponent of the stiffness, from and to.
    sharpness : tuple of float
        Of the projection after the ramp, for equally many iterations each; none without a projection.
    threshold : float
        Density at which the projection steps.
    move : float
        Greatest change of a variable in an iteration.
    """

    iterations: Annotated[int, Field(ge=1, le=10_000)] = 60
    ramp: Annotated[int, Field(ge=0)] = 36
    pressure_pa: Range
    penalty: Range = (1.0, 4.0)
    sharpness: Annotated[tuple[Positive, ...], Field(strict=False)] = (2.0, 4.0, 8.0)
    threshold: Share = 0.5
    move: Annotated[float, Field(gt=0.0, le=1.0)] = 0.1

    @model_validator(mode="after")
    def _ramp_ends(self) -> Schedule:
        if self.ramp > self.iterations:
            raise ValueError(f"ramp {self.ramp} <= iterations {self.iterations}")
        return self

    def at(self, k: int) -> tuple[float, float, float]:
        """Return pressure [Pa], penalty and sharpness (0 without projection) of iteration k, from 0."""
        share = min(1.0, k / (self.ramp - 1)) if self.ramp > 1 else 1.0
        pressure, penalty = (a + share * (b - a) for a, b in (self.pressure_pa, self.penalty))
        if k < self.ramp or not self.sharpness:
            return pressure, penalty, 0.0
        step = (k - self.ramp) * len(self.sharpness) // max(self.iterations - self.ramp, 1)
        return pressure, penalty, self.sharpness[min(step, len(self.sharpness) - 1)]


class Task(Strict):
    """A rectangle in which material is to be distributed.

    Parameters
    ----------
    description : str
        One line.
    space : str
        plane_strain, or axisymmetric about x = 0.
    size_m : tuple of float
        Lengths along x and y [m].
    cells : tuple of int
        Elements along x and y.
    goal : Stiffest or Farthest
        What is wanted.
    held : list of Held
        Nodes that do not move.
    inlet : Box or Disc
        Nodes at full pressure.
    open : list of regions
        Nodes at pressure 0; those of the inlet stay at full pressure.
    solid, void : list of regions
        Elements that stay so, by their centres.
    volume_fraction : float
        Greatest share of the volume that is solid.
    filter_radius_m : float
        Of the density filter [m].
    void_stiffness : float
        Stiffness of void over that of solid.
    air : Air
        How densities let air through.
    schedule : Schedule
        Iterations.
    mirrors : tuple of str
        x where the part goes on behind x = 0, y where it does behind y = 0.
    """

    description: str = ""
    space: Literal["plane_strain", "axisymmetric"] = "plane_strain"
    size_m: Range
    cells: Annotated[tuple[Annotated[int, Field(ge=2)], Annotated[int, Field(ge=2)]], Field(strict=False)]
    goal: Annotated[Stiffest | Farthest, Field(discriminator="kind")]
    held: Annotated[tuple[Held, ...], Field(strict=False, min_length=1)]
    inlet: Region
    open: Annotated[Regions, Field(min_length=1)]
    solid: Regions = ()
    void: Regions = ()
    volume_fraction: Share
    filter_radius_m: Positive
    void_stiffness: Share = 1e-6
    air: Air
    schedule: Schedule
    mirrors: Annotated[tuple[Axis, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _fits(self) -> Task:
        if self.space == "axisymmetric" and isinstance(self.goal, Stiffest):
            raise ValueError("goal farthest about an axis; stiffest is for plane stress")
        return self


def load_task(name_or_path: str | Path) -> Task:
    """Read a task file, or a shipped task by its name (config/design).

    Raises
    ------
    ConfigError
        One line with file, key, what was found and what is allowed.
    """
    path = find_config(name_or_path, "design")
    return task_from_dict(read_yaml(path), str(path))


def task_from_dict(data: dict[str, Any], where: str = "task") -> Task:
    """Make a task from a dictionary with the keys of a task file; errors as in `load_task`."""
    task = parse(data, Task, where)
    if isinstance(task.goal, Farthest):
        if task.goal.direction == (0.0, 0.0):
            raise ConfigError(where, "goal.direction", task.goal.direction, "one that is not zero")
        task.goal.law(where)
    return task
