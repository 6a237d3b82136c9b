"""The keys of a column map: which columns of a CSV file are what, in which units."""

from __future__ import annotations

import itertools
import math
from typing import Annotated, Literal, TypeAlias

from pydantic import Field, field_validator, model_validator

from soro_core.config import Strict, with_changes
from soro_core.errors import ConfigError
from soro_core.robot import Link, Robot
from soro_core.robot.vectors import Vector2, Vector3
from soro_lab.identification.recording.place import Place

Column: TypeAlias = Annotated[str, Field(min_length=1)]
Three: TypeAlias = Annotated[tuple[Column, Column, Column], Field(strict=False)]
Four: TypeAlias = Annotated[tuple[Column, Column, Column, Column], Field(strict=False)]
Levels: TypeAlias = Annotated[tuple[Vector2, ...], Field(strict=False, min_length=1)]
Length: TypeAlias = Literal["m", "mm"]

# Of a direction square to the only one in which a link bends, the other component.
_SQUARE = 1e-3

FACTORS = {
    "s": 1.0,
    "ms": 1e-3,
    "us": 1e-6,
    "ns": 1e-9,
    "Pa": 1.0,
    "kPa": 1e3,
    "mbar": 1e2,
    "bar": 1e5,
    "m": 1.0,
    "mm": 1e-3,
    "1/m": 1.0,
    "1/mm": 1e3,
    "rad": 1.0,
    "deg": 3.141592653589793 / 180.0,
}
"""Factors from units to SI; V needs a scale."""


class TimeColumn(Strict):
    """The stamps."""

    column: Column = "t"
    unit: Literal["s", "ms", "us", "ns"] = "s"


class PressureColumns(Strict):
    """Pressures or set points of chambers by the names of the robot file, gauge."""

    unit: Literal["Pa", "kPa", "mbar", "bar", "V"] = "Pa"
    scale_pa_v: float | None = Field(None, description="unit V: pascals a volt")
    offset_pa: float = Field(
        0.0, description="pressure at a reading of 0, of absolute or shifted sensors [Pa]"
    )
    columns: dict[str, Column] = Field({}, description="column of each chamber")
    stated: dict[str, Levels] = Field(
        {}, description="chambers without a column: [time [s], level] of each step, in `unit`"
    )
    stated_by_file: dict[str, dict[str, Levels]] = Field(
        {}, description="the same by the name of the file without its ending, where levels differ by file"
    )
    stated_lag_s: Vector2 = Field(
        (0.0, 0.0), description="lag [s] with which a stated level is reached, of a rise and of a fall"
    )
    range: Vector2 | None = Field(
        None, description="readings outside are left out, in `unit`; default: the robot's range, half wider"
    )

    @model_validator(mode="after")
    def _consistent(self) -> PressureColumns:
        if (self.unit == "V") != (self.scale_pa_v is not None):
            raise ValueError("scale_pa_v beside unit V, and only there")
        if min(self.stated_lag_s) < 0.0:
            raise ValueError("stated_lag_s of 0 s or more")
        if self.range is not None and not self.range[0] < self.range[1]:
            raise ValueError("range [lowest, highest] with lowest < highest")
        return self

    @field_validator("stated", "stated_by_file")
    @classmethod
    def _in_order(cls, value: dict[str, object]) -> dict[str, object]:
        by_chamber = [part for part in value.values() if isinstance(part, dict)] or [value]
        for levels in (steps for part in by_chamber for steps in part.values()):
            times = [time for time, _ in levels]
            if any(later <= earlier for earlier, later in itertools.pairwise(times)):
                raise ValueError("levels in the order of their times")
        return value

    @property
    def factor(self) -> float:
        """Pascals per unit."""
        return FACTORS[self.unit] if self.scale_pa_v is None else self.scale_pa_v

    def levels(self, file: str) -> dict[str, Levels]:
        """Return the stated levels of a file, by its name without the ending, in `unit`."""
        return {**self.stated, **self.stated_by_file.get(file, {})}


class DutyColumns(Strict):
    """Duty cycles of the pumps of chambers."""

    columns: dict[str, Column] = Field(min_length=1, description="column of each chamber")
    full: float = Field(1.0, gt=0, description="reading at full power, 255 of an 8-bit timer")


