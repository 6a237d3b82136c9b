"""Where surfaces are near: contacts between bodies, and between the pieces of an arm and bodies.

A piece of an arm runs between two sections, as the cubic through their places and directions, with their
radius: the contact is at its nearest place, not at a section, so that it does not depend on their number.
"""

from __future__ import annotations

import math

from soro_core._by_type import select_by_type
from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.bodies.stepping.records import (
    ANGLE,
    AXIS,
    BALL,
    BOX,
    CAPSULE,
    CYLINDER,
    DRIVEN,
    GROUND,
    HERE,
    HINGED,
    LOCAL,
    LOCAL_OUT,
    LOW,
    MOST_CONTACTS,
    NOBODY,
    OUT,
    P0,
    P1,
    T0,
    T1,
    TANGENT,
    TOWARDS,
    ArmTables,
    NoArms,
    WorldTables,
)
from soro_core.bodies.stepping.surfaces import corners, edge, skin, surface_distance

# Gap [m] below which a contact is solved for, beside what the motion of a step closes.
NEAR = 2e-4
# A corner this far beside a face [m] still stands on it; an edge this steep, by its sine, does not lie on it.
_BESIDE, _STEEP = 1e-5, 0.02
# Features of a pair of surfaces in a key.
FEATURES = 64
_SEARCHES = 24


@inner
def distance(w: WorldTables, b: int, x: Array) -> float:
    """Distance of a point of the world from body b; w.points[OUT] <- normal, in the world."""
    R, centre = w.now.rotation[b], w.now.place[b]
    local, own, out = w.points[LOCAL], w.points[LOCAL_OUT], w.points[OUT]
    for r in range(3):
        local[r] = 0.0
        for c in range(3):
            local[r] += R[c, r] * (x[c] - centre[c])
    d = surface_distance(w.bodies.kind[b], w.bodies.size[b], local, own)
    for r in range(3):
        out[r] = R[r, 0] * own[0] + R[r, 1] * own[1] + R[r, 2] * own[2]
    return d


@inner
def _slope(w: WorldTables, b: int, t: float, taper: float) -> float:
    """d(distance - radius)/dt at t of the piece in w.points; w.points[HERE] <- place."""
    p0, p1, t0, t1 = w.points[P0], w.points[P1], w.points[T0], w.points[T1]
    x, along, out = w.points[HERE], w.points[TANGENT], w.points[OUT]
    s = 1.0 - t
    for r in range(3):
        x[r] = s * s * (1.0 + 2.0 * t) * p0[r] + t * t * (3.0 - 2.0 * t) * p1[r]
        x[r] += t * s * (s * t0[r] - t * t1[r])
        along[r] = 6.0 * t * s * (p1[r] - p0[r]) + s * (1.0 - 3.0 * t) * t0[r] - t * (2.0 - 3.0 * t) * t1[r]
    distance(w, b, x)
    return float(along[0] * out[0] + along[1] * out[1] + along[2] * out[2] - taper)


@inner
def nearest_part(w: WorldTables, b: int, taper: float) -> float:
    """Where the piece in w.points is nearest to body b, 0 to 1, by a safeguarded secant."""
    low, high = 0.0, 1.0
    f_low, f_high = _slope(w, b, low, taper), _slope(w, b, high, taper)
    if f_low >= 0.0:
        return 0.0
    if f_high <= 0.0:
        return 1.0
    t = 0.5
    for _ in range(_SEARCHES):
        t = high - f_high * (high - low) / (f_high - f_low)
        f = _slope(w, b, t, taper)
        if f * f_high < 0.0:
            low, f_low = high, f_high
        else:
            f_low *= 0.5  # the Illinois rule
        moved = abs(t - high)
        high, f_high = t, f
        if moved < 1e-8 or f == 0.0:
            break
    return min(max(t, 0.0), 1.0)


