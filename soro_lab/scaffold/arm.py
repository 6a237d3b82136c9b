"""A new arm: what is given, and estimates for the rest, each with its origin."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from soro_core.errors import ConfigError
from soro_lab.scaffold import estimate, quantity
from soro_lab.scaffold.material import DENSITY, find_material
from soro_lab.scaffold.noted import GUESS, Noted, given, rounded
from soro_lab.scaffold.options import (
    MOUNTINGS,
    WHERE,
    GivenLink,
    Options,
    read_links,
    read_name,
    read_one,
    read_range,
    read_sensors,
)

# Where nothing is said [m], [Pa].
LENGTH, RANGE = 0.1, (0.0, 90e3)
# A link that is denser than its material by so much has no radius that follows from its mass: the estimate
# stops at half of the length.
_HEAVY = 1.1


@dataclass(frozen=True)
class Geometry:
    """Geometry and mass of a link; every number with its origin, in SI units."""

    length: Noted
    radius: Noted
    mass: Noted
    angles: tuple[Noted, ...]
    area: Noted
    offset: Noted
    section: estimate.Section


@dataclass(frozen=True)
class NewLink:
    """One link, with its stiffness against stretching [N/m] and bending [N m/rad]."""

    geometry: Geometry
    k_e: Noted
    k_b: Noted


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
    payload : Noted
        Load at the tip [kg].
    platform : str
        As given.
    poses, imus : tuple of float
        Places of the sensors, parts of the length.
    """

    name: str
    links: tuple[NewLink, ...]
    planar: bool
    mounting: str
    pressure_range: Noted
    payload: Noted
    platform: str
    poses: tuple[float, ...]
    imus: tuple[float, ...]


def new_arm(options: Options) -> NewArm:
    """Read options, and estimate what they leave open.

    Raises
    ------
    ConfigError
        With the option, what was found and what is allowed.
    """
    name, links = read_name(options.name), read_links(options)
    if options.mounting not in MOUNTINGS:
        raise ConfigError(WHERE, "--mounting", options.mounting, f"one of {', '.join(MOUNTINGS)}")
    if options.material and options.youngs_modulus:
        raise ConfigError(WHERE, "--youngs-modulus", options.youngs_modulus, "either it, or --material")
    density = _density(options)
    shapes = [_shape(link, density, options.planar) for link in links]
    low_high = read_range(options.pressure_range)
    pressure_range = Noted(
        RANGE, "Pa gauge, not given: that of the three-bellow arm; look up what yours bears"
    )
    if low_high is not None:
        pressure_range = given(low_high, "Pa gauge")
    load = read_one(quantity.LOAD, options.payload, "--payload")
    payload = Noted(0.0, "kg, none given") if load is None else given(load, "kg")
    modulus = _modulus(options, shapes, pressure_range.value, payload.value)
    poses, imus = read_sensors(options.sensors, options.sensor_places, len(links))
    return NewArm(
        name=name,
        links=tuple(_link(link, shape, modulus) for link, shape in zip(links, shapes, strict=True)),
        planar=options.planar,
        mounting=options.mounting,
        pressure_range=pressure_range,
        payload=payload,
        platform=options.platform,
        poses=poses,
        imus=imus,
    )


def _density(options: Options) -> Noted:
    stated = read_one(quantity.DENSITY, options.density, "--density")
    if stated is not None:
        return given(stated, "kg/m^3")
    if options.material:
        material = find_material(options.material)
        return Noted(material.density_kg_m3, f"kg/m^3, {options.material}")
    return Noted(DENSITY, "kg/m^3, that of a silicone")


