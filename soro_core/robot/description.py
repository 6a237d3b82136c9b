"""What a robot is: links on a base, and what follows from them; frozen and checked. SI units."""

from __future__ import annotations

import re
from collections.abc import Mapping
from numbers import Integral, Real
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from soro_core.arrays import Array
from soro_core.config import Floats, Strict, parse
from soro_core.errors import ConfigError
from soro_core.robot.chamber import Tendon
from soro_core.robot.link import Link
from soro_core.robot.parts import check_split, fields, plain, put, scaled_link, split_link
from soro_core.robot.surroundings import Contacts, PointMass, TipConstraint
from soro_core.robot.vectors import Quaternion, Vector2, Vector3

_NO_TURN = (0.0, 0.0, 0.0, 1.0)


class SensorBody(Strict):
    """A body on a cross-section of the arm: one that the tracker sees, or a place that has a name."""

    at: float = Field(ge=0, le=1, description="the cross-section, in parts of the length of the arm")
    offset_m: Vector3 = Field((0.0, 0.0, 0.0), description="its origin in the frame of the cross-section [m]")
    quaternion: Quaternion = Field(
        _NO_TURN, description="x, y, z, w of its axes in the frame of the cross-section"
    )


class Calibration(Strict):
    """Frames of the measurement: of curvatures for comparisons alone, of poses for the estimator too."""

    frame_rotation_rad: float = Field(
        0.0, description="turns the model's curvature vector into the measured frame"
    )
    curvature_offset: Vector2 = Field(
        (0.0, 0.0), description="measured curvature [1/m] of the robot where q is 0"
    )
    tracker_position: Vector3 = Field(
        (0.0, 0.0, 0.0), description="origin of the robot's world in the frame of the tracker [m]"
    )
    tracker_quaternion: Quaternion = Field(
        _NO_TURN, description="x, y, z, w of the axes of the robot's world in the frame of the tracker"
    )
    bodies: Annotated[tuple[SensorBody, ...], Field(strict=False)] = Field(
        (), description="where the tracked bodies are mounted"
    )
    gain_std: float = Field(
        0.0,
        ge=0,
        le=1,
        description="deviation of the common scale of gains and stiffness, as a part of it; 0: not known",
    )


_PLACE = re.compile(r"[A-Za-z]\w*", re.ASCII)
# Frames that every arm may have.
_TAKEN = re.compile(r"world|base|tip|(pose|imu)\d+")
# Round-off of a caller who adds up lengths [m].
END_TOLERANCE = 1e-9