class OnArm(Strict):
    """A cross-section."""

    link: int = Field(ge=0, description="number of the link")
    s_m: float | None = Field(
        None, ge=0, description="undeformed length from the beginning of the link [m]; default: its end"
    )

    @property
    def place(self) -> Place:
        """The cross-section as others take it."""
        return Place(self.link, self.s_m)


class PoseColumns(Strict):
    """Poses of a body."""

    position: Three
    unit: Length = "m"
    quaternion: Four = Field(description="x, y, z, w")
    ok: Column | None = Field(None, description="column that is 0 where the pose is bad")


class PlateColumns(PoseColumns, OnArm):
    """Poses of a body on the arm."""


class BaseColumns(PoseColumns):
    """Poses of a body on the base; positions and rotations of the others are given in its frame."""

    moves: bool = Field(False, description="false: its median counts, for it is fixed; true: each sample")
    turns: bool = Field(
        True,
        description="false: only its position counts, axes stay those of the tracker; its rotation is wrong",
    )


class MarkerColumns(OnArm):
    """Positions of a point on the arm."""

    position: Three
    unit: Length = "m"
    offset_m: Vector3 | None = Field(
        None, description="place of the point in the frame of the cross-section [m]; default: not known"
    )


class CurvatureColumns(Strict):
    """Mean curvatures of a link."""

    link: int = Field(0, ge=0)
    columns: Annotated[tuple[Column, Column], Field(strict=False)] = Field(("kx", "ky"))
    unit: Literal["1/m", "1/mm"] = "1/m"
    range: Vector2 | None = Field(None, description="readings outside are left out, in `unit`")


class BendColumn(Strict):
    """Bending angle of a link."""

    link: int = Field(0, ge=0)
    column: Column
    unit: Literal["rad", "deg"] = "rad"
    towards: Literal["x", "y"] | None = Field(
        None,
        description="axis of the section towards which an angle above 0 bends; default: the one way in which "
        "the link can bend, y of a link that can bend both ways",
    )
    towards_rad: float | None = Field(None, description="the same by its angle from x in the section [rad]")
    towards_deg: float | None = Field(None, description="the same in degrees")

    @model_validator(mode="after")
    def _has_one_direction(self) -> BendColumn:
        if sum(given is not None for given in (self.towards, self.towards_rad, self.towards_deg)) > 1:
            raise ValueError("one of towards, towards_rad, towards_deg")
        return self

    def direction(self, link: Link) -> float:
        """Return the angle [rad] from x towards which the link bends at an angle above 0."""
        if self.towards_rad is not None:
            return self.towards_rad
        if self.towards_deg is not None:
            return math.radians(self.towards_deg)
        return 0.0 if (self.towards or self.assumed(link)) == "x" else 0.5 * math.pi

    def assumed(self, link: Link) -> str:
        """Return the axis that counts where the map names none."""
        return "x" if "bending_y" not in link.strains else "y"


class Columns(Strict):
    """A column map."""

    description: str = Field("", description="a line on the file")
    time: TimeColumn = Field(TimeColumn(), description="when each row was sampled")
    pressures: PressureColumns = Field(description="measured pressures of the chambers")
    commands: PressureColumns | None = Field(None, description="set points of the chambers")
    duty: DutyColumns | None = Field(None, description="duty cycles of the pumps of the chambers")
    frame: str = Field("tracker", description="what positions refer to")
    base: BaseColumns | None = Field(None, description="pose of the base of the arm")
    plates: dict[str, PlateColumns] = Field({}, description="poses of bodies on the arm, by name")
    markers: dict[str, MarkerColumns] = Field({}, description="positions of points on the arm, by name")
    curvatures: dict[str, CurvatureColumns] = Field({}, description="mean curvatures of links, by name")
    bends: dict[str, BendColumn] = Field({}, description="bending angles of links, by name")

    @model_validator(mode="after")
    def _has_different_names(self) -> Columns:
        groups: tuple[dict[str, object], ...] = (self.plates, self.markers, self.curvatures, self.bends)  # type: ignore[assignment]
        names = [name for group in groups for name in group]
        taken = {"pressure", "command", "duty", "base"}
        for name in names:
            if name in taken:
                raise ValueError(
                    f"names of streams that differ, also from pressure, command, duty, base (here {name!r})"
                )
            taken.add(name)
        return self


