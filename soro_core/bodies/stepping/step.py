"""Steps of a world in time: contacts are found at the start of a step, and all moves together to its end."""

from __future__ import annotations

import math

from soro_core._box import Box, view
from soro_core._jit import inner, kernel
from soro_core.arrays import Array, Integers
from soro_core.bodies.stepping.arms import arm_speed, locate_arms, solve_movers
from soro_core.bodies.stepping.contacts import find_joints
from soro_core.bodies.stepping.impulses import meet, recall_impulses, store_impulses
from soro_core.bodies.stepping.moving import body_answers, free_bodies, move_bodies, start_bodies
from soro_core.bodies.stepping.pairs import find_body_contacts
from soro_core.bodies.stepping.pieces import find_arm_contacts
from soro_core.bodies.stepping.records import (
    BOX,
    CYLINDER,
    DRIVEN,
    FORCE,
    GAP,
    GROUND,
    HELD,
    MOST_CONTACTS,
    NORMAL,
    SIDE_A,
    SIDE_B,
    WHERE,
    ArmTables,
    BodyRows,
    StepPart,
    WorldTables,
)
from soro_core.bodies.stepping.surfaces import NEAR
from soro_core.bodies.stepping.vectors import dot
from soro_core.integrate.implicit import SMALLEST_PART
from soro_core.model.dynamics import BAD_INPUT, GOOD, finite
from soro_core.model.links.linear import assign, assign_matrix

# Codes of a world, beside those of the steppers.
CROWDED, DEEP, AWAY, FULL, OVERLAP, TURNING = 30, 31, 32, 33, 34, 36


@inner
def _row(rows: BodyRows, k: int) -> BodyRows:
    """Row k of states of bodies."""
    return BodyRows(rows.place[k], rows.rotation[k], rows.twist[k], rows.joint[k])


@inner
def _copy(source: BodyRows, to: BodyRows) -> None:
    """To <- source."""
    assign_matrix(source.place, to.place)
    assign_matrix(source.twist, to.twist)
    assign_matrix(source.joint, to.joint)
    for b in range(to.joint.shape[0]):
        assign_matrix(source.rotation[b], to.rotation[b])


@inner
def thickness(kind: int, size: Array) -> float:
    """How deep another surface may sink into a body [m]: radius, half of the least extent, way to a face."""
    if kind == GROUND:
        return math.inf
    if kind == BOX:
        return float(min(size[0], size[1], size[2]))
    return float(min(size[0], size[1])) if kind == CYLINDER else float(size[0])


@inner
def _too_deep(w: WorldTables, radius: Array, most: float, blame: Array) -> bool:
    """Whether surfaces are deeper in each other than `most`, or than the thinner one is thick.

    blame (3,) <- the sides of the contact that is the deepest of them, and its gap.
    """
    k, t = w.contacts, w.bodies
    blame[2] = 0.0
    for c in range(k.counts[0]):
        limit = most
        for side in range(2):
            b = k.side[c, side]
            limit = min(limit, thickness(t.kind[b], t.size[b]) if b >= 0 else radius[-1 - b])
        # Contacts of a hinge with its limits have one body on both sides.
        if k.side[c, 0] != k.side[c, 1] and k.gap[c] < min(-limit, blame[2]):
            blame[0], blame[1], blame[2] = k.side[c, 0], k.side[c, 1], k.gap[c]
    return bool(blame[2] < 0.0)


@inner
def _find(arms: ArmTables, w: WorldTables, h: float) -> bool:
    """w.contacts <- those that may close within h, and w.movers.theta; False if there are too many."""
    k, m = w.contacts, w.movers
    k.counts[0] = 0
    fastest = arm_speed(arms, w)
    among_arms = NEAR + 4.0 * h * fastest
    for b in range(w.bodies.kind.shape[0]):
        spin, speed = w.now.twist[b], w.now.twist[b, 3:]
        rim = w.bodies.bound[b] * math.sqrt(dot(spin, spin))
        fastest = max(fastest, rim + math.sqrt(dot(speed, speed)))
    margin = NEAR + 4.0 * h * fastest
    if not (find_joints(arms, w) and find_body_contacts(w, h, margin)):
        return False
    if not find_arm_contacts(arms, w, h, margin, among_arms):
        return False
    for i in range(m.theta.shape[0]):
        m.theta[i] = 0.5
    for c in range(k.counts[0]):
        for side in range(2):
            if k.mover[c, side] >= 0:
                m.theta[k.mover[c, side]] = 1.0
    return True


