"""Impulses of all contacts of a step: Signorini's condition and Coulomb's cone, by projected Gauss-Seidel.

With u the speed at the end of the step and P the impulse on the first side, along the normal n:
0 <= u_n - bias + soft P_n  complementary to  P_n >= 0, and |P_t| <= mu P_n with u_t against P_t where it
slips and 0 where it does not. The spring k of a contact, with its damper c, acts at the end of the step:
P = -h (k (gap + h u_n) + c u_n) is bias = -gap / (h + c/k) and soft = 1 / (k h (h + c/k)). Friction is not
relaxed: a point that sticks has no speed, whatever it carries.

Sides that are held together have that spring and damper in all directions, and push as they pull.
"""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.bodies.stepping.records import HELD, ContactTables, WorldTables
from soro_core.bodies.stepping.vectors import cross, dot, subtract
from soro_core.model.links.linear import assign

# Largest change of a speed [m/s] in the last sweep; what passes after all sweeps, in which forces that no
# motion tells apart (four feet on a table) drift.
TOLERANCE, LET_PASS = 1e-9, 1e-7
MOST_SWEEPS = 1001  # the last one brings what a leap has found back to the cones
# Sweeps from one leap to the next.
LEAP = 5
# Slower approach does not bounce, or is no impact [m/s].
SLOWEST_BOUNCE, SLOWEST_IMPACT = 0.01, 1e-3
# Deeper surfaces [m] have met before.
CLOSED = 1e-7
# Speed per impulse [1/kg] of sides that hardly anything moves.
_LEAST = 1e-9


@inner
def recall_impulses(k: ContactTables, ratio: float) -> None:
    """First guess of each impulse: that of the same surfaces in the last step, for a step `ratio` as long."""
    for c in range(k.counts[0]):
        for r in range(3):
            k.impulse[c, r] = 0.0
        for o in range(k.counts[1]):
            if k.old_key[o] == k.key[c]:
                for r in range(3):
                    k.impulse[c, r] = ratio * k.old_impulse[o, r]
                break


@inner
def store_impulses(k: ContactTables) -> None:
    """Keep the impulses for `recall_impulses`."""
    k.counts[1] = k.counts[0]
    for c in range(k.counts[0]):
        k.old_key[c] = k.key[c]
        for r in range(3):
            k.old_impulse[c, r] = k.impulse[c, r]


@inner
def meet(w: WorldTables, h: float) -> None:
    """k.bias <- least normal speed at the end of the step, from that at its start, and k.hard.

    What comes near fast is stopped at the surface within the step, or bounces; k.soft stays 0 for it.
    """
    k = w.contacts
    for c in range(k.counts[0]):
        if k.friction[c] == HELD:
            k.hard[c] = False
            continue
        approach = -k.bias[c]
        # What has just closed is stopped, not pushed out within a step, however short that is.
        k.bias[c] = -max(k.gap[c], 0.0) / h
        k.hard[c] = approach > SLOWEST_IMPACT and -CLOSED < k.gap[c] < h * approach
        if k.hard[c] and k.restitution[c] > 0.0 and approach > SLOWEST_BOUNCE:
            # With what gravity takes within the step, so that a bounce gains no energy.
            given = contact_speed(k, c, 0, w.movers.free) - contact_speed(k, c, 0, w.movers.start)
            k.bias[c] = max(k.bias[c], k.restitution[c] * approach + given)


@inner
def set_blocks(k: ContactTables, stiffness: float, h: float) -> None:
    """k.D <- G Y of each contact; k.soft and k.bias of those that rest."""
    for c in range(k.counts[0]):
        for i in range(3):
            for j in range(3):
                total = 0.0
                for side in range(2):
                    if k.mover[c, side] >= 0:
                        for b in range(k.G.shape[3]):
                            total += k.G[c, side, i, b] * k.Y[c, side, j, b]
                k.D[c, i, j] = total
        k.soft[c] = 0.0
        if k.friction[c] == HELD:
            longer = h + 2.0 / math.sqrt(stiffness * max(k.D[c, 0, 0], k.D[c, 1, 1], k.D[c, 2, 2], _LEAST))
            k.soft[c], k.bias[c] = 1.0 / (stiffness * h * longer), 1.0 / longer
        elif not k.hard[c] and k.D[c, 0, 0] > 0.0:
            # Critical damping of the mass that the contact sees.
            longer = h + 2.0 / math.sqrt(stiffness * k.D[c, 0, 0])
            k.soft[c] = 1.0 / (stiffness * h * longer)
            k.bias[c] = -k.gap[c] / (longer if k.gap[c] < 0.0 else h)


@inner
def push(k: ContactTables, c: int, change: Array, v: Array) -> None:
    """Add the velocities by a change of the impulse of contact c."""
    for side in range(2):
        m = k.mover[c, side]
        if m >= 0:
            for i in range(3):
                if change[i] != 0.0:
                    for b in range(v.shape[1]):
                        v[m, b] += k.Y[c, side, i, b] * change[i]


@inner
def contact_speed(k: ContactTables, c: int, i: int, v: Array) -> float:
    """Speed along axis i of the frame of contact c."""
    total = float(k.given[c, i])
    for side in range(2):
        m = k.mover[c, side]
        if m >= 0:
            for b in range(v.shape[1]):
                total += k.G[c, side, i, b] * v[m, b]
    return total


