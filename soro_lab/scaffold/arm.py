"""A new arm: what is given, and estimates for the rest, each with its origin."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from soro_core.errors import ConfigError
from soro_core.robot.link import DENSEST, LIGHTEST
from soro_lab.scaffold import estimate
from soro_lab.scaffold.options import (
    MOUNTINGS,
    WHERE,
    GivenLink,
    ScaffoldOptions,
    read_links,
    read_name,
    read_range,
)
from soro_lab.scaffold.quantity import GUESS, Noted, given, rounded

# Where nothing is said [m], [Pa].
LENGTH, RANGE = 0.1, (0.0, 90e3)
# Of a silicone [kg/m^3], and of a whole link at least and at most.
DENSITY = 1070.0
# A link that is denser than its material by so much has no radius that follows from its mass: the estimate
# stops at half of the length.
_HEAVY = 1.1


@dataclass(frozen=True)
class Geometry:
    """Geometry and mass of a link; every number with its origin."""

    length: Noted
    """Undeformed length [m]."""
    radius: Noted
    """Radius of the section [m]."""
    mass: Noted
    """Mass [kg]."""
    angles: tuple[Noted, ...]
    """Where the chambers lie around the axis [rad]."""
    area: Noted
    """Area that the pressure of a chamber acts on [m^2]."""
    offset: Noted
    """Distance of a chamber from the axis [m]."""
    section: estimate.Section
    """Section without its chambers."""


@dataclass(frozen=True)
class NewLink:
    """One link."""

    geometry: Geometry
    """Geometry and mass."""
    k_e: Noted
    """Stiffness against stretching [N/m]."""
    k_b: Noted
    """Stiffness against bending [N m/rad]."""


@dataclass(frozen=True)
class ArmSetting:
    """What the files beside a robot file say of an arm.

    Attributes
    ----------
    name : str
        Name of the arm, with which the names of platform and scene begin.
    chambers : tuple of int
        Number of chambers of each link.
    pressure_range : Noted
        Lowest and highest [Pa gauge].
    platform : str
        `emulated`, a shipped platform, or a family.
    command : str
        That writes the files.
    mode : str
        Of the scene.
    """

    name: str
    chambers: tuple[int, ...]
    pressure_range: Noted
    platform: str = "emulated"
    command: str = WHERE
    mode: str = "real_time"


@dataclass(frozen=True)
class NewArm:
    """An arm that gets its files.

    Attributes
    ----------
    name : str
        Name of the arm.
    links : tuple of NewLink
        From the base on.
    planar : bool
        Whether it bends in one plane only.
    mounting : str
        One of `MOUNTINGS`.
    pressure_range : Noted
        Lowest and highest [Pa gauge].
    platform : str
        As given.
    """

    name: str
    links: tuple[NewLink, ...]
    planar: bool
    mounting: str
    pressure_range: Noted
    platform: str

    @property
    def setting(self) -> ArmSetting:
        """What platform and scene say of it."""
        chambers = tuple(len(link.geometry.angles) for link in self.links)
        return ArmSetting(self.name, chambers, self.pressure_range, self.platform)


def new_arm(options: ScaffoldOptions) -> NewArm:
    """Read options, and estimate what they leave open.

    Raises
    ------
    ConfigError
        With the option, what was found and what is allowed.
    """
    name, links = read_name(options.name), read_links(options)
    if options.mounting not in MOUNTINGS:
        raise ConfigError(WHERE, "--mounting", options.mounting, f"one of {', '.join(MOUNTINGS)}")
    shapes = [_shape(link, options.planar) for link in links]
    low_high = read_range(options.pressure_range)
    pressure_range = Noted(
        RANGE, "Pa gauge, not given: that of the three-bellow arm; look up what yours bears"
    )
    if low_high is not None:
        pressure_range = given(low_high, "Pa gauge")
    modulus = _modulus(shapes, pressure_range.value, options.mounting)
    return NewArm(
        name=name,
        links=tuple(_link(link, shape, modulus) for link, shape in zip(links, shapes, strict=True)),
        planar=options.planar,
        mounting=options.mounting,
        pressure_range=pressure_range,
        platform=options.platform,
    )


def _shape(link: GivenLink, planar: bool) -> Geometry:
    n = link.count
    length = given(link.length, "m") if link.length else Noted(LENGTH, "m, not given: measure it")
    if link.radius is not None:
        radius = given(link.radius, "m")
    else:
        from_what = "a fifth of the length" if link.mass is None else f"mass, length and {DENSITY:g} kg/m^3"
        found = estimate.radius_of(length.value, link.mass, DENSITY, n)
        radius = Noted(rounded(found), f"m, estimated from {from_what}: measure it")
    area, offset = estimate.chamber_of(radius.value, max(n, 1))
    about = f"estimated from the radius: {n} round chambers with walls"
    text = "rad, about the tangent from the local x axis, not given: evenly spread"
    angles = tuple(Noted(2.0 * math.pi * k / n, text) for k in range(n))
    areas = Noted(rounded(area), f"m^2, {about}; {GUESS}")
    offsets = Noted(rounded(offset), f"m, of its centre, {about}")
    section = estimate.section_of(
        radius.value, areas.value, offsets.value, [angle.value for angle in angles], planar
    )
    if link.mass is not None:
        mass = given(link.mass, "kg")
    else:
        found = DENSITY * section.area_m2 * length.value
        origin = f"section, length and density ({DENSITY:g} kg/m^3, that of a silicone)"
        mass = Noted(rounded(found), f"kg, estimated from {origin}: weigh it")
    density = mass.value / (math.pi * radius.value**2 * length.value)
    if not LIGHTEST <= density <= DENSEST:
        allowed = f"a mass that fits length and radius: here {density:.3g} kg/m^3, beyond "
        raise ConfigError(WHERE, "--mass", mass.value, f"{allowed}{LIGHTEST:g} to {DENSEST:g}")
    if link.mass is not None and link.radius is None and density > _HEAVY * DENSITY:
        allowed = f"a mass of such a length of {DENSITY:g} kg/m^3, or --radius"
        raise ConfigError(WHERE, "--mass", mass.value, allowed)
    return Geometry(length, radius, mass, angles, areas, offsets, section)


def _modulus(shapes: Sequence[Geometry], pressure_range: tuple[float, float], mounting: str) -> Noted:
    pressure = max(map(abs, pressure_range))
    moving = max(
        estimate.modulus_of(s.section, s.length.value, s.area.value, s.offset.value, len(s.angles), pressure)
        for s in shapes
    )
    sections = [s.section for s in shapes]
    lengths, masses = ([getattr(s, key).value for s in shapes] for key in ("length", "mass"))
    if mounting == "hanging":
        holding = estimate.modulus_for_hanging(sections, masses)
        held = f"its weight stretches a link by {estimate.STRETCH:.0%} at most"
    else:
        holding = estimate.modulus_for_weight(sections, lengths, masses)
        held = "the arm carries its weight in every direction"
    how = f"{1e-3 * pressure:.4g} kPa in all chambers stretch a link by {estimate.STRETCH:.0%}, in one "
    how += f"bend it by {estimate.BEND:g} rad, at most"
    if holding > moving:
        how = held
    return Noted(max(moving, holding), f"{1e-3 * max(moving, holding):.4g} kPa, with which {how}")


def _link(link: GivenLink, shape: Geometry, modulus: Noted) -> NewLink:
    section, length = shape.section, shape.length.value
    axial = rounded(modulus.value * section.area_m2 / length)
    bending = rounded(modulus.value * section.second_moment_m4 / length)
    k_e = Noted(
        axial, f"N/m, estimated as E A / L of the section without its chambers, E = {modulus.note}; {GUESS}"
    )
    k_b = Noted(bending, f"N m/rad, estimated as E I / L of the same section and E; {GUESS}")
    return NewLink(
        shape,
        k_e if link.axial is None else given(link.axial, "N/m"),
        k_b if link.bending is None else given(link.bending, "N m/rad"),
    )