@inner
def _tangents(frame: Array) -> None:
    """Fill frame[1], frame[2] with directions across frame[0]."""
    n = frame[0]
    least = 0
    for r in range(1, 3):
        if abs(n[r]) < abs(n[least]):
            least = r
    square = math.sqrt(1.0 - n[least] * n[least])
    for r in range(3):
        frame[1, r] = ((1.0 if r == least else 0.0) - n[least] * n[r]) / square
    frame[2, 0] = n[1] * frame[1, 2] - n[2] * frame[1, 1]
    frame[2, 1] = n[2] * frame[1, 0] - n[0] * frame[1, 2]
    frame[2, 2] = n[0] * frame[1, 1] - n[1] * frame[1, 0]


@inner
def body_side(w: WorldTables, c: int, side: int, b: int) -> None:
    """Side of contact c at its point of body b."""
    k = w.contacts
    sign = 1.0 if side == 0 else -1.0
    k.side[c, side], k.mover[c, side] = b, w.movers.start.shape[0] - w.bodies.kind.shape[0] + b
    G, frame, x, centre = k.G[c, side], k.frame[c], k.point[c], w.now.place[b]
    a0, a1, a2 = x[0] - centre[0], x[1] - centre[1], x[2] - centre[2]
    for i in range(3):
        f = frame[i]
        G[i, 0] = sign * (a1 * f[2] - a2 * f[1])
        G[i, 1] = sign * (a2 * f[0] - a0 * f[2])
        G[i, 2] = sign * (a0 * f[1] - a1 * f[0])
        for r in range(3):
            G[i, 3 + r] = sign * f[r]
        for r in range(6, G.shape[1]):
            G[i, r] = 0.0


@inner
def open_contact(w: WorldTables, key: int, radius: float, gap: float) -> int:
    """Write a contact at w.points[HERE], `radius` below the surface of the first side, behind the last."""
    k = w.contacts
    c = int(k.counts[0])
    if c == MOST_CONTACTS:
        return c
    out, x = w.points[OUT], w.points[HERE]
    k.key[c], k.gap[c] = key, gap
    for r in range(3):
        k.frame[c, 0, r] = out[r]
        k.point[c, r] = x[r] - (radius + 0.5 * gap) * out[r]
        k.given[c, r] = 0.0
    _tangents(k.frame[c])
    return c


@inner
def keep_contact(w: WorldTables, c: int, h: float) -> bool:
    """Count contact c if it may close within the step; the speed of its bodies decides. False: no room."""
    k, v = w.contacts, w.movers.start
    if c == MOST_CONTACTS:
        return False
    speed = k.given[c, 0]
    for side in range(2):
        if k.mover[c, side] >= 0:
            row = v[k.mover[c, side]]
            for j in range(row.shape[0]):
                speed += k.G[c, side, 0, j] * row[j]
    if k.gap[c] < NEAR + 2.0 * h * max(-speed, 0.0):
        k.counts[0] = c + 1
        k.bias[c] = speed
    return True


@inner
def _body_pair(w: WorldTables, key: int, a: int, b: int, h: float, gap: float) -> bool:
    t = w.bodies
    c = open_contact(w, key, skin(t.kind[a], t.size[a]), gap)
    if c == MOST_CONTACTS:
        return False
    body_side(w, c, 0, a)
    body_side(w, c, 1, b)
    w.contacts.friction[c] = min(t.friction[a], t.friction[b])
    w.contacts.restitution[c] = max(t.restitution[a], t.restitution[b])
    return keep_contact(w, c, h)


@inner
def _to_world(w: WorldTables, a: int, corner: Array, x: Array) -> None:
    R, centre = w.now.rotation[a], w.now.place[a]
    for r in range(3):
        x[r] = centre[r] + R[r, 0] * corner[0] + R[r, 1] * corner[1] + R[r, 2] * corner[2]


@inner
def _extent(w: WorldTables, a: int, R: Array, r: int) -> float:
    """How far body a reaches from its centre along column r of R [m]."""
    kind, size, own = w.bodies.kind[a], w.bodies.size[a], w.now.rotation[a]
    total = 0.0
    along = abs(own[0, 2] * R[0, r] + own[1, 2] * R[1, r] + own[2, 2] * R[2, r])
    if kind == BOX:
        for c in range(3):
            total += size[c] * abs(own[0, c] * R[0, r] + own[1, c] * R[1, r] + own[2, c] * R[2, r])
        return float(total)
    if kind == CAPSULE:
        return float(size[0] + size[1] * along)
    return float(size[1] * along + size[0] * math.sqrt(max(1.0 - along * along, 0.0)))


