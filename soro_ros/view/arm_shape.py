"""The surface of an arm, made of bodies with rings: core, bellows, plates and payload; what a camera sees."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import cos, isnan, pi, radians, sin

import numpy as np

from soro_core.arrays import Array
from soro_core.robot import Plane, Robot
from soro_core.robot.basis import radius_profile, taper_at

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Colours of the chambers, in their order; colour-blind people can distinguish them (Okabe and Ito)."""

_AROUND = 18
_PLATE = 0.16  # thickness of the plates at the ends of a link, as a part of its radius
_PER_FOLD = 5
_LIGHT = np.array([0.35, -0.55, 0.76])
_STEEL = 7850.0
_UNKNOWN = np.full(3, 0.35)  # a chamber without a reading


@dataclass(frozen=True)
class Bellow:
    """One bellow: its name, where it begins and ends along the arm, and its axis in the section [m]."""

    name: str
    begin: float
    end: float
    offset: tuple[float, float]
    radius: float


@dataclass(frozen=True)
class Body:
    """Rings about a line beside the backbone, one after the other along it.

    Attributes
    ----------
    name : str
        Name of the chamber; of another part ``core``, ``plate0``, ..., ``payload``.
    s : Array
        Arc lengths (m,) [m] of the cross-sections in which the rings lie.
    ahead, radius : Array
        Distances (m,) [m] along the axis of the section, and radii.
    offset : tuple of float
        The line in the section [m].
    colour : Array
        Its colour (3,) from 0 to 1; of a chamber when it is full.
    taper : Array
        Factor (m,) on radius and offset.
    """

    name: str
    s: Array
    ahead: Array
    radius: Array
    offset: tuple[float, float]
    colour: Array
    taper: Array = field(default_factory=lambda: np.ones(1))

    def rings(self, poses: Array, around: int) -> Array:
        """Points (m, around, 3) [m] of the rings, of the poses (m, 4, 4) of their sections."""
        angle = np.linspace(0.0, 2 * pi, around, endpoint=False)
        x = self.taper[:, None] * (self.offset[0] + self.radius[:, None] * np.cos(angle))
        y = self.taper[:, None] * (self.offset[1] + self.radius[:, None] * np.sin(angle))
        local = np.stack([x, y, np.repeat(self.ahead[:, None], around, axis=1)], axis=-1)
        return np.asarray(local @ poses[:, :3, :3].transpose(0, 2, 1) + poses[:, None, :3, 3])


@dataclass(frozen=True)
class Faces:
    """Quadrilaterals (n, 4, 3) [m] in the world and their colours (n, 3) from 0 to 1."""

    corners: Array
    colours: Array


@dataclass(frozen=True)
class Camera:
    """A view without perspective, from an azimuth and an elevation [deg]."""

    azimuth_deg: float = -60.0
    elevation_deg: float = 24.0

    def project(self, points: Array) -> Array:
        """Right, up and towards the viewer, (..., 3) [m], of points (..., 3) [m] in the world."""
        a, e = radians(self.azimuth_deg), radians(self.elevation_deg)
        towards = np.array([cos(e) * cos(a), cos(e) * sin(a), sin(e)])
        right = np.array([-sin(a), cos(a), 0.0])
        return np.asarray(points @ np.stack([right, np.cross(towards, right), towards]).T)


def chambers(robot: Robot) -> list[Bellow]:
    """Return the places of a robot's chambers, with the largest radii that fit into the section."""
    found, begin = [], 0.0
    for i, link in enumerate(robot.links):
        n = len(link.chambers)
        for k, chamber in enumerate(link.chambers):
            away = chamber.offset_m
            if away is None:
                on_elongation, on_curvature = chamber.gains(1.0, 1.0)
                away = on_curvature / on_elongation if on_elongation else 0.6 * link.radius
            # Gains that were fitted may give an offset outside the section, or none.
            away = 0.0 if n == 1 else min(max(away, 0.3 * link.radius), 0.7 * link.radius)
            radius = 0.95 * min(link.radius - away, away * sin(pi / n) if n > 1 else link.radius)
            axis = (away * cos(chamber.angle_rad), away * sin(chamber.angle_rad))
            found.append(Bellow(f"link{i}/chamber{k}", begin, begin + link.length, axis, radius))
        begin += link.length
    return found


