"""Task files of topology optimisation, config/design/*.yaml."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import BeforeValidator, Field, model_validator

from soro_core.config import Strict, find_config, parse, read_yaml, with_changes
from soro_design.topology.goals import (
    Box,
    Disc,
    Farthest,
    Positive,
    Region,
    Regions,
    Share,
    Stiffest,
    one_or_more,
)

Range = Annotated[tuple[Positive, Positive], Field(strict=False)]
Axis = Literal["x", "y", "z"]


class FixedRegion(Strict):
    """Nodes that do not move."""

    where: Annotated[Region, Field(description="the nodes")]
    along: Annotated[
        tuple[Axis, ...],
        Field(strict=False, min_length=1, description="directions in which they do not move"),
    ]


class Start(Strict):
    """Density that the elements of a region start with."""

    where: Annotated[Region, Field(description="the elements, by their centres")]
    density: Annotated[float, Field(ge=0.0, le=1.0, description="a later region replaces an earlier one")]


class Repeat(Strict):
    """A cell that follows upon itself along an axis: lobes of a bellow, chambers of a finger."""

    along: Axis
    from_m: Annotated[float, Field(ge=0.0, description="where the first cell begins")] = 0.0
    pitch_m: Annotated[Positive, Field(description="length of a cell, whole elements")]
    number: Annotated[int, Field(ge=2, description="of cells")]
    mirrored: Annotated[bool, Field(description="whether each cell is its own image")] = False


class AirPermeability(Strict):
    """How densities let air through, docs/design.md (T3)."""

    threshold: Annotated[Share, Field(description="density at which a wall becomes tight")] = 0.1
    sharpness: Annotated[Positive, Field(description="how suddenly")] = 8.0
    contrast: Annotated[Share, Field(description="conductivity of solid over that of void")] = 1e-7
    depth_m: Annotated[
        Positive, Field(description="way into a wall within which the pressure falls to a tenth")
    ]


class Schedule(Strict):
    """How the task gets harder as the iterations go on."""

    iterations: Annotated[int, Field(ge=1, le=10_000, description="all of them")] = 60
    ramp: Annotated[int, Field(ge=0, description="over the first ones pressure and penalty rise")] = 36
    pressure_pa: Annotated[Range, Field(description="at the inlet, from and to")]
    penalty: Annotated[
        tuple[Positive, ...],
        Field(
            strict=False,
            min_length=2,
            max_length=3,
            description="exponent of the stiffness, from and to; a third number with the last sharpness",
        ),
    ] = (1.0, 4.0)
    sharpness: Annotated[
        tuple[Positive, ...],
        Field(
            strict=False,
            description="of the projection after the ramp, each for as many iterations; none without one",
        ),
    ] = (2.0, 4.0, 8.0)
    threshold: Annotated[Share, Field(description="density at which the projection steps")] = 0.5
    margin: Annotated[
        float,
        Field(
            ge=0.0,
            lt=1.0,
            description="by which a thinner part steps at a higher threshold, in the end; the goal is the "
            "mean of both, such that walls and hinges keep a width. Twice the time after the ramp",
        ),
    ] = 0.0
    move: Annotated[float, Field(gt=0.0, le=1.0, description="greatest change of a variable a step")] = 0.1

    @model_validator(mode="after")
    def _ramp_ends(self) -> Schedule:
        if self.ramp > self.iterations:
            raise ValueError(f"ramp {self.ramp} <= iterations {self.iterations}")
        if self.threshold + self.margin >= 1.0:
            raise ValueError(f"threshold {self.threshold:g} + margin {self.margin:g} < 1")
        if self.margin and not (self.sharpness and self.ramp < self.iterations):
            raise ValueError("margin with sharpness and ramp < iterations alone: else both parts are one")
        if len(self.penalty) == 3 and not 0 < len(self.sharpness) <= self.iterations - self.ramp:
            raise ValueError("a third penalty with sharpness, each of an iteration behind the ramp")
        return self

    def margin_at(self, k: int) -> float:
        """Return the margin of iteration k, from 0; it grows from the end of the ramp to the last one."""
        return self.margin * max(k + 1 - self.ramp, 0) / max(self.iterations - self.ramp, 1)

    def at(self, k: int) -> tuple[float, float, float]:
        """Return pressure [Pa], penalty and sharpness (0 without projection) of iteration k, from 0."""
        share = min(1.0, k / (self.ramp - 1)) if self.ramp > 1 else 1.0
        pressure, penalty = (a + share * (b - a) for a, b in (self.pressure_pa, self.penalty[:2]))
        if k < self.ramp or not self.sharpness:
            return pressure, penalty, 0.0
        step = (k - self.ramp) * len(self.sharpness) // max(self.iterations - self.ramp, 1)
        last = len(self.sharpness) - 1
        return pressure, self.penalty[-1] if step >= last else penalty, self.sharpness[min(step, last)]


class Task(Strict):
    """A rectangle or box in which material is to be distributed."""

    description: Annotated[str, Field(description="one line")] = ""
    space: Annotated[
        Literal["plane_strain", "axisymmetric", "solid"],
        Field(description="axisymmetric about x = 0; solid with three lengths"),
    ] = "plane_strain"
    size_m: Annotated[
        tuple[Positive, ...],
        Field(strict=False, min_length=2, max_length=3, description="lengths along x, y and, of a solid, z"),
    ]
    cells: Annotated[
        tuple[Annotated[int, Field(ge=2)], ...],
        Field(strict=False, min_length=2, max_length=3, description="elements along each of them"),
    ]
    goal: Annotated[Stiffest | Farthest, Field(discriminator="kind", description="what is best")]
    held: Annotated[
        tuple[FixedRegion, ...], Field(strict=False, min_length=1, description="nodes that do not move")
    ]
    inlet: Annotated[
        Regions,
        BeforeValidator(one_or_more),
        Field(min_length=1, description="nodes at full pressure; a region, or a list of them"),
    ]
    open: Annotated[
        Regions,
        Field(min_length=1, description="nodes at pressure 0; those of the inlet stay at full pressure"),
    ]
    solid: Annotated[Regions, Field(description="elements that stay so, by their centres")] = ()
    void: Annotated[Regions, Field(description="elements that stay so, by their centres")] = ()
    start: Annotated[
        tuple[Start, ...],
        Field(strict=False, description="what the iterations begin with; elsewhere volume_fraction"),
    ] = ()
    repeat: Annotated[
        Repeat | None, Field(description="densities that come again; given elements stay as they are")
    ] = None
    quarter_turns: Annotated[
        bool, Field(description="whether densities come again with quarter turns about a square's middle")
    ] = False
    volume_fraction: Annotated[Share, Field(description="greatest share of the volume that is solid")]
    stretch_limit: Annotated[
        float | None,
        Field(gt=1.0, description="greatest principal stretch; else that at which the material breaks"),
    ] = None
    filter_radius_m: Annotated[Positive, Field(description="of the density filter")]
    void_stiffness: Annotated[Share, Field(description="stiffness of void over that of solid")] = 1e-6
    air: Annotated[AirPermeability, Field(description="how air passes solid and void")]
    schedule: Annotated[Schedule, Field(description="what changes with the iterations")]
    mirrors: Annotated[
        tuple[Axis, ...],
        Field(strict=False, description="directions in which the part goes on behind 0, as its image"),
    ] = ()
    lid_mm: Annotated[
        Positive | None,
        Field(description="thickness of the solid that closes either end of a part in plane strain"),
    ] = None
    height_mm: Annotated[
        Positive | None,
        Field(description="along z, of a part with lids, these among it; else its least length along x or y"),
    ] = None

    @model_validator(mode="after")
    def _fits(self) -> Task:
        if self.space != "plane_strain" and isinstance(self.goal, Stiffest):
            raise ValueError("goal farthest about an axis and of a solid; stiffest is for plane stress")
        if self.stretch_limit is not None and isinstance(self.goal, Stiffest):
            raise ValueError("stretch_limit with goal farthest alone: stiffest is linear")
        d = 3 if self.space == "solid" else 2
        for name, found in (("size_m", self.size_m), ("cells", self.cells), *self._vectors()):
            if len(found) != d:
                raise ValueError(f"{name} of {d} numbers in space {self.space}")
        along = {axis for one in self.held for axis in one.along} | set(self.mirrors)
        if self.repeat is not None:
            along.add(self.repeat.along)
        if d == 2 and ("z" in along or any(isinstance(r, Box) and r.z_m for r in self._regions())):
            raise ValueError("z in space solid alone")
        return self

    @model_validator(mode="after")
    def _turns_fit(self) -> Task:
        if isinstance(self.goal, Farthest) and self.goal.about_m and self.space != "plane_strain":
            raise ValueError("goal.about_m in space plane_strain alone")
        if not self.quarter_turns:
            return self
        if len({*self.size_m}) > 1 or len({*self.cells}) > 1 or self.space != "plane_strain":
            raise ValueError("quarter_turns of a square in plane strain, with as many elements along x and y")
        if self.repeat is not None or self.mirrors:
            raise ValueError("quarter_turns without repeat and mirrors")
        return self

    @model_validator(mode="after")
    def _lids_fit(self) -> Task:
        if self.lid_mm is None:
            if self.height_mm is not None:
                raise ValueError("height_mm with lid_mm alone; another part takes --extrude")
            return self
        if self.space != "plane_strain" or isinstance(self.goal, Stiffest):
            raise ValueError("lid_mm in space plane_strain with goal farthest alone")
        if self.goal.stiff is not None:
            raise ValueError("lid_mm without goal.stiff: lids of one material alone")
        if 2.0 * self.lid_mm >= 1e3 * self.height_m:
            raise ValueError(
                f"lid_mm {self.lid_mm:g} below half the height of the part, {500.0 * self.height_m:g} mm"
            )
        return self

    @property
    def shares_variables(self) -> bool:
        """Whether elements share design variables."""
        return self.repeat is not None or self.quarter_turns

    @property
    def lid_m(self) -> float:
        """Thickness of a lid [m], 0 without."""
        return 1e-3 * (self.lid_mm or 0.0)

    @property
    def height_m(self) -> float:
        """Height of a part with lids along z [m]."""
        if self.height_mm is not None:
            return 1e-3 * self.height_mm
        sides = zip("xyz", self.size_m, strict=False)
        return min(size * (2.0 if axis in self.mirrors else 1.0) for axis, size in sides)

    def _regions(self) -> Iterator[Region]:
        yield from (*self.inlet, *self.open, *self.solid, *self.void)
        yield from (one.where for one in self.held)
        yield from (one.where for one in self.start)
        if isinstance(self.goal, Farthest):
            yield from self.goal.output

    def _vectors(self) -> Iterator[tuple[str, tuple[float, ...]]]:
        yield from (("centre_m", one.centre_m) for one in self._regions() if isinstance(one, Disc))
        if isinstance(self.goal, Farthest) and self.goal.direction is not None:
            yield "goal.direction", self.goal.direction


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
        task.goal.law(where)
    return task


def resolved(task: Task, where: str = "task") -> Task:
    """Return a task that needs no other file: the keys of its material stand in it."""
    if isinstance(task.goal, Stiffest):
        return task
    return with_changes(task, goal=task.goal.with_keys_of_material(where))


def write_task(task: Task, path: Path) -> None:
    """Write a task as a file that `load_task` reads."""
    data = json.loads(task.model_dump_json(exclude_none=True, exclude_unset=True))
    path.write_text(
        yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=110), encoding="utf-8"
    )
