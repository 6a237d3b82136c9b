"""The surface of an arm as coloured quadrilaterals: core, plates, bellows and payload, seen by a camera."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, isnan, pi, radians, sin

import numpy as np
from numpy.typing import NDArray

from soro_core.robot import Robot

Array = NDArray[np.float64]

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Colours of the chambers, in their order; colour-blind people can distinguish them (Okabe and Ito)."""

_AROUND = 18
_PLATE = 0.16  # thickness of the plates at the ends of a link, as a part of its radius
_PER_FOLD = 5
_LIGHT = np.array([0.35, -0.55, 0.76])
_STEEL = 7850.0
_UNKNOWN = np.full(3, 0.35)  # a chamber without a reading


@dataclass(frozen=True)
class Chamber:
    """One bellow: its name, where it begins and ends along the arm, and its axis in the section [m]."""

    name: str
    begin: float
    end: float
    offset: tuple[float, float]
    radius: float


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


def chambers(robot: Robot) -> list[Chamber]:
    """Return the places of a robot's chambers, with the largest radii that fit into the section."""
    found, begin = [], 0.0
    for i, link in enumerate(robot.links):
        n = len(link.chambers)
        for k, chamber in enumerate(link.chambers):
            away = chamber.offset_m
            if away is None:
                away = chamber.alpha_kappa / chamber.alpha_eps if chamber.alpha_eps else 0.6 * link.radius
            # Gains that were fitted may give an offset outside the section, or none.
            away = 0.0 if n == 1 else min(max(away, 0.3 * link.radius), 0.7 * link.radius)
            radius = 0.95 * min(link.radius - away, away * sin(pi / n) if n > 1 else link.radius)
            axis = (away * cos(chamber.angle_rad), away * sin(chamber.angle_rad))
            found.append(Chamber(f"link{i}/chamber{k}", begin, begin + link.length, axis, radius))
        begin += link.length
    return found


def walls(robot: Robot, body: Array) -> list[Array]:
    """Return the corners (4, 3) of a square on each plane that an arm can touch, as large as the arm.

    Parameters
    ----------
    robot : Robot
        The arm with its contacts.
    body : ndarray (n, 3)
        Points on its backbone [m].
    """
    middle, half = 0.5 * (body.min(axis=0) + body.max(axis=0)), 0.5 * np.ptp(body, axis=0).max()
    found = []
    for plane in robot.contacts.planes if robot.contacts else ():
        normal = np.array(plane.normal) / np.linalg.norm(plane.normal)
        centre = middle - normal * (normal @ (middle - np.array(plane.point)))
        # The first direction in the plane is level, unless all of them are.
        level = np.cross((0.0, 0.0, 1.0) if abs(normal[2]) < 0.999 else (0.0, 1.0, 0.0), normal)
        first = half * level / np.linalg.norm(level)
        second = np.cross(normal, first)
        found.append(centre + np.array([first + second, first - second, -first - second, second - first]))
    return found


def places(robot: Robot) -> Array:
    """Return the arc lengths [m] at which the folds of the bellows need the backbone."""
    length = sum(link.length for link in robot.links)
    pitch = min((_pitch(bellow) for bellow in chambers(robot)), default=length / 8)
    return np.linspace(0.0, length, max(2, round(length / pitch) * _PER_FOLD) + 1)


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
    radius = robot.links[0].radius
    parts = [_tube(poses[1:-1], (0.0, 0.0), np.full(len(s) - 2, 0.3 * radius), _mixed("#777777", 0.6))]
    for k, bellow in enumerate(chambers(robot)):
        inside = (s >= bellow.begin + _PLATE * radius) & (s < bellow.end - 1e-9)  # from plate to plate
        folds = 0.84 + 0.16 * np.cos(2 * pi * (s[inside] - bellow.begin) / _pitch(bellow) + pi)
        part = pressure.get(bellow.name, 0.0)
        colour = _mixed(COLOURS[k % len(COLOURS)], 0.12 + 0.88 * part)
        colour = _UNKNOWN if isnan(part) else colour
        parts.append(_tube(poses[inside], bellow.offset, bellow.radius * folds, colour))
    begin = 0.0
    for link in robot.links:
        for at, sign in ((begin, 1), (begin + link.length, -1)):
            pose = poses[np.argmin(np.abs(s - at))]
            parts += _plate(pose, link.radius, sign * _PLATE * link.radius)
        begin += link.length
    if payload_kg > 0:
        parts.append(_ball(poses[-1], (3 * payload_kg / (4 * pi * _STEEL)) ** (1 / 3)))
    return Faces(np.concatenate([p.corners for p in parts]), np.concatenate([p.colours for p in parts]))


def _pitch(bellow: Chamber) -> float:
    """Length of a fold [m], so that a whole number of them fills the chamber."""
    length = bellow.end - bellow.begin
    return length / max(3, round(length / (1.5 * bellow.radius)))


def _mixed(colour: str, part: float) -> Array:
    """A colour mixed with the light grey of an empty chamber."""
    full = np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    return np.asarray(part * full + (1 - part) * np.array([0.9, 0.9, 0.9]))


def _tube(poses: Array, offset: tuple[float, float], radius: Array, colour: Array) -> Faces:
    """Rings of a radius (m,) about a line beside the backbone."""
    angle = np.linspace(0, 2 * pi, _AROUND + 1)
    x = offset[0] + radius[:, None] * np.cos(angle)
    y = offset[1] + radius[:, None] * np.sin(angle)
    local = np.stack([x, y, np.zeros_like(x), np.ones_like(x)], axis=-1)
    rings = np.einsum("mij,maj->mai", poses, local)[..., :3]
    return _lit(_quads(rings), colour)


def _plate(pose: Array, radius: float, thickness: float) -> list[Faces]:
    """A disc from the pose on along its axis, or before it where the thickness is negative."""
    grey, turns = np.array([0.72, 0.74, 0.78]), np.linspace(1e-6, 1.0, 5) * radius
    low, high = pose @ _shift(min(thickness, 0.0)), pose @ _shift(max(thickness, 0.0))
    side = _tube(np.stack([low, high]), (0.0, 0.0), np.full(2, radius), grey)
    below = _tube(np.stack([low] * 5), (0.0, 0.0), turns, grey)
    above = _tube(np.stack([high] * 5), (0.0, 0.0), turns[::-1], grey)
    return [side, below, above]


def _ball(pose: Array, radius: float) -> Faces:
    """A ball that stands on the plate at the tip."""
    latitude = np.linspace(-pi / 2, pi / 2, 13)
    poses = np.stack([pose @ _shift(radius * (0.95 + sin(angle))) for angle in latitude])
    return _tube(poses, (0.0, 0.0), radius * np.cos(latitude), np.array([0.38, 0.40, 0.46]))


def _shift(z: float) -> Array:
    along = np.eye(4)
    along[2, 3] = z
    return along


def _quads(rings: Array) -> Array:
    corners = (rings[:-1, :-1], rings[:-1, 1:], rings[1:, 1:], rings[1:, :-1])
    return np.stack(corners, axis=2).reshape(-1, 4, 3)


def _lit(corners: Array, colour: Array) -> Faces:
    """Faces that are the brighter the more they face the light."""
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = normal / np.where(size > 0, size, 1.0)
    light = 0.62 + 0.38 * np.clip(normal @ (_LIGHT / np.linalg.norm(_LIGHT)), -0.6, 1.0)
    return Faces(corners, np.clip(light[:, None] * colour, 0, 1))
