"""Contacts of a step: one is opened at a place, gets its two sides, and stays if it may close.

A point at which an arm holds a body is a contact that pulls as well, and lets nothing slip: one of them is a
ball joint, three that are not on a line are a weld.
"""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.bodies.stepping.records import (
    ALONG,
    HELD,
    HERE,
    MOST_CONTACTS,
    OUT,
    THERE,
    TOWARDS,
    ArmTables,
    WorldTables,
)
from soro_core.bodies.stepping.surfaces import NEAR
from soro_core.bodies.stepping.vectors import cross, dot, subtract, turn
from soro_core.model.links.linear import clear_matrix


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
    cross(n, frame[1], frame[2])


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
def keep_contact(w: WorldTables, c: int, h: float) -> None:
    """Count contact c if it may close within the step; the speed of its sides decides."""
    k, v = w.contacts, w.movers.start
    speed = k.given[c, 0]
    for side in range(2):
        if k.mover[c, side] >= 0:
            row = v[k.mover[c, side]]
            for j in range(row.shape[0]):
                speed += k.G[c, side, 0, j] * row[j]
    if k.gap[c] < NEAR + 2.0 * h * max(-speed, 0.0):
        k.counts[0] = c + 1
        k.bias[c] = speed


@inner
def body_side(w: WorldTables, c: int, side: int, b: int) -> None:
    """Side of contact c at its point of body b."""
    k, arm = w.contacts, w.points[TOWARDS]
    sign = 1.0 if side == 0 else -1.0
    k.side[c, side], k.mover[c, side] = b, w.movers.n_arms + b
    subtract(k.point[c], w.now.place[b], arm)
    for i in range(3):
        G, f = k.G[c, side, i], k.frame[c, i]
        cross(arm, f, G)
        for r in range(3):
            G[r] *= sign
            G[3 + r] = sign * f[r]
        for r in range(6, G.shape[0]):
            G[r] = 0.0


@inner
def arm_side(w: WorldTables, arms: ArmTables, c: int, side: int, i: int, s: int) -> None:
    """Side of contact c at its part of the piece that begins at section s of arm i.

    Where both sides move one mover (an arm that touches itself, or fingers of a hand), the second is added to
    the first.
    """
    k, m, carrier = w.contacts, arms.mover[i], arms.mounts.carrier[i]
    k.side[c, side] = -1 - s
    at, is_added = side, False
    if side == 1 and k.mover[c, 0] == m:
        at, is_added = 0, True
        k.mover[c, 1] = -1
    k.mover[c, at] = m
    sign = 1.0 if side == 0 else -1.0
    part, x, frame, G = k.part[c, side], k.point[c], k.frame[c], k.G[c, at]
    v, turns, arm = w.points[ALONG], w.points[TOWARDS], w.points[HERE]
    rides = i if carrier < 0 else carrier
    subtract(x, arms.base_place[rides], arm)
    base = arms.base_twist[rides]
    cross(base, arm, v)
    for r in range(3):
        k.given[c, r] += sign * (dot(frame[r], v) + dot(frame[r], base[3:]))
    if not is_added:
        clear_matrix(G)
    first, last = arms.p[s], arms.p[s + 1]
    # The point moves with both sections; between them the curve bends, t (1 - t) / 2 of their relative turn.
    bow = 0.5 * part * (1.0 - part)
    for b in range(arms.first_q[i + 1] - arms.first_q[i]):
        for r in range(3):
            v[r] = turns[r] = 0.0
        _add_point(w, (arms.R[s], first), arms.columns[s, b], (1.0 - part, -1.0), x)
        _add_point(w, (arms.R[s + 1], last), arms.columns[s + 1, b], (part, 1.0), x)
        subtract(last, first, arm)
        cross(turns, arm, arm)
        for r in range(3):
            v[r] += bow * arm[r]
        for r in range(3):
            G[r, arms.column[i] + b] += sign * dot(frame[r], v)
    if carrier < 0:
        return
    # With the tip of its carrier the whole arm moves.
    tip = arms.first_site[carrier + 1] - 1
    for b in range(arms.first_q[carrier + 1] - arms.first_q[carrier]):
        for r in range(3):
            v[r] = turns[r] = 0.0
        _add_point(w, (arms.R[tip], arms.p[tip]), arms.columns[tip, b], (1.0, 0.0), x)
        for r in range(3):
            G[r, arms.column[carrier] + b] += sign * dot(frame[r], v)


@inner
def _add_point(
    w: WorldTables, frame: tuple[Array, Array], V: Array, share: tuple[float, float], x: Array
) -> None:
    """Add the motion of x on a section (R, p) with the body twist V.

    w.points[ALONG], [TOWARDS] += the shares of its velocity and of its spin.
    """
    R, p = frame
    v, turns, spin, speed = w.points[ALONG], w.points[TOWARDS], w.points[0], w.points[1]
    turn(R, V, spin)
    turn(R, V[3:], speed)
    arm = w.points[2]
    subtract(x, p, arm)
    cross(spin, arm, arm)
    for r in range(3):
        v[r] += share[0] * (speed[r] + arm[r])
        turns[r] += share[1] * spin[r]


@inner
def find_joints(arms: ArmTables, w: WorldTables) -> bool:
    """Write the contacts of all joints; False if there are more than `MOST_CONTACTS`."""
    k, n_b = w.contacts, w.bodies.kind.shape[0]
    on_arm, on_body = w.points[HERE], w.points[THERE]
    for j in range(arms.joint_body.shape[0]):
        i, s, b = arms.joint_arm[j], arms.joint_section[j], arms.joint_body[j]
        c = int(k.counts[0])
        if c == MOST_CONTACTS:
            return False
        turn(arms.R[s], arms.joint_offset[j, 0], on_arm)
        turn(w.now.rotation[b], arms.joint_offset[j, 1], on_body)
        for r in range(3):
            on_arm[r] += arms.p[s, r]
            on_body[r] += w.now.place[b, r]
            k.apart[c, r] = on_arm[r] - on_body[r]
            k.point[c, r] = 0.5 * (on_arm[r] + on_body[r])
            k.given[c, r] = 0.0
            for axis in range(3):
                k.frame[c, r, axis] = 1.0 if r == axis else 0.0
        k.key[c] = -1 - 2 * n_b - j  # behind those of hinges
        k.gap[c] = k.bias[c] = k.restitution[c] = 0.0
        k.friction[c] = HELD
        # The piece that begins there, or at the end of the arm the last one.
        ends = s + 1 == arms.first_site[i + 1]
        k.part[c, 0] = 1.0 if ends else 0.0
        arm_side(w, arms, c, 0, i, s - 1 if ends else s)
        body_side(w, c, 1, b)
        k.counts[0] = c + 1
    return True


@inner
def is_joined(arms: ArmTables, i: int, b: int) -> bool:
    """Whether body b is held on arm i or its carrier: they do not touch besides."""
    found = False
    for j in range(arms.joint_body.shape[0]):
        holds = arms.joint_arm[j] == i or arms.joint_arm[j] == arms.mounts.carrier[i]
        found = found or (holds and arms.joint_body[j] == b)
    return found