@inner
def _face_towards(w: WorldTables, a: int, b: int) -> int:
    """Face of body b along which it overlaps least with body a: 1 + its axis, signed; 0 if it is not flat."""
    kind, size, R, half = w.bodies.kind[b], w.bodies.size[b], w.now.rotation[b], w.bodies.size[b, 1]
    if kind != BOX and kind != CYLINDER:
        return 0
    distance(w, b, w.now.place[a])
    local, face, largest = w.points[LOCAL], 0, -math.inf
    if kind == CYLINDER:  # round about its axis: a is at most its bounding radius away
        across = math.sqrt(local[0] * local[0] + local[1] * local[1])
        largest = across - size[0] - _across(w, a, b)
    for r in range(3 if kind == BOX else 0):
        apart = abs(local[r]) - size[r] - _extent(w, a, R, r)
        if apart > largest:
            largest, face = apart, 1 + r
    if kind == CYLINDER and abs(local[2]) - half - _extent(w, a, R, 2) > largest:
        face = 3
    return face if face == 0 or local[face - 1] >= 0.0 else -face


@inner
def _across(w: WorldTables, a: int, b: int) -> float:
    """How far body a reaches from its centre along either axis across body b, at least [m]."""
    R = w.now.rotation[b]
    return min(_extent(w, a, R, 0), _extent(w, a, R, 1))


@inner
def _face_gap(w: WorldTables, b: int, face: int, natural: float) -> float:
    """Gap of the corner in w.points[LOCAL] along a face of body b, with its normal; inf beside the face.

    At the rim of a face the nearest surface of a corner that has sunk in is the side of the body, which would
    not carry it. What is farther than `NEAR` keeps its `natural` distance.
    """
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
    if beside > _BESIDE:
        return math.inf
    for c in range(3):
        out[c] = sign * R[c, r]
    return float(above)


@inner
def _corner_gap(w: WorldTables, b: int, face: int, radius: float) -> float:
    """Gap of the corner in w.points[HERE] from body b, by the face where it has no radius."""
    natural = distance(w, b, w.points[HERE])
    return natural - radius if face == 0 or radius > 0.0 else _face_gap(w, b, face, natural)


@inner
def _lies_on(w: WorldTables, b: int, face: int, part: Array) -> bool:
    """Whether the edge in w.points lies on a face of box b; part (2,) <- where on the edge."""
    R, size, centre, first, last = (
        w.now.rotation[b],
        w.bodies.size[b],
        w.now.place[b],
        w.points[P0],
        w.points[P1],
    )
    part[0], part[1] = 0.0, 1.0
    length = 0.0
    for c in range(3):
        length += (last[c] - first[c]) ** 2
    for r in range(3):
        start = along = 0.0
        for c in range(3):
            start += R[c, r] * (first[c] - centre[c])
            along += R[c, r] * (last[c] - first[c])
        if r == abs(face) - 1:
            if along * along > _STEEP * _STEEP * length:
                return False
        elif abs(along) > 1e-9 * size[r]:
            one, other = (-size[r] - start) / along, (size[r] - start) / along
            part[0], part[1] = max(part[0], min(one, other)), min(part[1], max(one, other))
        elif abs(start) > size[r] + _BESIDE:
            return False
    return bool(part[0] < part[1])