class Robot(Strict):
    """A chain of links on a base, with a point mass at its tip."""

    links: Annotated[
        tuple[Link, ...], Field(strict=False, min_length=1, description="from the base to the tip")
    ]
    name: str = Field("robot", min_length=1, description="default: the name of the file")
    description: str = Field("", description="a line on the robot")
    gravity: Vector3 = Field((0.0, 0.0, -9.81), description="in the world frame [m/s^2]")
    base_quaternion: Quaternion = Field(
        (0.0, 0.0, 0.0, 1.0), description="x, y, z, w of the base frame in the world"
    )
    base_position: Vector3 = Field((0.0, 0.0, 0.0), description="of the base frame in the world [m]")
    tip_mass: float = Field(0.0, ge=0, description="point mass at the tip [kg]")
    point_masses: Annotated[tuple[PointMass, ...], Field(strict=False)] = Field(
        (), description="masses along the arm"
    )
    wrench_places: Floats = Field(
        (), description="where wrenches can act, metres from the base; default: one wrench, at the tip"
    )
    contacts: Contacts | None = Field(None, description="obstacles that push the arm away; default: none")
    tip_constraint: TipConstraint | None = Field(None, description="what holds the tip; default: nothing")
    bend_angle: Literal["deformed", "geometric"] = Field(
        "deformed", description="angle that the law k_b acts on"
    )
    pressure_range_pa: Vector2 = Field(
        (0.0, 90e3), description="lowest and highest gauge pressure of the chambers", validate_default=True
    )
    calibration: Calibration = Field(Calibration(), description="frames of the measurement")
    places: dict[str, SensorBody] = Field(
        default_factory=dict,
        description="places of a camera or a tool by name: frames on /tf and in robot_description",
    )
    refinement: int = Field(
        1,
        ge=1,
        description="every so many links are one link of the original; its chambers run along all of them",
    )
    tendons: Annotated[tuple[Tendon, ...], Field(strict=False)] = Field(
        (), description="tendons along the arm; their inputs follow those of the chambers"
    )

    @field_validator("pressure_range_pa")
    @classmethod
    def _range(cls, value: tuple[float, ...], info: ValidationInfo) -> tuple[float, ...]:
        if not -101325.0 <= value[0] < value[1]:
            raise ValueError("[lowest, highest] with -101325 <= lowest < highest")
        chambers = [c for link in info.data.get("links", ()) for c in link.chambers]
        if value[0] < 0.0 and any(c.muscle for c in chambers):
            raise ValueError("pressures from 0 on: a muscle that is sucked empty pulls at nothing")
        burst = min((c.burst_pa for c in chambers), default=float("inf"))
        if max(abs(value[0]), value[1]) >= burst:
            raise ValueError(f"pressures below {burst:.6g} Pa, where dead_band_pa and swell_per_pa end")
        return value

    @field_validator("point_masses", "wrench_places")
    @classmethod
    def _along(cls, value: tuple[Any, ...], info: ValidationInfo) -> tuple[Any, ...]:
        length = sum(link.length for link in info.data.get("links", ()))
        for entry in value:
            place = entry.place if isinstance(entry, PointMass) else entry
            if length and not 0.0 <= place <= length + END_TOLERANCE:
                raise ValueError(f"places from 0 to the length of the arm, {length:.6g} m (here {place!r})")
        return value

    @field_validator("places")
    @classmethod
    def _named(cls, value: dict[str, SensorBody]) -> dict[str, SensorBody]:
        for name in value:
            if not _PLACE.fullmatch(name) or _TAKEN.fullmatch(name):
                raise ValueError(
                    f"names of letters, digits and _, none of world, base, tip, pose0, imu0 (here {name!r})"
                )
        return value

    @field_validator("refinement")
    @classmethod
    def _groups(cls, value: int, info: ValidationInfo) -> int:
        links = info.data.get("links", ())
        if len(links) % value:
            raise ValueError(f"a divisor of the number of links ({len(links)})")
        if any(link.chambers for index, link in enumerate(links) if index % value):
            raise ValueError("1 where a link inside a group has chambers of its own")
        return value

    @field_validator("tendons")
    @classmethod
    def _routed(cls, value: tuple[Tendon, ...], info: ValidationInfo) -> tuple[Tendon, ...]:
        n = len(info.data.get("links", ())) // info.data.get("refinement", 1)
        for tendon in value:
            if n and tendon.links and tendon.links[1] >= n:
                raise ValueError(f"links from 0 to {n - 1} (here {list(tendon.links)})")
        return value

    @property
    def n_q(self) -> int:
        """Number of coordinates."""
        return sum(link.n_q for link in self.links)

    @property
    def n_u(self) -> int:
        """Number of inputs: chambers, and behind them tendons."""
        return sum(len(link.chambers) for link in self.links) + len(self.tendons)

    @property
    def varies(self) -> bool:
        """Whether a strain can vary along one of the links."""
        return any(link.varies for link in self.links)

    @property
    def length(self) -> float:
        """Undeformed length of the whole arm [m]."""
        return sum(link.length for link in self.links)

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """``link0/elongation``, ``link0/bending_x``, ...; of varying strain ``link0/bending_x_0``, ..."""
        return tuple(f"link{i}/{name}" for i, link in enumerate(self.links) for name in link.coordinates)

    @property
    def chamber_names(self) -> tuple[str, ...]:
        """``link0/chamber0``, ...; a refined robot keeps the names of the original."""
        return tuple(
            f"link{i // self.refinement}/chamber{j}"
            for i, link in enumerate(self.links)
            for j in range(len(link.chambers))
        )

    @property
    def tendon_names(self) -> tuple[str, ...]:
        """``tendon0``, ``tendon1``, ..."""
        return tuple(f"tendon{k}" for k in range(len(self.tendons)))

    @property
    def input_range(self) -> tuple[Array, Array]:
        """Lowest and highest value of each input (n_u,): pressures [Pa gauge], then tensions [N]."""
        ends = [self.pressure_range_pa] * len(self.chamber_names)
        low, high = np.array([*ends, *((0.0, one.max_tension_n) for one in self.tendons)]).reshape(-1, 2).T
        return low, high

    def replace(self, **changes: Any) -> Robot:
        """Return a changed copy, checked again: ``robot.replace(tip_mass=0.02)``.

        Raises
        ------
        ConfigError
            If a key is unknown or a value is not allowed.
        """
        return parse({**fields(self), **{k: plain(v) for k, v in changes.items()}}, Robot, where=self.name)

    def with_(self, changes: Mapping[str, Any]) -> Robot:
        """Return a copy with other values by path, checked again: ``robot.with_({"links[0].k_b[0]": 0.03})``.

        Raises
        ------
        ConfigError
            If a path leads nowhere, or a value is not allowed.
        """
        if not isinstance(changes, Mapping) or not all(isinstance(path, str) for path in changes):
            raise ConfigError(self.name, "", changes, "a mapping of paths to values, as links[0].k_b[0]")
        keys = fields(self)
        for path, value in changes.items():
            put(keys, self, path, plain(value))
        return parse(keys, Robot, where=self.name)

    def __repr__(self) -> str:
        links = "1 link" if len(self.links) == 1 else f"{len(self.links)} links"
        driven = f"{len(self.chamber_names)} chambers" + f", {len(self.tendons)} tendons" * bool(self.tendons)
        return f"Robot({self.name}: {links}, {self.length:.4g} m, {self.n_q} coordinates, {driven})"

    __str__ = __repr__

    def refine(self, k: int) -> Robot:
        """Split each link into `k` equal links of the same physics; the chambers run along all of them.

        A uniform strain costs the same energy and dissipates the same power before and after: the laws act on
        x = eps L and beta = kappa L (1 + eps), which a part of length L / k sees k times smaller, so
        k_part(x) = k k_e(k x), and damping, creep and hysteresis share out in k equal parts.

        Each part gets the polynomials of the original, on its own length. What is given along the whole
        link cannot be split: modes, and losses given for each coordinate of a varying strain.

        Raises
        ------
        ConfigError
            If `k` is not a whole number of 1 or more, or a link cannot be split.
        """
        if not isinstance(k, Integral) or isinstance(k, bool) or k < 1:
            raise ConfigError(self.name, "refine", k, "a whole number of 1 or more")
        k = int(k)
        if k == 1:
            return self
        for i, link in enumerate(self.links):
            check_split(link, f"{self.name}: refine({k})", f"links[{i}]")
        links = [part for link in self.links for part in split_link(link, k)]
        return self.replace(links=links, refinement=self.refinement * k)

    def scaled(self, stiffness: float = 1.0, damping: float = 1.0, gain: float = 1.0) -> Robot:
        """Return a robot with other stiffness, losses and chamber gains, as a real one has them.

        Parameters
        ----------
        stiffness : float
            Factor on the stiffness of all links.
        damping : float
            Factor on all losses: viscous damping, creep, hysteresis.
        gain : float
            Factor on the force of all chambers.

        Raises
        ------
        ConfigError
            If a factor is not a number, or makes a value that is not allowed.
        """
        for key, factor in (("stiffness", stiffness), ("damping", damping), ("gain", gain)):
            if not isinstance(factor, Real) or isinstance(factor, bool):
                raise ConfigError(self.name, f"scaled: {key}", factor, "a number")
        return self.replace(links=[scaled_link(link, stiffness, damping, gain) for link in self.links])


def refuse_tendons(robot: Robot, where: str) -> None:
    """Refuse a robot with tendons where pressures alone drive it.

    Raises
    ------
    ConfigError
        One line.
    """
    if robot.tendons:
        found = f"{robot.name}, which has tendons"
        allowed = "a robot without: only SoftArm, equilibrium, simulate and fit take tendons"
        raise ConfigError(where, "robot", found, allowed)