def _shape(link: GivenLink, density: Noted, planar: bool) -> Geometry:
    n = link.count
    length = given(link.length, "m") if link.length else Noted(LENGTH, "m, not given: measure it")
    if link.radius is not None:
        radius = given(link.radius, "m")
    else:
        from_what = (
            "a fifth of the length" if link.mass is None else f"mass, length and {density.value:g} kg/m^3"
        )
        found = estimate.radius_of(length.value, link.mass, density.value, n)
        radius = Noted(rounded(found), f"m, estimated from {from_what}: measure it")
    area, offset = estimate.chamber_of(radius.value, max(n, 1))
    about = f"estimated from the radius: {n} round chambers with walls"
    areas = given(link.area, "m^2") if link.area else Noted(rounded(area), f"m^2, {about}; {GUESS}")
    offsets = given(link.offset, "m") if link.offset is not None else Noted(rounded(offset), f"m, {about}")
    if abs(offsets.value) >= radius.value:
        allowed = f"a chamber within the link, whose radius is {1e3 * radius.value:.4g}mm"
        raise ConfigError(WHERE, "--offset", offsets.value, allowed)
    if n * areas.value > math.pi * radius.value**2:
        most = math.pi * radius.value**2 / n * 1e6
        allowed = f"{n} chambers that fit into the section: at most {most:.4g}mm2 each with a radius of "
        raise ConfigError(WHERE, "--area", areas.value, f"{allowed}{1e3 * radius.value:.4g}mm")
    angles = _angles(link, planar)
    section = estimate.section_of(
        radius.value, areas.value, offsets.value, [angle.value for angle in angles], planar
    )
    if link.mass is not None:
        mass = given(link.mass, "kg")
    else:
        found = density.value * section.area_m2 * length.value
        mass = Noted(
            rounded(found), f"kg, estimated from section, length and density ({density.note}): weigh it"
        )
    whole = mass.value / (math.pi * radius.value**2 * length.value)
    if not quantity.DENSITY.lowest <= whole <= quantity.DENSITY.highest:
        allowed = (
            f"a mass that fits length and radius: here {whole:.3g} kg/m^3, beyond "
            f"{quantity.DENSITY.lowest:g} to {quantity.DENSITY.highest:g}"
        )
        raise ConfigError(WHERE, "--mass", mass.value, allowed)
    if link.mass is not None and link.radius is None and whole > _HEAVY * density.value:
        allowed = f"a mass of such a length of {density.value:g} kg/m^3, or --radius, or --density"
        raise ConfigError(WHERE, "--mass", mass.value, allowed)
    return Geometry(length, radius, mass, angles, areas, offsets, section)


def _angles(link: GivenLink, planar: bool) -> tuple[Noted, ...]:
    text = "rad, about the tangent from the local x axis"
    if link.angles is not None:
        if planar and not any(abs(math.cos(angle)) > 1e-3 for angle in link.angles):
            allowed = "with --planar a chamber towards angle 0 or 180, the plane of bending"
            raise ConfigError(WHERE, "--angles", [round(math.degrees(x), 3) for x in link.angles], allowed)
        if _repeat(link.angles):
            allowed = "a direction for each chamber of a link, and no two alike"
            raise ConfigError(WHERE, "--angles", [round(math.degrees(x), 3) for x in link.angles], allowed)
        return tuple(given(angle, text) for angle in link.angles)
    if planar and link.count > 2:
        raise ConfigError(WHERE, "--chambers", link.count, "with --planar at most 2 a link, or --angles")
    note = f"{text}, not given: evenly spread"
    return tuple(Noted(2.0 * math.pi * k / link.count, note) for k in range(link.count))


def _repeat(angles: Sequence[float]) -> bool:
    """Whether two angles are the same direction."""
    return len({(round(math.cos(a), 6), round(math.sin(a), 6)) for a in angles}) < len(angles)


def _modulus(
    options: Options, shapes: Sequence[Geometry], pressure_range: tuple[float, float], load: float
) -> Noted:
    stated = read_one(quantity.MODULUS, options.youngs_modulus, "--youngs-modulus")
    if stated is not None:
        return Noted(stated, f"the given modulus of {1e-3 * stated:.4g} kPa")
    if options.material:
        named = find_material(options.material)
        text = f"{1e-3 * named.youngs_modulus_pa:.4g} kPa of {options.material} ({named.source})"
        return Noted(named.youngs_modulus_pa, text)
    pressure = max(map(abs, pressure_range))
    moving = max(
        estimate.modulus_of(s.section, s.length.value, s.area.value, s.offset.value, len(s.angles), pressure)
        for s in shapes
    )
    lengths, masses = ([getattr(s, key).value for s in shapes] for key in ("length", "mass"))
    holding = estimate.modulus_for_weight([s.section for s in shapes], lengths, masses, load)
    how = f"{1e-3 * pressure:.4g} kPa in all chambers stretch a link by {estimate.STRETCH:.0%}, in one "
    how += f"bend it by {estimate.BEND:g} rad, at most"
    if holding > moving:
        how = "the arm carries its weight and the payload in every direction"
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
