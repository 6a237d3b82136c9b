"""Steps of a world in time: contacts are found at the start of a step, and all moves together to its end."""

from __future__ import annotations

import math

from soro_core._box import Box, view
from soro_core._jit import inner, kernel
from soro_core.arrays import Array, Integers
from soro_core.bodies.stepping.arms import (
    arm_speed,
    locate_arms,
    move_arms,
    set_inputs,
    solve_movers,
    start_arms,
)
from soro_core.bodies.stepping.find import NEAR, find_arm_contacts, find_body_contacts
from soro_core.bodies.stepping.impulses import meet, recall_impulses, store_impulses
from soro_core.bodies.stepping.moving import body_answers, free_bodies, move_bodies, start_bodies
from soro_core.bodies.stepping.records import (
    BOX,
    CYLINDER,
    DRIVEN,
    FORCE,
    GAP,
    GROUND,
    MOST_CONTACTS,
    NOBODY,
    NORMAL,
    SIDE_A,
    SIDE_B,
    WHERE,
    BodyRows,
    WorldTables,
)
from soro_core.integrate.implicit import SMALLEST_PART
from soro_core.model.dynamics import BAD_INPUT, GOOD, finite
from soro_core.model.links.linear import assign, assign_matrix

# Codes of a world, beside those of the steppers.
CROWDED, DEEP, AWAY, FULL, OVERLAP, TURNING = 30, 31, 32, 33, 34, 36


@inner
def _assign_bodies(rows: BodyRows, k: int, to: BodyRows) -> None:
    """To <- row k."""
    for b in range(to.joint.shape[0]):
        assign(rows.place[k, b], to.place[b])
        assign_matrix(rows.rotation[k, b], to.rotation[b])
        assign(rows.twist[k, b], to.twist[b])
        assign(rows.joint[k, b], to.joint[b])


@inner
def _store_bodies(state: BodyRows, rows: BodyRows, k: int) -> None:
    """Row k <- state."""
    for b in range(state.joint.shape[0]):
        assign(state.place[b], rows.place[k, b])
        assign_matrix(state.rotation[b], rows.rotation[k, b])
        assign(state.twist[b], rows.twist[k, b])
        assign(state.joint[b], rows.joint[k, b])


@inner
def thickness(kind: int, size: Array) -> float:
    """How deep another surface may sink into a body [m]: its radius, or half of its smallest extent."""
    if kind == GROUND:
        return math.inf
    if kind == BOX:
        return float(min(size[0], size[1], size[2]))
    return float(min(size[0], size[1])) if kind == CYLINDER else float(size[0])


@inner
def _sunk(w: WorldTables, radius: Array, blame: Array) -> bool:
    """Whether surfaces have passed through each other; blame (3,) <- sides of the contact, and gap."""
    k, t = w.contacts, w.bodies
    for c in range(k.counts[0]):
        if k.side[c, 1] == NOBODY:
            continue
        limit = math.inf
        for side in range(2):
            b = k.side[c, side]
            limit = min(limit, thickness(t.kind[b], t.size[b]) if b >= 0 else radius[-1 - b])
        if k.gap[c] < -limit:
            blame[0], blame[1], blame[2] = k.side[c, 0], k.side[c, 1], k.gap[c]
            return True
    return False


@inner
def _overlap(w: WorldTables, least: float, blame: Array) -> bool:
    """Whether a gap is below the least; blame (3,) <- sides of the contact with the smallest gap, and gap."""
    k = w.contacts
    blame[2] = least
    for c in range(k.counts[0]):
        if k.side[c, 1] != NOBODY and k.gap[c] < blame[2]:
            blame[0], blame[1], blame[2] = k.side[c, 0], k.side[c, 1], k.gap[c]
    return bool(blame[2] < least)