def walls(planes: Iterable[Plane], body: Array) -> list[Array]:
    """Return corners (4, 3) of a square on each plane that an arm can touch; its backbone is (n, 3) [m]."""
    middle, half = 0.5 * (body.min(axis=0) + body.max(axis=0)), 0.5 * np.ptp(body, axis=0).max()
    found = []
    for plane in planes:
        normal = np.array(plane.normal) / np.linalg.norm(plane.normal)
        centre = middle - normal * (normal @ (middle - np.array(plane.point)))
        # The first direction in the plane is level, unless all of them are.
        level = np.cross((0.0, 0.0, 1.0) if abs(normal[2]) < 0.999 else (0.0, 1.0, 0.0), normal)
        first = half * level / np.linalg.norm(level)
        second = np.cross(normal, first)
        found.append(centre + np.array([first + second, first - second, -first - second, second - first]))
    return found


def places(robot: Robot, per_fold: int = _PER_FOLD) -> Array:
    """Return the arc lengths [m] at which the folds of the bellows need the backbone."""
    length = sum(link.length for link in robot.links)
    pitch = min((_pitch(bellow) for bellow in chambers(robot)), default=length / 8)
    return np.linspace(0.0, length, max(2, round(length / pitch) * per_fold) + 1)


def bodies(robot: Robot, payload_kg: float = 0.0, per_fold: int = _PER_FOLD) -> list[Body]:
    """Return what an arm is drawn as: core, bellows, plates, and a ball of steel for a payload at the tip.

    Parameters
    ----------
    robot : Robot
    payload_kg : float
        0 for none.
    per_fold : int
        Rings a fold of the narrowest bellow.
    """
    radius, s = robot.links[0].radius, places(robot, per_fold)
    inner = s[1:-1]
    steady = np.full(len(inner), 0.3 * radius)
    grey = shade(_rgb("#777777"), 0.6)
    found = [Body("core", inner, 0.0 * inner, steady, (0.0, 0.0), grey, taper_at(robot.links, inner))]
    for k, bellow in enumerate(chambers(robot)):
        inside = s[(s >= bellow.begin + _PLATE * radius) & (s < bellow.end - 1e-9)]  # from plate to plate
        folds = 0.84 + 0.16 * np.cos(2 * pi * (inside - bellow.begin) / _pitch(bellow) + pi)
        colour = _rgb(COLOURS[k % len(COLOURS)])
        radii, taper = bellow.radius * folds, taper_at(robot.links, inside)
        found.append(Body(bellow.name, inside, 0.0 * inside, radii, bellow.offset, colour, taper))
    begin = 0.0
    for i, link in enumerate(robot.links):
        thickness = _PLATE * link.radius
        for k, (at, sign) in enumerate(((begin, 1), (begin + link.length, -1))):
            size = radius_profile(link, np.array([float(k)]))[0]
            found.append(_plate(f"plate{2 * i + k}", at, size, sign * thickness))
        begin += link.length
    if payload_kg > 0:
        size = (3 * payload_kg / (4 * pi * _STEEL)) ** (1 / 3)
        latitude = np.linspace(-pi / 2, pi / 2, 13)
        ahead = size * (0.95 + np.sin(latitude))
        colour = np.array([0.38, 0.40, 0.46])
        where = np.full(13, begin)
        found.append(Body("payload", where, ahead, size * np.cos(latitude), (0.0, 0.0), colour))
    return found


def between(s: Array, poses: Array, at: Array) -> Array:
    """Return poses (m, 4, 4) at arc lengths, between those that are known.

    Parameters
    ----------
    s, poses : Array
        Arc lengths (n,) [m] and poses (n, 4, 4) there, n >= 2.
    at : Array
        Arc lengths (m,) [m]; outside of `s`, the pose at its end.
    """
    k = np.clip(np.searchsorted(s, at, side="right") - 1, 0, len(s) - 2)
    part = np.clip((at - s[k]) / (s[k + 1] - s[k]), 0.0, 1.0)[:, None, None]
    return np.asarray((1.0 - part) * poses[k] + part * poses[k + 1])


