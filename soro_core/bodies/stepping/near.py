"""Where a surface is nearest: to a point, to a piece of a curve, and where two pieces are.

A piece, (4, 3), is the cubic with its ends in the first two rows and its derivatives there in the others: an
edge of a body, or what lies between two sections of an arm.
"""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.bodies.stepping.polyhedra import polyhedron_distance
from soro_core.bodies.stepping.records import (
    ALONG,
    ALONG_OTHER,
    BEND,
    BEND_OTHER,
    HERE,
    LOCAL,
    LOCAL_OUT,
    MESH,
    OUT,
    THERE,
    WorldTables,
)
from soro_core.bodies.stepping.surfaces import surface_distance
from soro_core.bodies.stepping.vectors import dot, subtract, turn, turn_back

_SEARCHES = 24
# Largest change of the last search, as a part of a piece.
_FOUND = 1e-8
# Pull of the nearest places of two pieces towards their middles, as a part of what holds those that cross.
_PULL = 1e-3


@inner
def distance(w: WorldTables, b: int, x: Array) -> float:
    """Distance of a point of the world from body b; w.points[OUT] <- normal, in the world."""
    local, own = w.points[LOCAL], w.points[LOCAL_OUT]
    subtract(x, w.now.place[b], own)
    turn_back(w.now.rotation[b], own, local)
    if w.bodies.kind[b] == MESH:
        d = polyhedron_distance(w.bodies, b, local, own, w.points[0:3])
    else:
        d = surface_distance(w.bodies.kind[b], w.bodies.size[b], local, own)
    turn(w.now.rotation[b], own, w.points[OUT])
    return d


@inner
def place_on(piece: Array, t: float, x: Array, along: Array, bend: Array) -> None:
    """Place at t of a piece, 0 to 1, and its first two derivatives."""
    p0, p1, t0, t1 = piece[0], piece[1], piece[2], piece[3]
    s = 1.0 - t
    for r in range(3):
        chord = p1[r] - p0[r]
        x[r] = s * s * (1.0 + 2.0 * t) * p0[r] + t * t * (3.0 - 2.0 * t) * p1[r]
        x[r] += t * s * (s * t0[r] - t * t1[r])
        along[r] = 6.0 * t * s * chord + s * (1.0 - 3.0 * t) * t0[r] - t * (2.0 - 3.0 * t) * t1[r]
        bend[r] = 6.0 * (s - t) * chord + (6.0 * t - 4.0) * t0[r] + (6.0 * t - 2.0) * t1[r]


@inner
def _slope(w: WorldTables, b: int, piece: Array, t: float, taper: float) -> float:
    """d(distance - radius)/dt at t of a piece; w.points[HERE] <- place."""
    place_on(piece, t, w.points[HERE], w.points[ALONG], w.points[BEND])
    distance(w, b, w.points[HERE])
    return dot(w.points[ALONG], w.points[OUT]) - taper


@inner
def nearest_part(w: WorldTables, b: int, piece: Array, taper: float) -> float:
    """Where a piece is nearest to body b, 0 to 1, by a safeguarded secant; w.points[HERE] <- place.

    `taper`: how much larger its radius is at the end.
    """
    low, high = 0.0, 1.0
    f_low = _slope(w, b, piece, low, taper)
    if f_low >= 0.0:
        return low
    f_high = _slope(w, b, piece, high, taper)
    if f_high <= 0.0:
        return high
    t = 0.5
    for _ in range(_SEARCHES):
        t = high - f_high * (high - low) / (f_high - f_low)
        f = _slope(w, b, piece, t, taper)
        if f * f_high < 0.0:
            low, f_low = high, f_high
        else:
            f_low *= 0.5  # the Illinois rule
        moved = abs(t - high)
        high, f_high = t, f
        if moved < _FOUND or f == 0.0:
            break
    return t


@inner
def _clamp(t: float) -> float:
    return min(max(t, 0.0), 1.0)


@inner
def nearest_parts(
    w: WorldTables, one: Array, other: Array, tapers: tuple[float, float]
) -> tuple[float, float]:
    """Where two pieces are nearest, 0 to 1 on each, by Newton on the distance of their axes less the radii.

    Then w.points[HERE], [THERE] are the places, [OUT] is the first less the second. A pull towards the
    middles makes the places on parallel pieces unique.
    """
    points = w.points
    dx, dy, out = points[ALONG], points[ALONG_OTHER], points[OUT]
    s = t = 0.5
    for _ in range(_SEARCHES):
        place_on(one, s, points[HERE], dx, points[BEND])
        place_on(other, t, points[THERE], dy, points[BEND_OTHER])
        subtract(points[HERE], points[THERE], out)
        size = math.sqrt(dot(out, out))
        a, b, c = dot(dx, dx), -dot(dx, dy), dot(dy, dy)
        f = dot(dx, out) - size * tapers[0] + _PULL * a * (s - 0.5)
        g = -dot(dy, out) - size * tapers[1] + _PULL * c * (t - 0.5)
        a, c = (1.0 + _PULL) * a, (1.0 + _PULL) * c
        bent_a, bent_c = a + dot(points[BEND], out), c - dot(points[BEND_OTHER], out)
        # Far from the solution their bend may turn the way: then as if they were straight.
        if bent_a > 0.0 and bent_a * bent_c - b * b > 0.5 * _PULL * a * c:
            a, c = bent_a, bent_c
        s1 = _clamp(s - (c * f - b * g) / (a * c - b * b))
        t1 = _clamp(t - (g + b * (s1 - s)) / c)
        s1 = _clamp(s - (f + b * (t1 - t)) / a)
        moved = abs(s1 - s) + abs(t1 - t)
        s, t = s1, t1
        if moved < _FOUND:
            break
    place_on(one, s, points[HERE], dx, points[BEND])
    place_on(other, t, points[THERE], dy, points[BEND_OTHER])
    subtract(points[HERE], points[THERE], out)
    return s, t
