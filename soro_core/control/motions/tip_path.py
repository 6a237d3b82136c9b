"""Paths of the tip: legs from rest to rest, each a straight line or a smooth curve through poses.

A leg of two poses is a straight line. A leg of more is a cubic spline through their positions over the length
of the chords between them, twice continuously differentiable. A pose that stands twice in a row ends a leg:
the tip rests there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ConfigError
from soro_core.rotation import matrix_from_quaternion, quaternion_from_matrix, rotation_exp, rotation_log

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline


WHERE = "path"
# Positions that differ by less [m] are equal.
SAME_M = 1e-6
# A curve that is narrower [m] turns back rather than bends.
NARROWEST_M = 1e-4
# Parts of the piece between two poses at which length and curvature are taken.
_PARTS = 16
# Largest angle between two points of a sampled arc [rad].
_ARC_STEP = math.radians(2.0)


@dataclass(frozen=True)
class TipLeg:
    """A curve of the tip that is passed from rest to rest.

    Attributes
    ----------
    position : CubicSpline
        Positions [m] over the chord length, for each of three axes.
    turn : CubicSpline or None
        Rotation vectors [rad] from the first orientation, over the chord length; None without orientations.
    first : ndarray (3, 3)
        The first orientation.
    chord : ndarray (n,)
        Chord lengths at places along the leg [m].
    length : ndarray (n,)
        Lengths of the curve up to these places [m].
    slope : ndarray (n,)
        Chord length by length of the curve at these places.
    curvature_per_m : float
        Largest curvature [1/m].
    """

    position: CubicSpline
    turn: CubicSpline | None
    first: Array
    chord: Array
    length: Array
    slope: Array
    curvature_per_m: float

    @property
    def length_m(self) -> float:
        """Length of the curve [m]."""
        return float(self.length[-1])

    @cached_property
    def _chord_at(self) -> Any:
        from scipy.interpolate import CubicHermiteSpline

        return CubicHermiteSpline(self.length, self.chord, self.slope)

    def at(self, s: float) -> tuple[Array, Array | None]:
        """Return position (3,) and orientation (4,) x, y, z, w or None, `s` metres along the leg."""
        u = float(self._chord_at(min(max(s, 0.0), self.length_m)))
        position = np.asarray(self.position(u), dtype=np.float64)
        if self.turn is None:
            return position, None
        return position, quaternion_from_matrix(self.first @ rotation_exp(np.asarray(self.turn(u))))


def legs_of(positions: Array, orientations: Array | None = None) -> tuple[TipLeg, ...]:
    """Return the legs of a path; none if all its poses are the same point.

    Parameters
    ----------
    positions : ndarray (n, 3)
        Positions to pass [m], at least one.
    orientations : ndarray (n, 4), optional
        Orientations (x, y, z, w) to pass.

    Returns
    -------
    tuple of TipLeg

    Raises
    ------
    ConfigError
        If a number is not finite, an orientation is no unit quaternion, or the path turns back within a leg.
    """
    points = np.asarray(positions, dtype=np.float64)
    turns = None if orientations is None else np.asarray(orientations, dtype=np.float64)
    if points.ndim != 2 or points.shape[1:] != (3,) or not len(points):
        raise ConfigError(WHERE, "poses", f"shape {points.shape}", "one or more poses")
    for k, point in enumerate(points):
        if not np.all(np.isfinite(point)):
            raise ConfigError(WHERE, f"poses[{k}].position", point.tolist(), "three finite numbers [m]")
        if turns is not None and not abs(float(turns[k] @ turns[k]) - 1.0) < 0.02:
            got = turns[k].tolist()
            raise ConfigError(WHERE, f"poses[{k}].orientation", got, "a unit quaternion x, y, z, w")
    moved = np.linalg.norm(np.diff(points, axis=0), axis=1) > SAME_M
    # A leg begins where the tip begins to move, and ends where a pose is repeated.
    edges = np.diff(np.concatenate(([False], moved, [False])).astype(int))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return tuple(
        _leg(points[i : j + 1], None if turns is None else turns[i : j + 1], int(i))
        for i, j in zip(begins, ends, strict=True)
    )


def _leg(points: Array, orientations: Array | None, number: int) -> TipLeg:
    """Return the leg through poses that are apart; `number` is that of its first pose."""
    from scipy.interpolate import CubicSpline  # imported here: most references have no path

    at = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))
    curve = CubicSpline(at, points)
    ends = np.linspace(at[:-1], at[1:], _PARTS + 1)
    chord = np.append(ends[:-1].T.ravel(), at[-1])
    nodes, weights = np.polynomial.legendre.leggauss(4)
    middle, half = 0.5 * (chord[1:] + chord[:-1]), 0.5 * np.diff(chord)
    rates = np.linalg.norm(curve(middle[:, None] + half[:, None] * nodes, 1), axis=2)
    length = np.concatenate(([0.0], np.cumsum(half * (rates @ weights))))
    # The curvature of a cubic changes little between these places, their middles included.
    places = np.sort(np.concatenate((chord, middle)))
    first, second = curve(places, 1), curve(places, 2)
    rate = np.linalg.norm(first, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        bend = np.linalg.norm(np.cross(first, second), axis=1) / rate**3
    slow = rate < 1e-3
    if np.any(slow) or float(np.max(bend)) > 1.0 / NARROWEST_M:
        k = number + int(np.searchsorted(at, places[int(np.argmax(np.where(slow, np.inf, bend)))]))
        point = points[min(k - number, len(points) - 1)].tolist()
        allowed = "poses that turn less sharply, or the pose twice for a corner at which the tip rests"
        raise ConfigError(WHERE, f"poses[{k}].position", point, allowed)
    # Round-off of a straight line is no curvature.
    curvature = float(np.max(bend)) if len(points) > 2 else 0.0
    slope = 1.0 / np.linalg.norm(curve(chord, 1), axis=1)
    if orientations is None:
        return TipLeg(curve, None, np.eye(3), chord, length, slope, curvature)
    begin = matrix_from_quaternion(orientations[0])
    turns = np.stack([rotation_log(begin.T @ matrix_from_quaternion(one)) for one in orientations])
    jumps = np.linalg.norm(np.diff(turns, axis=0), axis=1)
    if np.any(jumps > math.pi):  # beyond half a revolution the rotation vector starts on the other side
        k = int(np.argmax(jumps)) + 1
        allowed = "less than half a revolution from the first pose of its leg"
        raise ConfigError(WHERE, f"poses[{number + k}].orientation", orientations[k].tolist(), allowed)
    return TipLeg(curve, CubicSpline(at, turns), begin, chord, length, slope, curvature)


def corners(points: Sequence[Array]) -> Array:
    """Return the positions (n, 3) of straight lines between `points` (3,), with a rest at each corner."""
    inner = [point for corner in points[1:-1] for point in (corner, corner)]
    return np.array([points[0], *inner, points[-1]], dtype=np.float64)


def arc(start: Array, via: Array, end: Array) -> Array:
    """Return positions (n, 3) along the circular arc from `start` through `via` to `end`.

    Parameters
    ----------
    start, via, end : ndarray (3,)
        Positions [m].

    Returns
    -------
    ndarray (n, 3)

    Raises
    ------
    ConfigError
        If two of the points are equal, or all three lie on a line.
    """
    to_via, to_end = via - start, end - start
    normal = np.cross(to_via, to_end)
    size = float(np.linalg.norm(normal))
    if size <= SAME_M * max(float(np.linalg.norm(to_via)), float(np.linalg.norm(to_end)), SAME_M):
        got = [start.tolist(), via.tolist(), end.tolist()]
        raise ConfigError("arc", "points", got, "three different points that are not on one line")
    axis = normal / size
    a, b = float(to_via @ to_via), float(to_end @ to_end)
    centre = start + (a * np.cross(to_end, normal) - b * np.cross(to_via, normal)) / (2.0 * size * size)
    out = start - centre
    side = np.cross(axis, out)
    last = end - centre
    angle = math.atan2(float(last @ side), float(last @ out)) % (2.0 * math.pi)
    n = max(math.ceil(angle / _ARC_STEP), 4)
    phases = np.linspace(0.0, angle, n + 1)[:, None]
    return np.asarray(centre + np.cos(phases) * out + np.sin(phases) * side)