@inner
def touch_corners(w: WorldTables, a: int, b: int, h: float, margin: float, with_edges: bool) -> bool:
    """ContactTables of the corners of body a, and between them of its edges, with body b."""
    t = w.bodies
    R, towards, out, here = w.now.rotation[a], w.points[TOWARDS], w.points[OUT], w.points[HERE]
    radius = skin(t.kind[a], t.size[a])
    key = (a * t.kind.shape[0] + b) * FEATURES
    distance(w, b, w.now.place[a])
    for r in range(3):
        towards[r] = -(R[0, r] * out[0] + R[1, r] * out[1] + R[2, r] * out[2])
    n = corners(t.kind[a], t.size[a], towards, w.corners)
    face = 0 if t.kind[a] == BALL else _face_towards(w, a, b)
    for i in range(n):
        _to_world(w, a, w.corners[i], here)
        gap = _corner_gap(w, b, face, radius)
        if gap < margin and not _body_pair(w, key + i, a, b, h, gap):
            return False
    k = 0
    while with_edges:
        first, last = edge(t.kind[a], k)
        if first == last:
            break
        _to_world(w, a, w.corners[first], w.points[P0])
        _to_world(w, a, w.corners[last], w.points[P1])
        for r in range(3):
            w.points[T0, r] = w.points[T1, r] = w.points[P1, r] - w.points[P0, r]
        # One that lies on a face touches where it leaves it: in between it would only balance.
        ends = w.points[TOWARDS]
        if face != 0 and t.kind[b] == BOX and _lies_on(w, b, face, ends):
            for end in range(2):
                part = ends[end]
                if 1e-3 < part < 1.0 - 1e-3:
                    for r in range(3):
                        here[r] = w.points[P0, r] + part * w.points[T0, r]
                    gap = _corner_gap(w, b, face, radius)
                    if gap < margin and not _body_pair(w, key + 20 + 2 * k + end, a, b, h, gap):
                        return False
            k += 1
            continue
        part = nearest_part(w, b, 0.0)
        # At an end it is a corner.
        if 1e-3 < part < 1.0 - 1e-3:
            _slope(w, b, part, 0.0)
            gap = distance(w, b, here) - radius
            if gap < margin and not _body_pair(w, key + 8 + k, a, b, h, gap):
                return False
        k += 1
    return True


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
            if t.kind[a] != GROUND and t.kind[b] != GROUND and square > bound * bound:
                continue
            # A ball touches with its centre alone; two others each with their corners, one with its edges.
            one_ball = t.kind[a] == BALL or t.kind[b] == BALL
            first, second = (b, a) if t.kind[b] == BALL or t.kind[a] == GROUND else (a, b)
            if not touch_corners(w, first, second, h, margin, t.kind[second] != GROUND and not one_ball):
                return False
            if (
                not one_ball
                and t.kind[second] != GROUND
                and not touch_corners(w, second, first, h, margin, False)
            ):
                return False
    return True


@inner
def _find_limits(w: WorldTables, b: int, h: float) -> bool:
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
        for r in range(3):
            k.given[c, r], k.point[c, r] = 0.0, w.now.place[b, r]
            for s in range(3):
                k.frame[c, r, s] = 0.0
        k.side[c, 0], k.side[c, 1] = b, NOBODY
        k.mover[c, 0], k.mover[c, 1] = w.movers.start.shape[0] - w.bodies.kind.shape[0] + b, -1
        G = k.G[c, 0]
        for i in range(3):
            for r in range(G.shape[1]):
                G[i, r] = way * hinge[AXIS + r] if i == 0 and r < 3 else 0.0
        keep_contact(w, c, h)
    return True


@inner
def _arm_side(w: WorldTables, arms: ArmTables, c: int, i: int, s: int) -> None:
    """First side of contact c on the piece that begins at section s of arm i."""
    k = w.contacts
    part, x, frame, G = k.part[c, 0], k.point[c], k.frame[c], k.G[c, 0]
    k.side[c, 0], k.mover[c, 0] = -1 - s, i
    base, origin = arms.base_twist[i], arms.base_place[i]
    a0, a1, a2 = x[0] - origin[0], x[1] - origin[1], x[2] - origin[2]
    g0 = base[3] + base[1] * a2 - base[2] * a1
    g1 = base[4] + base[2] * a0 - base[0] * a2
    g2 = base[5] + base[0] * a1 - base[1] * a0
    for r in range(3):
        k.given[c, r] = frame[r, 0] * g0 + frame[r, 1] * g1 + frame[r, 2] * g2
    p0, p1, R0, R1 = arms.p[s], arms.p[s + 1], arms.R[s], arms.R[s + 1]
    # The point moves with both sections; between them the curve bends, t (1 - t) / 2 of their relative turn.
    bow = 0.5 * part * (1.0 - part)
    v, turn = w.points[TANGENT], w.points[TOWARDS]
    for b in range(G.shape[1]):
        if b >= arms.first_q[i + 1] - arms.first_q[i]:
            for r in range(3):
                G[r, b] = 0.0
            continue
        for r in range(3):
            v[r] = turn[r] = 0.0
        _add_point((R0, p0), arms.columns[s, b], 1.0 - part, -1.0, x, (v, turn))
        _add_point((R1, p1), arms.columns[s + 1, b], part, 1.0, x, (v, turn))
        d0, d1, d2 = p1[0] - p0[0], p1[1] - p0[1], p1[2] - p0[2]
        v[0] += bow * (turn[1] * d2 - turn[2] * d1)
        v[1] += bow * (turn[2] * d0 - turn[0] * d2)
        v[2] += bow * (turn[0] * d1 - turn[1] * d0)
        for r in range(3):
            G[r, b] = frame[r, 0] * v[0] + frame[r, 1] * v[1] + frame[r, 2] * v[2]