@inner
def _find(arms: object, w: WorldTables, h: float) -> bool:
    """w.contacts <- those that may close within h, and w.movers.theta; False if there are too many."""
    k, m = w.contacts, w.movers
    k.counts[0] = 0
    fastest = arm_speed(arms, w)
    for b in range(w.bodies.kind.shape[0]):
        square, spin = 0.0, 0.0
        for r in range(3):
            square += w.now.twist[b, 3 + r] ** 2
            spin += w.now.twist[b, r] ** 2
        fastest = max(fastest, math.sqrt(square) + w.bodies.bound[b] * math.sqrt(spin))
    margin = NEAR + 4.0 * h * fastest
    if not (find_body_contacts(w, h, margin) and find_arm_contacts(arms, w, h, margin)):
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

    `boxes`: the world, its `ArmTables` or `NoArms`, and one of its arms. `given`: times (n_t,), pressures
    (n_t, 3, n_u), over each step the twists of driven bodies or the wrenches on others (n_t, n_b, 6), radii
    of the sections, and the least gap at the start: -inf where a run goes on. `stored`: contacts
    (n, CONTACT_WIDTH), behind the last of each step (n_t,), and the sides that are to blame (3,).
    """
    w, arms, like = view(boxes[0]), view(boxes[1]), view(boxes[2])
    times, pressure, inputs, radius, least = given
    q, v, z = rows
    contact, behind, blame = stored
    n_b = w.bodies.kind.shape[0]
    q0, v0, z0 = q[0].copy(), v[0].copy(), z[0].copy()
    _assign_bodies(bodies, 0, w.now)
    last_h = 0.0
    if least > -math.inf:  # a run that goes on has impulses and accelerations for its first guess
        w.contacts.counts[1] = 0
        start_arms(arms, like)
    for k in range(times.shape[0] - 1):
        row = pressure[k]
        if contact.shape[0] - behind[k] < MOST_CONTACTS:
            return k, FULL
        if not (finite(row[0]) and finite(row[1]) and finite(row[2])):
            return k, BAD_INPUT
        done, part = 0.0, 1.0
        end = (q[k + 1], v[k + 1], z[k + 1])
        while done < 1.0:
            h = part * (times[k + 1] - times[k])
            for b in range(n_b):
                if w.bodies.motion[b] == DRIVEN:
                    assign(inputs[k, b], w.now.twist[b])
            code = locate_arms(arms, like, w, (q0, v0, z0), row, (done, part))
            if code == GOOD:
                start_bodies(w)
                if not _find(arms, w, h):
                    return k, CROWDED
                if k == 0 and done == 0.0 and _overlap(w, least, blame):
                    return k, OVERLAP
                if _sunk(w, radius, blame):
                    return k, DEEP
                free_bodies(w, h, inputs[k])
                meet(w, h)
                recall_impulses(w.contacts, h / last_h if last_h > 0.0 else 1.0)
                body_answers(w, h)
                set_inputs(arms, like, w, (q0, v0, z0), row, (done, part))
                code = solve_movers(arms, like, w, h)
            if code == GOOD:
                code = move_arms(arms, like, w, h, (q0, v0, z0), end)
            if code == GOOD:
                turning = move_bodies(w, h)
                if turning >= 0:
                    blame[0], code = turning, TURNING
            if code == GOOD:
                store_impulses(w.contacts)
                last_h = h
                done += part
                assign(end[0], q0)
                assign(end[1], v0)
                assign(end[2], z0)
                for b in range(n_b):
                    assign(w.then.place[b], w.now.place[b])
                    assign_matrix(w.then.rotation[b], w.now.rotation[b])
                    assign(w.then.twist[b], w.now.twist[b])
                    assign(w.then.joint[b], w.now.joint[b])
                if part < 1.0 and done % (2.0 * part) == 0.0:
                    part *= 2.0
            else:
                part *= 0.5
                if part < SMALLEST_PART:
                    return k, code
        _store_bodies(w.now, bodies, k + 1)
        behind[k + 1] = _store_contacts(w, last_h, contact, behind[k])
        for b in range(n_b):
            square = 0.0
            for r in range(3):
                square += w.now.place[b, r] ** 2
            if not square <= w.movers.reach**2:
                blame[0] = b
                return k + 1, AWAY
    return times.shape[0] - 1, GOOD


@inner
def _store_contacts(w: WorldTables, h: float, contact: Array, n: int) -> int:
    """Append the contacts that carry to contact from row n; gives the row behind them."""
    k = w.contacts
    for c in range(k.counts[0]):
        P = k.impulse[c]
        if P[0] == 0.0 or k.side[c, 1] == NOBODY:
            continue
        row = contact[n]
        row[SIDE_A], row[SIDE_B], row[GAP] = k.side[c, 0], k.side[c, 1], k.gap[c]
        for r in range(3):
            row[WHERE + r], row[NORMAL + r] = k.point[c, r], k.frame[c, 0, r]
            total = 0.0
            for i in range(3):
                total += k.frame[c, i, r] * P[i]
            row[FORCE + r] = total / h
        n += 1
    return n