@kernel
def world_run(
    boxes: tuple[Box, Box, Box],
    given: tuple[Array, Array, Array, Array, float],
    rows: tuple[Array, Array, Array],
    bodies: BodyRows,
    stored: tuple[Array, Integers, Array],
) -> tuple[int, int]:
    """Fill rows of arms q, v, z (n_t, ...) and of bodies from their first ones; gives (last good row, code).

    `boxes`: the world, its `ArmTables`, and one of its arms or `NoArm`. `given`: times (n_t,), pressures
    (n_t, 3, n_u), over each step the twists of driven bodies or the wrenches on others (n_t, n_b, 6), radii
    of the sections, and the least gap at the start: -inf where a run goes on. `stored`: contacts
    (n, CONTACT_WIDTH), behind the last of each step (n_t,), and the sides that are to blame (3,).
    """
    w, arms, like = view(boxes[0]), view(boxes[1]), view(boxes[2])
    times, pressure, inputs, radius, least = given
    q, v, z = rows
    contact, behind, blame = stored
    n_b = w.bodies.kind.shape[0]
    now = (q[0].copy(), v[0].copy(), z[0].copy())
    _copy(_row(bodies, 0), w.now)
    last_h = 0.0
    for k in range(times.shape[0] - 1):
        row = pressure[k]
        if contact.shape[0] - behind[k] < MOST_CONTACTS:
            return k, FULL
        if not (finite(row[0]) and finite(row[1]) and finite(row[2])):
            return k, BAD_INPUT
        done, part = 0.0, 1.0
        then = (q[k + 1], v[k + 1], z[k + 1])
        while done < 1.0:
            h = part * (times[k + 1] - times[k])
            for b in range(n_b):
                if w.bodies.motion[b] == DRIVEN:
                    assign(inputs[k, b], w.now.twist[b])
            span = StepPart(h, done, part, row)
            code = locate_arms(like, arms, w, span, now)
            if code == GOOD:
                start_bodies(w)
                if not _find(arms, w, h):
                    return k, CROWDED
                starts = k == 0 and done == 0.0 and least > -math.inf
                if _too_deep(w, radius, -least if starts else math.inf, blame):
                    return k, OVERLAP if starts else DEEP
                free_bodies(w, h, inputs[k])
                meet(w, h)
                recall_impulses(w.contacts, h / last_h if last_h > 0.0 else 1.0)
                body_answers(w, h)
                code = solve_movers(like, arms, w, span, now, then)
            if code == GOOD:
                turning = move_bodies(w, h)
                if turning >= 0:
                    blame[0], code = turning, TURNING
            if code == GOOD:
                store_impulses(w.contacts)
                last_h = h
                done += part
                assign(then[0], now[0])
                assign(then[1], now[1])
                assign(then[2], now[2])
                _copy(w.then, w.now)
                if part < 1.0 and done % (2.0 * part) == 0.0:
                    part *= 2.0
            else:
                part *= 0.5
                if part < SMALLEST_PART:
                    return k, code
        _copy(w.now, _row(bodies, k + 1))
        behind[k + 1] = _store_contacts(w, last_h, contact, behind[k])
        for b in range(n_b):
            if not dot(w.now.place[b], w.now.place[b]) <= w.movers.reach**2:
                blame[0] = b
                return k + 1, AWAY
    return times.shape[0] - 1, GOOD


@inner
def _store_contacts(w: WorldTables, h: float, contact: Array, n: int) -> int:
    """Append the contacts that carry to contact from row n; gives the row behind them."""
    k = w.contacts
    for c in range(k.counts[0]):
        P = k.impulse[c]
        is_held = k.friction[c] == HELD
        if (P[0] == 0.0 and not is_held) or k.side[c, 0] == k.side[c, 1]:
            continue
        row = contact[n]
        row[SIDE_A], row[SIDE_B], row[GAP] = k.side[c, 0], k.side[c, 1], k.gap[c]
        for r in range(3):
            # A joint has no normal, and no part in sums of normal forces.
            row[WHERE + r], row[NORMAL + r] = k.point[c, r], 0.0 if is_held else k.frame[c, 0, r]
            row[FORCE + r] = dot(k.frame[c, :, r], P) / h
        n += 1
    return n
