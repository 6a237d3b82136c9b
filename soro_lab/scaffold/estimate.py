"""Estimates of section, chambers and stiffness where they are not given; pure functions, SI units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

GRAVITY = 9.81
# Radius of a chamber over that of the largest equal circles that fit into the section: the rest is wall.
CIRCLE_PART = 0.8
# Part of a section that is material at least, however large the chambers are said to be.
LEAST_SOLID = 0.2
# Stretch with the highest pressure in every chamber, and bend of a link with it in one [rad], of an arm whose
# material is unknown: its builder has chosen the pressures so that it moves.
STRETCH, BEND = 0.2, 1.0
# Moment of the weight over the bending stiffness by length, at most, of an arm whose material is unknown. A
# beam that stands buckles under its own weight at 3.9.
SAG = 0.6


@dataclass(frozen=True)
class Section:
    """Round section of a link without its chambers.

    Attributes
    ----------
    area_m2 : float
        Of the material [m^2].
    second_moment_m4 : float
        Mean of those about the axes of the carried bendings [m^4].
    """

    area_m2: float
    second_moment_m4: float


def radius_of(length: float, mass: float | None, density: float, n: int) -> float:
    """Return the radius [m] of a link of which mass and length are known, or length alone.

    Parameters
    ----------
    length : float
        [m].
    mass : float or None
        [kg].
    density : float
        Of the material [kg/m^3].
    n : int
        Number of chambers.
    """
    if mass is None:
        return 0.2 * length
    solid = 1.0 - n * CIRCLE_PART**2 * _circle(n)[0] ** 2
    radius = math.sqrt(mass / (density * solid * math.pi * length))
    return min(max(radius, 0.05 * length), 0.5 * length)


def chamber_of(radius: float, n: int) -> tuple[float, float]:
    """Return area [m^2] and offset [m] of each of `n` equal round chambers in a section of a radius [m]."""
    own, offset = _circle(n)
    return math.pi * (CIRCLE_PART * own * radius) ** 2, offset * radius


def _circle(n: int) -> tuple[float, float]:
    """Return radius and offset of the largest `n` equal circles around the centre of a circle of radius 1."""
    half = math.sin(math.pi / max(n, 2))
    own = half / (1.0 + half)
    return own, 1.0 - own


def section_of(radius: float, area: float, offset: float, angles: Sequence[float], planar: bool) -> Section:
    """Return the section of a link.

    Parameters
    ----------
    radius : float
        Of the link [m].
    area, offset : float
        Of each chamber [m^2], [m].
    angles : sequence of float
        Of the chambers [rad].
    planar : bool
        Whether the link bends in the plane of angle 0 only.
    """
    full, second = math.pi * radius**2, math.pi * radius**4 / 4
    across = sum(math.cos(angle) ** 2 for angle in angles)
    share = across if planar else 0.5 * len(angles)
    hollow = len(angles) * area**2 / (4 * math.pi) + share * area * offset**2
    return Section(
        max(full - len(angles) * area, LEAST_SOLID * full), max(second - hollow, LEAST_SOLID * second)
    )


def modulus_of(section: Section, length: float, area: float, offset: float, n: int, pressure: float) -> float:
    """Return the modulus [Pa] with which a link moves in its range of pressures as arms do.

    Parameters
    ----------
    section : Section
    length : float
        Of the link [m].
    area, offset : float
        Of each chamber [m^2], [m].
    n : int
        Number of chambers.
    pressure : float
        Largest absolute pressure [Pa].
    """
    stretching = n * area * pressure / (STRETCH * section.area_m2)
    bending = area * offset * pressure * length / (BEND * section.second_moment_m4)
    return max(stretching, bending)


def modulus_for_weight(
    sections: Sequence[Section], lengths: Sequence[float], masses: Sequence[float]
) -> float:
    """Return the modulus [Pa] with which an arm carries its weight in whatever direction.

    Parameters
    ----------
    sections : sequence of Section
        Of the links.
    lengths, masses : sequence of float
        Of the links [m], [kg].
    """
    needed = 0.0
    for k, section in enumerate(sections):
        rest, moment = 0.0, 0.0
        for length, mass in zip(lengths[k:], masses[k:], strict=True):
            moment += GRAVITY * mass * (rest + 0.5 * length)
            rest += length
        needed = max(needed, moment * rest / (SAG * section.second_moment_m4))
    return needed


def modulus_for_hanging(sections: Sequence[Section], masses: Sequence[float]) -> float:
    """Return the modulus [Pa] at which its masses [kg] stretch a hanging arm by `STRETCH` at most.

    Weight straightens such an arm: it has to carry it in no other direction.
    """
    return max(GRAVITY * sum(masses[k:]) / (STRETCH * section.area_m2) for k, section in enumerate(sections))
