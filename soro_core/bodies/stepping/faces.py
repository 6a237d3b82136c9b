"""Flat faces: which one carries a corner, how far the corner is from it, and which edges lie on it."""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.bodies.stepping.near import distance
from soro_core.bodies.stepping.polyhedra import lies_on_plane, plane_gap, polyhedron_reach
from soro_core.bodies.stepping.records import (
    ALONG,
    BOX,
    CAPSULE,
    CYLINDER,
    FACING,
    HERE,
    LOCAL,
    MESH,
    OUT,
    PLANES,
    WorldTables,
)
from soro_core.bodies.stepping.surfaces import BESIDE, NEAR, STEEP
from soro_core.bodies.stepping.vectors import dot, turn


@inner
def _extent(w: WorldTables, a: int, d: Array) -> float:
    """How far body a reaches from its centre along a direction in the world [m]."""
    kind, size, own = w.bodies.kind[a], w.bodies.size[a], w.now.rotation[a]
    if kind == MESH:
        return polyhedron_reach(w, a, d)
    total = 0.0
    along = abs(own[0, 2] * d[0] + own[1, 2] * d[1] + own[2, 2] * d[2])
    if kind == BOX:
        for c in range(3):
            total += size[c] * abs(own[0, c] * d[0] + own[1, c] * d[1] + own[2, c] * d[2])
        return float(total)
    if kind == CAPSULE:
        return float(size[0] + size[1] * along)
    return float(size[1] * along + size[0] * math.sqrt(max(1.0 - along * along, 0.0)))


@inner
def _extent_back(w: WorldTables, a: int, R: Array, r: int, ahead: float) -> float:
    """How far body a, on the side `ahead` of column r of R, reaches back along it [m]."""
    d = w.points[FACING]
    for c in range(3):
        d[c] = R[c, r] if ahead < 0.0 else -R[c, r]
    return _extent(w, a, d)


@inner
def face_towards(w: WorldTables, a: int, b: int) -> int:
    """Face of body b along which it overlaps least with body a; 0 if it is not flat.

    Of a mesh 1 + its plane, of others 1 + its axis, signed.
    """
    kind, size, R = w.bodies.kind[b], w.bodies.size[b], w.now.rotation[b]
    if kind != BOX and kind != CYLINDER and kind != MESH:
        return 0
    distance(w, b, w.now.place[a])
    local, face, largest = w.points[LOCAL], 0, -math.inf
    if kind == MESH:
        plane, d = w.bodies.plane[b], w.points[FACING]
        for f in range(w.bodies.counts[b, PLANES]):
            turn(R, plane[f], d)
            for c in range(3):
                d[c] = -d[c]
            apart = dot(plane[f], local) - plane[f, 3] - _extent(w, a, d)
            if apart > largest:
                largest, face = apart, 1 + f
        return face
    if kind == CYLINDER:  # round about its axis: a is at most its bounding radius away
        across = math.sqrt(local[0] * local[0] + local[1] * local[1])
        width = min(_extent_back(w, a, R, 0, local[0]), _extent_back(w, a, R, 1, local[1]))
        largest = across - size[0] - width
    for r in range(0 if kind == BOX else 2, 3):
        apart = abs(local[r]) - size[r if kind == BOX else 1] - _extent_back(w, a, R, r, local[r])
        if apart > largest:
            largest, face = apart, 1 + r
    return face if face == 0 or local[face - 1] >= 0.0 else -face


@inner
def _face_gap(w: WorldTables, b: int, face: int, natural: float) -> float:
    """Gap of the corner in w.points[LOCAL] along a face of body b, with its normal; inf beside the face.

    At the rim of a face the nearest surface of a corner that has sunk in is the side of the body, which would
    not carry it. What is farther than `NEAR` keeps its `natural` distance.
    """
    if w.bodies.kind[b] == MESH:
        return plane_gap(w, b, face - 1, natural)
    size, local, out, R = w.bodies.size[b], w.points[LOCAL], w.points[OUT], w.now.rotation[b]
    r = abs(face) - 1
    sign = 1.0 if face > 0 else -1.0
    is_box = w.bodies.kind[b] == BOX
    above = sign * local[r] - (size[r] if is_box else size[1])
    if above > NEAR:
        return natural
    beside = math.sqrt(local[0] * local[0] + local[1] * local[1]) - size[0]
    if is_box:
        one, other = (r + 1) % 3, (r + 2) % 3
        beside = max(abs(local[one]) - size[one], abs(local[other]) - size[other])
    if beside > BESIDE:
        return math.inf
    for c in range(3):
        out[c] = sign * R[c, r]
    return float(above)