def without_shape(columns: Columns) -> Columns:
    """Return a column map of pressures, set points and duty cycles alone."""
    return with_changes(columns, plates={}, markers={}, curvatures={}, bends={}, base=None)


def chambers_of(columns: Columns, robot: Robot | None, where: str) -> tuple[str, ...]:
    """Return the names of the chambers of a recording: those of the robot, or, without one, of the map.

    Parameters
    ----------
    columns : Columns
    robot : Robot or None
        Robot of the recording; None of air alone, which has pressures in columns.
    where : str
        File of the column map.

    Raises
    ------
    ConfigError
        If there is neither a robot nor a column of pressure, or set points are of other chambers.
    """
    if robot is not None:
        return robot.chamber_names
    names = tuple(columns.pressures.columns)
    if not names:
        raise ConfigError(
            where, "pressures.columns", "no column", "a column of each chamber, or a robot file"
        )
    if columns.commands is not None and (odd := set(columns.commands.columns) - set(names)):
        raise ConfigError(where, "commands.columns", min(odd), f"one of {', '.join(names)}")
    return names


def check_columns(columns: Columns, robot: Robot, where: str) -> None:
    """Compare a column map with the robot.

    Parameters
    ----------
    columns : Columns
    robot : Robot
        Robot of the recording.
    where : str
        File of the column map.

    Raises
    ------
    ConfigError
        If a chamber, a link or a place is not the robot's.
    """
    for key, section in (("pressures", columns.pressures), ("commands", columns.commands)):
        if section is None:
            continue
        parts: dict[str, list[str]] = {"columns": list(section.columns), "stated": list(section.stated)}
        parts |= {f"stated_by_file.{file}": list(levels) for file, levels in section.stated_by_file.items()}
        for part, names in parts.items():
            for name in names:
                if name not in robot.chamber_names:
                    allowed = f"one of {', '.join(robot.chamber_names)}"
                    raise ConfigError(where, f"{key}.{part}", name, allowed)
    for name in columns.duty.columns if columns.duty else ():
        if name not in robot.chamber_names:
            raise ConfigError(where, "duty.columns", name, f"one of {', '.join(robot.chamber_names)}")
    for kind, group in (("plates", columns.plates), ("markers", columns.markers)):
        for name, body in group.items():
            _check_link(body.link, robot, where, f"{kind}.{name}")
            length = robot.links[body.link].length
            if body.s_m is not None and body.s_m > length:
                raise ConfigError(
                    where, f"{kind}.{name}.s_m", body.s_m, f"0 to {length:g}, the link's length"
                )
    for name, curvature in columns.curvatures.items():
        _check_link(curvature.link, robot, where, f"curvatures.{name}")
        _check_bends(curvature.link, robot, where, f"curvatures.{name}")
    for name, bend in columns.bends.items():
        _check_link(bend.link, robot, where, f"bends.{name}")
        _check_bends(bend.link, robot, where, f"bends.{name}")
        link = robot.links[bend.link]
        towards = bend.direction(link)
        if ("bending_x" not in link.strains or abs(math.cos(towards)) < _SQUARE) and (
            "bending_y" not in link.strains or abs(math.sin(towards)) < _SQUARE
        ):
            key = next((k for k in ("towards_rad", "towards_deg") if getattr(bend, k) is not None), "towards")
            allowed = f"towards {bend.assumed(link)}: link {bend.link} bends in no other way"
            raise ConfigError(where, f"bends.{name}.{key}", getattr(bend, key), allowed)


def assumed_directions(columns: Columns, robot: Robot) -> tuple[str, ...]:
    """Return a line for each bending angle whose direction the map does not name, of a link that has two."""
    return tuple(
        f"{name} is taken to bend towards y: the map has no bends.{name}.towards"
        for name, bend in columns.bends.items()
        if not {"towards", "towards_rad", "towards_deg"} & bend.model_fields_set
        and {"bending_x", "bending_y"} <= set(robot.links[bend.link].strains)
    )


def _check_link(link: int, robot: Robot, where: str, key: str) -> None:
    if link >= len(robot.links):
        raise ConfigError(where, f"{key}.link", link, f"0 to {len(robot.links) - 1}")


def _check_bends(link: int, robot: Robot, where: str, key: str) -> None:
    if not {"bending_x", "bending_y"} & set(robot.links[link].strains):
        raise ConfigError(where, f"{key}.link", link, "a link that bends: this one has no bending strain")
