"""Contacts between two bodies, corner by corner and edge by edge, and at the limits of hinges."""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.bodies.stepping.contacts import body_side, keep_contact, open_contact
from soro_core.bodies.stepping.faces import corner_gap, face_towards, lies_on, rim_meets
from soro_core.bodies.stepping.near import distance, nearest_part
from soro_core.bodies.stepping.records import (
    ANGLE,
    AXIS,
    BALL,
    CORNERS,
    CYLINDER,
    DRIVEN,
    EDGE,
    EDGES,
    ENDS,
    GROUND,
    HERE,
    HINGED,
    LOW,
    MESH,
    MOST_CONTACTS,
    OUT,
    TOWARDS,
    WorldTables,
)
from soro_core.bodies.stepping.surfaces import corners, edge, skin
from soro_core.bodies.stepping.vectors import subtract, turn, turn_back

# Features of a pair of surfaces in a key: corners, edges, their ends on a face, and points of rims.
FEATURES = 1024
_EDGES, _ENDS, _RIMS = 64, 256, 640
# An edge this near to its end touches with a corner.
_END = 1e-3


@inner
def _to_world(w: WorldTables, a: int, corner: Array, x: Array) -> None:
    turn(w.now.rotation[a], corner, x)
    for r in range(3):
        x[r] += w.now.place[a, r]


@inner
def _corners_of(w: WorldTables, a: int, towards: Array) -> int:
    """w.corners <- points by which body a touches others, in its frame; gives their number."""
    t = w.bodies
    if t.kind[a] != MESH:
        return corners(t.kind[a], t.size[a], towards, w.corners)
    n = int(t.counts[a, CORNERS])
    for i in range(n):
        for r in range(3):
            w.corners[i, r] = t.corner[a, i, r]
    return n


@inner
def _edge_of(w: WorldTables, a: int, e: int) -> tuple[int, int]:
    """Corners at the ends of edge e, (0, 0) behind the last."""
    t = w.bodies
    if t.kind[a] != MESH:
        return edge(t.kind[a], e)
    if e < t.counts[a, EDGES]:
        return int(t.edge[a, e, 0]), int(t.edge[a, e, 1])
    return 0, 0


@inner
def _touch(w: WorldTables, feature: int, pair: tuple[int, int], gap: float, h: float, margin: float) -> bool:
    """Contact of a feature of the first of two bodies at w.points[HERE]; False if there is no room."""
    if not gap < margin:
        return True
    t, k = w.bodies, w.contacts
    a, b = pair
    key = (a * t.kind.shape[0] + b) * FEATURES + feature
    c = open_contact(w, key, skin(t.kind[a], t.size[a]), gap)
    if c == MOST_CONTACTS:
        return False
    body_side(w, c, 0, a)
    body_side(w, c, 1, b)
    k.friction[c] = min(t.friction[a], t.friction[b])
    k.restitution[c] = max(t.restitution[a], t.restitution[b])
    keep_contact(w, c, h)
    return True


@inner
def _touch_edges(
    w: WorldTables, pair: tuple[int, int], face: int, h: float, margin: float, anywhere: bool
) -> bool:
    """Contacts of the edges of the first of two bodies, between its corners, `anywhere` or on faces alone."""
    t, here, ends, line = w.bodies, w.points[HERE], w.points[ENDS], w.points[EDGE : EDGE + 4]
    a, b = pair
    radius, e = skin(t.kind[a], t.size[a]), 0
    first, last = _edge_of(w, a, e)
    while first != last:
        _to_world(w, a, w.corners[first], line[0])
        _to_world(w, a, w.corners[last], line[1])
        subtract(line[1], line[0], line[2])
        subtract(line[1], line[0], line[3])
        # One that lies on a face touches where it leaves it: in between it would only balance.
        if face != 0 and lies_on(w, b, face, line, ends):
            for end in range(2):
                if _END < ends[end] < 1.0 - _END:
                    for r in range(3):
                        here[r] = line[0, r] + ends[end] * line[2, r]
                    gap = corner_gap(w, b, face, radius)
                    if not _touch(w, _ENDS + 2 * e + end, pair, gap, h, margin):
                        return False
        elif (
            anywhere
            and _END < nearest_part(w, b, line, 0.0) < 1.0 - _END
            and not _touch(w, _EDGES + e, pair, distance(w, b, here) - radius, h, margin)
        ):
            return False
        e += 1
        first, last = _edge_of(w, a, e)
    return True