@inner
def corner_gap(w: WorldTables, b: int, face: int, radius: float) -> float:
    """Gap of the corner in w.points[HERE] from body b, by the face where it has no radius."""
    natural = distance(w, b, w.points[HERE])
    return natural - radius if face == 0 or radius > 0.0 else _face_gap(w, b, face, natural)


@inner
def lies_on(w: WorldTables, b: int, face: int, edge: Array, part: Array) -> bool:
    """Whether an edge lies on a flat face of body b; part (2,) <- where on the edge."""
    if w.bodies.kind[b] == MESH:
        return lies_on_plane(w, b, face - 1, edge, part)
    R, size, centre, first, last = w.now.rotation[b], w.bodies.size[b], w.now.place[b], edge[0], edge[1]
    is_box = w.bodies.kind[b] == BOX
    part[0], part[1] = 0.0, 1.0
    length = 0.0
    # On the disc of a cylinder: |start + t along|^2 = radius^2.
    square, middle, beyond = 0.0, 0.0, -size[0] * size[0]
    for c in range(3):
        length += (last[c] - first[c]) ** 2
    for r in range(3):
        start = along = 0.0
        for c in range(3):
            start += R[c, r] * (first[c] - centre[c])
            along += R[c, r] * (last[c] - first[c])
        if r == abs(face) - 1:
            if along * along > STEEP * STEEP * length:
                return False
        elif not is_box:
            square += along * along
            middle += start * along
            beyond += start * start
        elif abs(along) > 1e-9 * size[r]:
            one, other = (-size[r] - start) / along, (size[r] - start) / along
            part[0], part[1] = max(part[0], min(one, other)), min(part[1], max(one, other))
        elif abs(start) > size[r] + BESIDE:
            return False
    if not is_box:
        chord = middle * middle - square * beyond
        # One that only meets the rim is none: it would come and go.
        if not chord > 2.0 * BESIDE * size[0] * square:
            return False
        chord = math.sqrt(chord)
        part[0], part[1] = max(0.0, -(middle + chord) / square), min(1.0, (chord - middle) / square)
    return bool(part[0] < part[1])


@inner
def rim_meets(w: WorldTables, a: int, b: int, face: int, k: int) -> bool:
    """Whether the rim of cylinder a has a point k on or over the disc of cylinder b; w.points[HERE] <- it.

    The lens in which two discs overlap is spanned by where their rims cross, k = 1 and 2, and by the point of
    each rim that is nearest to the axis of the other, k = 0.
    """
    local, x, out, side = w.points[LOCAL], w.points[HERE], w.points[OUT], w.points[ALONG]
    R, own = w.now.rotation[b], w.now.rotation[a]
    size, other = w.bodies.size[a], w.bodies.size[b]
    distance(w, b, w.now.place[a])
    apart = math.sqrt(local[0] * local[0] + local[1] * local[1])
    parallel = own[0, 2] * R[0, 2] + own[1, 2] * R[1, 2] + own[2, 2] * R[2, 2]
    if face < 0:
        parallel = -parallel
    if parallel * parallel < 1.0 - STEEP * STEEP or apart < BESIDE:
        return False
    along, across = size[0], 0.0
    if k > 0:
        along = 0.5 * (apart + (size[0] * size[0] - other[0] * other[0]) / apart)
        if not abs(along) < size[0]:
            return False
        across = math.sqrt(size[0] * size[0] - along * along) * (1.0 if k == 1 else -1.0)
    for c in range(3):
        out[c] = -(local[0] * R[c, 0] + local[1] * R[c, 1]) / apart
        side[c] = (local[1] * R[c, 0] - local[0] * R[c, 1]) / apart
        x[c] = w.now.place[a, c] - math.copysign(size[1], parallel) * own[c, 2]
        x[c] += along * out[c] + across * side[c]
    return True