@inner
def _add_point(
    frame: tuple[Array, Array], V: Array, share: float, sign: float, x: Array, to: tuple[Array, Array]
) -> None:
    """Add the motion of x on a section (R, p) with the body twist V.

    `to`: share of its velocity, sign times its spin.
    """
    R, p = frame
    v, turn = to
    w0 = R[0, 0] * V[0] + R[0, 1] * V[1] + R[0, 2] * V[2]
    w1 = R[1, 0] * V[0] + R[1, 1] * V[1] + R[1, 2] * V[2]
    w2 = R[2, 0] * V[0] + R[2, 1] * V[1] + R[2, 2] * V[2]
    a0, a1, a2 = x[0] - p[0], x[1] - p[1], x[2] - p[2]
    v[0] += share * (R[0, 0] * V[3] + R[0, 1] * V[4] + R[0, 2] * V[5] + w1 * a2 - w2 * a1)
    v[1] += share * (R[1, 0] * V[3] + R[1, 1] * V[4] + R[1, 2] * V[5] + w2 * a0 - w0 * a2)
    v[2] += share * (R[2, 0] * V[3] + R[2, 1] * V[4] + R[2, 2] * V[5] + w0 * a1 - w1 * a0)
    turn[0] += sign * w0
    turn[1] += sign * w1
    turn[2] += sign * w2


@inner
def _no_arm_contacts(arms: NoArms, w: WorldTables, h: float, margin: float) -> bool:
    return True


@inner
def _arm_contacts(arms: ArmTables, w: WorldTables, h: float, margin: float) -> bool:
    t = w.bodies
    n_b = t.kind.shape[0]
    for i in range(arms.address.shape[0]):
        for s in range(arms.first_site[i], arms.first_site[i + 1] - 1):
            p0, p1, r0, r1 = arms.p[s], arms.p[s + 1], arms.radius[s], arms.radius[s + 1]
            here = w.points[HERE]
            square = 0.0
            for r in range(3):
                w.points[P0, r], w.points[P1, r] = p0[r], p1[r]
                square += (p1[r] - p0[r]) ** 2
            chord = math.sqrt(square)
            half = 0.6 * chord + max(r0, r1) + margin
            for r in range(3):
                w.points[T0, r] = chord * arms.R[s, r, 2]
                w.points[T1, r] = chord * arms.R[s + 1, r, 2]
            for b in range(n_b):
                for r in range(3):
                    here[r] = 0.5 * (p0[r] + p1[r])
                if distance(w, b, here) > half:
                    continue
                part = nearest_part(w, b, r1 - r0)
                _slope(w, b, part, 0.0)
                radius = r0 + part * (r1 - r0)
                gap = distance(w, b, here) - radius
                if gap > margin:
                    continue
                c = open_contact(w, ((n_b + s) * n_b + b) * FEATURES, radius, gap)
                if c == MOST_CONTACTS:
                    return False
                w.contacts.part[c, 0] = part
                _arm_side(w, arms, c, i, s)
                body_side(w, c, 1, b)
                w.contacts.friction[c] = t.friction[b]
                w.contacts.restitution[c] = t.restitution[b]
                keep_contact(w, c, h)
    return True


find_arm_contacts = select_by_type(NoArms, _no_arm_contacts, _arm_contacts)
"""find_arm_contacts(arms, w, h, margin): contacts of arms with bodies; False if there are too many."""