@inner
def _touch_corners(w: WorldTables, pair: tuple[int, int], h: float, margin: float, with_edges: bool) -> bool:
    """Contacts of the corners of the first of two bodies, and between them of its edges, with the second."""
    t = w.bodies
    a, b = pair
    towards = w.points[TOWARDS]
    radius = skin(t.kind[a], t.size[a])
    distance(w, b, w.now.place[a])
    turn_back(w.now.rotation[a], w.points[OUT], towards)
    for r in range(3):
        towards[r] = -towards[r]
    n = _corners_of(w, a, towards)
    face = 0 if t.kind[a] == BALL else face_towards(w, a, b)
    for i in range(n):
        _to_world(w, a, w.corners[i], w.points[HERE])
        if not _touch(w, i, pair, corner_gap(w, b, face, radius), h, margin):
            return False
    on_disc = face != 0 and t.kind[b] == CYLINDER
    if on_disc and t.kind[a] == CYLINDER:
        for k in range(3 if with_edges else 1):
            if rim_meets(w, a, b, face, k) and not _touch(
                w, _RIMS + k, pair, corner_gap(w, b, face, radius), h, margin
            ):
                return False
    # Edges of the second body of a pair count, too, where they leave the disc of the first.
    return not (with_edges or on_disc) or _touch_edges(w, pair, face, h, margin, with_edges)


@inner
def find_body_contacts(w: WorldTables, h: float, margin: float) -> bool:
    """Find those between bodies, and with limits of hinges. False if there are more than `MOST_CONTACTS`."""
    t, place = w.bodies, w.now.place
    n = t.kind.shape[0]
    for a in range(n):
        if t.motion[a] == HINGED and not _find_limits(w, a, h):
            return False
        for b in range(a + 1, n):
            if t.motion[a] == DRIVEN and t.motion[b] == DRIVEN:
                continue
            square = 0.0
            for r in range(3):
                square += (place[a, r] - place[b, r]) ** 2
            bound = t.bound[a] + t.bound[b] + margin
            has_ground = t.kind[a] == GROUND or t.kind[b] == GROUND
            if not has_ground and square > bound * bound:
                continue
            # A ball touches with its centre alone; two others each with their corners, one with its edges.
            one_ball = t.kind[a] == BALL or t.kind[b] == BALL
            pair = (b, a) if t.kind[b] == BALL or t.kind[a] == GROUND else (a, b)
            both = not one_ball and not has_ground
            if not _touch_corners(w, pair, h, margin, both):
                return False
            if both and not _touch_corners(w, (pair[1], pair[0]), h, margin, False):
                return False
    return True


@inner
def _find_limits(w: WorldTables, b: int, h: float) -> bool:
    """Contacts of a hinge with its limits; they have body b on both sides."""
    k, hinge, angle = w.contacts, w.bodies.hinge[b], w.now.joint[b, ANGLE]
    for end in range(2):
        way = 1.0 if end == 0 else -1.0
        gap = way * (angle - hinge[LOW + end])
        if not gap < math.inf:
            continue
        c = k.counts[0]
        if c == MOST_CONTACTS:
            return False
        k.key[c], k.gap[c] = -1 - 2 * b - end, gap
        k.friction[c] = k.restitution[c] = 0.0
        k.side[c, 0] = k.side[c, 1] = b
        k.mover[c, 0], k.mover[c, 1] = w.movers.n_arms + b, -1
        for i in range(3):
            k.given[c, i], k.point[c, i] = 0.0, w.now.place[b, i]
            for r in range(3):
                k.frame[c, i, r] = 0.0
            G = k.G[c, 0, i]
            for r in range(G.shape[0]):
                G[r] = way * hinge[AXIS + r] if i == 0 and r < 3 else 0.0
        keep_contact(w, c, h)
    return True