def shade(full: Array, part: float) -> Array:
    """Return the colour of a chamber: `full`, mixed with the light grey of an empty one; NaN: dark grey."""
    return _UNKNOWN if isnan(part) else np.asarray(part * full + (1 - part) * np.array([0.9, 0.9, 0.9]))


def full_part(pressure: float) -> float:
    """Return how much of its full colour a chamber has, of its pressure over the highest one; NaN: NaN."""
    return pressure if isnan(pressure) else 0.12 + 0.88 * min(max(pressure, 0.0), 1.0)


def surface(robot: Robot, s: Array, poses: Array, pressure: dict[str, float], payload_kg: float) -> Faces:
    """The arm at one time.

    Parameters
    ----------
    robot : Robot
        Robot of the run.
    s : Array
        Arc lengths (m,) [m] of `places`.
    poses : Array
        Poses (m, 4, 4) of the backbone there.
    pressure : dict[str, float]
        Pressure of each chamber relative to the highest one, 0 to 1: an empty chamber is pale, one without a
        reading (NaN) dark grey.
    payload_kg : float
        Payload at the tip, drawn as a ball of steel of this mass; 0 for none.
    """
    names, parts = robot.chamber_names, []
    for body in bodies(robot, payload_kg):
        rings = body.rings(between(s, poses, body.s), _AROUND)
        part = full_part(pressure.get(body.name, 0.0)) if body.name in names else 1.0
        parts.append(lit_faces(_quads(rings), shade(body.colour, part)))
    return Faces(np.concatenate([p.corners for p in parts]), np.concatenate([p.colours for p in parts]))


def _pitch(bellow: Bellow) -> float:
    """Length of a fold [m], so that a whole number of them fills the chamber."""
    length = bellow.end - bellow.begin
    return length / max(3, round(length / (1.5 * bellow.radius)))


def _rgb(colour: str) -> Array:
    return np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])


def _plate(name: str, at: float, radius: float, thickness: float) -> Body:
    """A disc from a section on along its axis, or before it where the thickness is negative."""
    turns = np.linspace(1e-6, 1.0, 5) * radius
    low, high = min(thickness, 0.0), max(thickness, 0.0)
    ahead = np.concatenate([np.full(5, low), np.full(5, high)])
    grey = np.array([0.72, 0.74, 0.78])
    return Body(name, np.full(10, at), ahead, np.concatenate([turns, turns[::-1]]), (0.0, 0.0), grey)


def _quads(rings: Array) -> Array:
    rings = np.concatenate([rings, rings[:, :1]], axis=1)
    corners = (rings[:-1, :-1], rings[:-1, 1:], rings[1:, 1:], rings[1:, :-1])
    return np.stack(corners, axis=2).reshape(-1, 4, 3)


def lit_faces(corners: Array, colour: Array) -> Faces:
    """Faces that are the brighter the more they face the light."""
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = normal / np.where(size > 0, size, 1.0)
    light = 0.62 + 0.38 * np.clip(normal @ (_LIGHT / np.linalg.norm(_LIGHT)), -0.6, 1.0)
    return Faces(corners, np.clip(light[:, None] * colour, 0, 1))


# Length of the arrow of a force [m/N].
_M_PER_N = 0.2


def arrow_of(force_n: Array, tip_m: Array, longest_m: float) -> Array:
    """Return begin and end (2, 3) [m] of the arrow of a force at the tip: 0.2 mm for each mN, up to a length.

    Parameters
    ----------
    force_n, tip_m : ndarray (3,)
        Force on the arm [N] and place of the tip [m].
    longest_m : float
        Length of the longest arrow [m].
    """
    size_n = float(np.linalg.norm(force_n))
    scale = min(_M_PER_N, longest_m / size_n) if size_n else 0.0
    return np.array([tip_m, tip_m + scale * force_n])