@inner
def solve_impulses(w: WorldTables) -> bool:
    """w.movers.end += what impulses add, w.contacts.impulse from its guess; False if it does not settle."""
    k, v = w.contacts, w.movers.end
    n = k.counts[0]
    for c in range(n):
        push(k, c, k.impulse[c], v)
    change = w.points[0]
    worst, least = 0.0, math.inf
    for sweep in range(MOST_SWEEPS):
        worst = 0.0
        for c in range(n):
            assign(k.impulse[c], k.before[c])
            moved = _solve_one(k, c, v, change)
            worst = moved if not moved <= worst else worst  # what is not finite stays
        if worst < TOLERANCE:
            return True
        if not math.isfinite(worst):
            return False
        if sweep % LEAP > LEAP - 3:
            least = _leap(k, sweep % LEAP == LEAP - 1, v, change, least)
    return worst < LET_PASS


@inner
def _leap(k: ContactTables, leaps: bool, v: Array, change: Array, least: float) -> float:
    """Take a sweep's change of the impulses, and with that of the sweep before it all that is left.

    Where arms in contact are soft one way and stiff another, sweeps shrink what is left by a factor near 1:
    then the sum of the series (Aitken) saves thousands of them. Where the last leap has not brought the
    changes below `least`, those before it, sweeps go on alone: no cone bounds impulses that hold, and leaps
    that lead away would grow without end. Gives the least square of changes from which it has leapt.
    """
    along, square = 0.0, 0.0
    for c in range(k.counts[0]):
        subtract(k.impulse[c], k.before[c], k.before[c])
        along += dot(k.before[c], k.step[c])
        square += dot(k.step[c], k.step[c])
        assign(k.before[c], k.step[c])
    if leaps and 0.0 < along < square < least:
        least = square
        for c in range(k.counts[0]):
            for r in range(3):
                change[r] = k.step[c, r] * along / (square - along)
                k.impulse[c, r] += change[r]
            push(k, c, change, v)
    return least


@inner
def _solve_one(k: ContactTables, c: int, v: Array, change: Array) -> float:
    """Update the impulse of one contact; gives the change of its speed."""
    if k.friction[c] == HELD:
        return _solve_held(k, c, v, change)
    D, P, soft = k.D[c], k.impulse[c], k.soft[c]
    if not D[0, 0] > 0.0:
        return 0.0
    moved = 0.0
    before = P[0]
    miss = contact_speed(k, c, 0, v) - k.bias[c] + soft * before
    P[0] = max(0.0, before - miss / (D[0, 0] + soft))
    change[0], change[1], change[2] = P[0] - before, 0.0, 0.0
    if change[0] != 0.0:
        moved = abs(change[0]) * (D[0, 0] + soft)
        push(k, c, change, v)
    limit = k.friction[c] * P[0]
    old1, old2 = P[1], P[2]
    if limit == 0.0:
        P[1] = P[2] = 0.0
    else:
        u1, u2 = contact_speed(k, c, 1, v), contact_speed(k, c, 2, v)
        a, b, d = D[1, 1], 0.5 * (D[1, 2] + D[2, 1]), D[2, 2]
        det = a * d - b * b
        P[1] = old1 - (d * u1 - b * u2) / det
        P[2] = old2 - (a * u2 - b * u1) / det
        if not P[1] * P[1] + P[2] * P[2] <= limit * limit:
            # One factor for both directions: only then does friction end up against the speed.
            largest = 0.5 * (a + d) + math.sqrt(0.25 * (a - d) * (a - d) + b * b)
            P[1], P[2] = old1 - u1 / largest, old2 - u2 / largest
            size = math.sqrt(P[1] * P[1] + P[2] * P[2])
            if size > limit:
                P[1] *= limit / size
                P[2] *= limit / size
    change[0], change[1], change[2] = 0.0, P[1] - old1, P[2] - old2
    if change[1] != 0.0 or change[2] != 0.0:
        moved = max(moved, (abs(change[1]) + abs(change[2])) * max(D[1, 1], D[2, 2]))
        push(k, c, change, v)
    return moved


@inner
def _solve_held(k: ContactTables, c: int, v: Array, change: Array) -> float:
    """Update the impulse between sides that are held together; gives the change of their speed."""
    D, P, soft, A = k.D[c], k.impulse[c], k.soft[c], k.block
    miss = A[6]
    for i in range(3):
        miss[i] = -(contact_speed(k, c, i, v) + k.bias[c] * k.apart[c, i] + soft * P[i])
        for j in range(3):
            A[i, j] = D[i, j] + (soft if i == j else 0.0)
    # By Cramer's rule, with the products of its rows.
    cross(A[1], A[2], A[3])
    cross(A[2], A[0], A[4])
    cross(A[0], A[1], A[5])
    det, moved = dot(A[0], A[3]), 0.0
    for r in range(3):
        change[r] = (miss[0] * A[3, r] + miss[1] * A[4, r] + miss[2] * A[5, r]) / det
        P[r] += change[r]
        moved += abs(change[r]) * A[r, r]
    push(k, c, change, v)
    return moved
