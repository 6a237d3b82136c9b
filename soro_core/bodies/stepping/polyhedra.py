"""Convex polyhedra: distance of a point, reach, and flat faces; in the body's frame but where stated."""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.bodies.stepping.records import (
    ALONG,
    CORNERS,
    LOCAL,
    OUT,
    PLANES,
    TRIANGLES,
    BodyTables,
    WorldTables,
)
from soro_core.bodies.stepping.surfaces import BESIDE, NEAR, STEEP
from soro_core.bodies.stepping.vectors import dot, subtract, turn


@inner
def polyhedron_distance(t: BodyTables, b: int, x: Array, n: Array, points: Array) -> float:
    """Signed distance [m] of x from the surface of body b; n <- its gradient. points (3, 3) is scratch."""
    plane, nearest, most = t.plane[b], 0, -math.inf
    for f in range(t.counts[b, PLANES]):
        beyond = dot(plane[f], x) - plane[f, 3]
        if beyond > most:
            most, nearest = beyond, f
    least = math.inf
    if most > 0.0:
        for k in range(t.counts[b, TRIANGLES]):
            # The nearest place lies on a face that x is in front of, at least as far as that face's plane.
            f = t.triangle[b, k, 3]
            beyond = dot(plane[f], x) - plane[f, 3]
            if beyond > 0.0 and beyond < least:
                square = _from_triangle(t, b, k, x, points)
                if square < least * least:
                    least = math.sqrt(square)
                    for r in range(3):
                        n[r] = points[2, r]
    # So near to the surface the way from there has no direction.
    if most <= 0.0 or least < 1e-9 * t.size[b, 0]:
        for r in range(3):
            n[r] = plane[nearest, r]
        return float(most)
    for r in range(3):
        n[r] /= least
    return least


@inner
def _from_triangle(t: BodyTables, b: int, k: int, x: Array, points: Array) -> float:
    """Square of the distance of x from triangle k; points[2] <- the way from its nearest place to x.

    By the signs of Ericson, Real-Time Collision Detection (2005), section 5.1.5.
    """
    corner, which = t.corner[b], t.triangle[b, k]
    a, one, other = corner[which[0]], points[0], points[1]
    subtract(corner[which[1]], a, one)
    subtract(corner[which[2]], a, other)
    away = points[2]
    subtract(x, a, away)
    d1, d2 = dot(one, away), dot(other, away)
    oo, op, pp = dot(one, one), dot(one, other), dot(other, other)
    d3, d4, d5, d6 = d1 - oo, d2 - op, d1 - op, d2 - pp
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    v = w = 0.0
    if d1 <= 0.0 and d2 <= 0.0:
        pass
    elif d3 >= 0.0 and d4 <= d3:
        v = 1.0
    elif d6 >= 0.0 and d5 <= d6:
        w = 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / (d1 - d3)
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = d2 / (d2 - d6)
    elif va <= 0.0 and d4 >= d3 and d5 >= d6:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v = 1.0 - w
    else:
        v, w = vb / (va + vb + vc), vc / (va + vb + vc)
    for r in range(3):
        away[r] -= v * one[r] + w * other[r]
    return dot(away, away)


@inner
def polyhedron_reach(w: WorldTables, b: int, d: Array) -> float:
    """How far body b reaches from its centre along d, in the world [m]."""
    R, corner, most = w.now.rotation[b], w.bodies.corner[b], -math.inf
    along = w.points[ALONG]
    for r in range(3):
        along[r] = R[0, r] * d[0] + R[1, r] * d[1] + R[2, r] * d[2]
    for i in range(w.bodies.counts[b, CORNERS]):
        most = max(most, dot(corner[i], along))
    return most


@inner
def plane_gap(w: WorldTables, b: int, f: int, natural: float) -> float:
    """Gap of the corner in w.points[LOCAL] along face f of body b, with its normal; inf beside the face.

    What is farther than `NEAR` keeps its `natural` distance.
    """
    local, plane = w.points[LOCAL], w.bodies.plane[b]
    above = dot(plane[f], local) - plane[f, 3]
    if above > NEAR:
        return natural
    for g in range(w.bodies.counts[b, PLANES]):
        if g != f:
            beside = dot(plane[g], local) - plane[g, 3] - above * dot(plane[g], plane[f])
            if beside > BESIDE:
                return math.inf
    turn(w.now.rotation[b], plane[f], w.points[OUT])
    return float(above)


@inner
def lies_on_plane(w: WorldTables, b: int, f: int, edge: Array, part: Array) -> bool:
    """Whether an edge, in the world, lies on face f of body b; part (2,) <- where on the edge."""
    R, centre, plane = w.now.rotation[b], w.now.place[b], w.bodies.plane[b]
    start, along = w.points[LOCAL], w.points[OUT]
    length = 0.0
    for r in range(3):
        start[r] = along[r] = 0.0
        for c in range(3):
            start[r] += R[c, r] * (edge[0, c] - centre[c])
            along[r] += R[c, r] * (edge[1, c] - edge[0, c])
        length += along[r] * along[r]
    above, rises = dot(plane[f], start) - plane[f, 3], dot(plane[f], along)
    part[0], part[1] = 0.0, 1.0
    if rises * rises > STEEP * STEEP * length:
        return False
    for g in range(w.bodies.counts[b, PLANES]):
        if g == f:
            continue
        # Within the plane of the face, the others bound it.
        tilt = dot(plane[g], plane[f])
        beyond = dot(plane[g], start) - plane[g, 3] - above * tilt
        grows = dot(plane[g], along) - rises * tilt
        if abs(grows) > 1e-9 * math.sqrt(length):
            if grows > 0.0:
                part[1] = min(part[1], -beyond / grows)
            else:
                part[0] = max(part[0], -beyond / grows)
        elif beyond > BESIDE:
            return False
    return bool(part[0] < part[1])
