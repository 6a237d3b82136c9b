"""Motion of bodies over a step: the velocity without contact, what an impulse adds, and the pose at the end.

The equation of motion holds at the part theta of the step: q_theta = q0 + theta h v0 + (theta h)^2 a and
q1 = q0 + h v0 + theta h^2 a, with 1/2 (the implicit midpoint) for what touches nothing and 1 (Euler's
implicit rule) for what may touch. A free body turns by the midpoint rule with Cayley's map, which keeps its
angular momentum and its energy.
"""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.bodies.stepping.records import (
    ABOUT_AXIS,
    ANGLE,
    ARM,
    AXIS,
    DAMPER,
    FREE,
    HINGED,
    POINT,
    RATE,
    SPRING,
    WorldTables,
)
from soro_core.bodies.stepping.vectors import cross, dot, subtract, turn, turn_back

_ITERATIONS = 20
# Largest change of the last one, relative.
_TURNED = 1e-12


@inner
def turn_about(axis: Array, angle: float, x: Array, y: Array) -> None:
    """y <- x (3,) turned about a unit axis [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    along = (1.0 - c) * dot(axis, x)
    x0, x1, x2 = x[0], x[1], x[2]
    y[0] = c * x0 + along * axis[0] + s * (axis[1] * x2 - axis[2] * x1)
    y[1] = c * x1 + along * axis[1] + s * (axis[2] * x0 - axis[0] * x2)
    y[2] = c * x2 + along * axis[2] + s * (axis[0] * x1 - axis[1] * x0)


@inner
def _weight_torque(w: WorldTables, b: int, angle: float, arm: Array) -> float:
    """Torque of the weight about the hinge; arm (3,) is scratch."""
    hinge, g = w.bodies.hinge[b], w.bodies.gravity
    axis = hinge[AXIS : AXIS + 3]
    turn_about(axis, angle, hinge[ARM : ARM + 3], arm)
    cross(arm, g, arm)
    return float(w.bodies.mass[b] * dot(axis, arm))


@inner
def _hinge_acceleration(w: WorldTables, b: int, part: float, given: float) -> float:
    """Acceleration of a hinged body at `part` seconds, by Newton; `movers.effective` <- its slope."""
    hinge, arm = w.bodies.hinge[b], w.points[0]
    angle, rate = w.now.joint[b, ANGLE], w.now.joint[b, RATE]
    effective = hinge[ABOUT_AXIS] + part * hinge[DAMPER] + part * part * hinge[SPRING]
    w.movers.effective[w.movers.n_arms + b] = effective
    x = 0.0
    for _ in range(_ITERATIONS):
        there = angle + part * rate + part * part * x
        torque = (
            given
            + _weight_torque(w, b, there, arm)
            - hinge[SPRING] * there
            - hinge[DAMPER] * (rate + part * x)
        )
        change = (torque - hinge[ABOUT_AXIS] * x) / effective
        x += change
        if abs(change) * part < 1e-13:
            break
    return x


@inner
def start_bodies(w: WorldTables) -> None:
    """w.movers.start <- twists of the bodies."""
    first = w.movers.n_arms
    for b in range(w.bodies.kind.shape[0]):
        for r in range(6):
            w.movers.start[first + b, r] = w.now.twist[b, r]


@inner
def free_bodies(w: WorldTables, h: float, wrench: Array) -> None:
    """w.movers.free <- twists of the bodies at the end of the step without contact; those driven are given.

    `wrench` (n_b, 6): torques and forces on the others.
    """
    t, v = w.bodies, w.movers.free
    first = w.movers.n_arms
    for b in range(t.kind.shape[0]):
        row, R = v[first + b], w.now.rotation[b]
        for r in range(6):
            row[r] = w.now.twist[b, r]
        if t.motion[b] == FREE:
            for r in range(3):
                row[3 + r] += h * (t.gravity[r] + wrench[b, 3 + r] / t.mass[b])
            for s in range(3):
                torque = R[0, s] * wrench[b, 0] + R[1, s] * wrench[b, 1] + R[2, s] * wrench[b, 2]
                for r in range(3):
                    row[r] += h * R[r, s] * torque / t.inertia[b, s]
        elif t.motion[b] == HINGED:
            part = w.movers.theta[first + b] * h
            _twist_of_rate(w, b, 1.0, w.now.place[b], row)
            torque = dot(row, wrench[b]) + dot(row[3:], wrench[b, 3:])
            rate = w.now.joint[b, RATE] + h * _hinge_acceleration(w, b, part, torque)
            _twist_of_rate(w, b, rate, w.now.place[b], row)


@inner
def _twist_of_rate(w: WorldTables, b: int, rate: float, place: Array, row: Array) -> None:
    """Row <- twist of a hinged body about its centre at a place."""
    hinge, arm = w.bodies.hinge[b], w.points[2]
    for r in range(3):
        row[r] = rate * hinge[AXIS + r]
    subtract(place, hinge[POINT:], arm)
    cross(row, arm, row[3:])


@inner
def body_answers(w: WorldTables, h: float) -> None:
    """k.Y of the sides that are bodies."""
    k, t = w.contacts, w.bodies
    first = w.movers.n_arms
    for c in range(k.counts[0]):
        for side in range(2):
            b = k.mover[c, side] - first
            if b < 0:
                continue
            R = w.now.rotation[b]
            for i in range(3):
                G, Y = k.G[c, side, i], k.Y[c, side, i]
                for r in range(Y.shape[0]):
                    Y[r] = 0.0
                if t.motion[b] == FREE:
                    for r in range(3):
                        Y[3 + r] = G[3 + r] / t.mass[b]
                    for s in range(3):
                        spin = (R[0, s] * G[0] + R[1, s] * G[1] + R[2, s] * G[2]) / t.inertia[b, s]
                        for r in range(3):
                            Y[r] += R[r, s] * spin
                elif t.motion[b] == HINGED:
                    unit = w.points[0:2].reshape(6)
                    _twist_of_rate(w, b, 1.0, w.now.place[b], unit)
                    along = dot(unit, G) + dot(unit[3:], G[3:])
                    for r in range(6):
                        Y[r] = unit[r] * along / w.movers.effective[first + b]


@inner
def move_bodies(w: WorldTables, h: float) -> int:
    """w.then <- poses and twists at the end of the step, from the velocities in w.movers.end.

    It gives the body that turns too far within the step, or -1.
    """
    t, now, then = w.bodies, w.now, w.then
    first = w.movers.n_arms
    for b in range(t.kind.shape[0]):
        v, theta = w.movers.end[first + b], w.movers.theta[first + b]
        for r in range(6):
            then.twist[b, r] = v[r]
        if t.motion[b] == FREE:
            for r in range(3):
                before = now.twist[b, 3 + r]
                then.place[b, r] = now.place[b, r] + h * (before + theta * (v[3 + r] - before))
            if not _turn_freely(w, b, h):
                return b
        elif t.motion[b] == HINGED:
            hinge = t.hinge[b]
            axis = hinge[AXIS : AXIS + 3]
            before = now.joint[b, RATE]
            rate = dot(axis, v)
            angle = now.joint[b, ANGLE] + h * (before + theta * (rate - before))
            then.joint[b, ANGLE], then.joint[b, RATE] = angle, rate
            place_hinged(w, b, angle)
            _twist_of_rate(w, b, rate, then.place[b], then.twist[b])
        else:
            spin = math.sqrt(dot(v, v))
            axis = w.points[0]
            for r in range(3):
                then.place[b, r] = now.place[b, r] + h * v[3 + r]
                axis[r] = v[r] / spin if spin > 0.0 else 0.0
            _turn_columns(w, axis, h * spin, now.rotation[b], then.rotation[b])
    return -1


@inner
def place_hinged(w: WorldTables, b: int, angle: float) -> None:
    """w.then.place, .rotation <- pose of a hinged body at an angle."""
    hinge, column = w.bodies.hinge[b], w.points[1]
    axis = hinge[AXIS : AXIS + 3]
    turn_about(axis, angle, hinge[ARM : ARM + 3], column)
    for r in range(3):
        w.then.place[b, r] = hinge[POINT + r] + column[r]
    _turn_columns(w, axis, angle, w.bodies.at_zero[b], w.then.rotation[b])


@inner
def _turn_columns(w: WorldTables, axis: Array, angle: float, R: Array, turned: Array) -> None:
    """Turned <- R turned about an axis."""
    before, after = w.points[1], w.points[2]
    for s in range(3):
        for r in range(3):
            before[r] = R[r, s]
        turn_about(axis, angle, before, after)
        for r in range(3):
            turned[r, s] = after[r]


@inner
def _turn_freely(w: WorldTables, b: int, h: float) -> bool:
    """Rotation and spin at the end: I (w1 - w0) + h wm x I wm = 0 in the body, R1 = R0 cay(h wm).

    False if the middle is not found.
    """
    inertia, R, R1, spin = w.bodies.inertia[b], w.now.rotation[b], w.then.rotation[b], w.then.twist[b]
    a, m = w.points[0], w.points[1]
    turn_back(R, spin, a)
    turn_back(R, spin, m)
    moved = 0.0
    for _ in range(_ITERATIONS):
        # The middle by fixed point iteration: contracts by h |w|.
        m0 = a[0] - 0.5 * h * (inertia[2] - inertia[1]) / inertia[0] * m[1] * m[2]
        m1 = a[1] - 0.5 * h * (inertia[0] - inertia[2]) / inertia[1] * m[2] * m[0]
        m2 = a[2] - 0.5 * h * (inertia[1] - inertia[0]) / inertia[2] * m[0] * m[1]
        moved = abs(m0 - m[0]) + abs(m1 - m[1]) + abs(m2 - m[2])
        m[0], m[1], m[2] = m0, m1, m2
        if moved <= 1e-15 * (abs(m0) + abs(m1) + abs(m2)):
            break
    total = abs(m[0]) + abs(m[1]) + abs(m[2])
    if not moved <= _TURNED * total < math.inf:  # infinite ones compare as equal
        return False
    x, y, z = 0.5 * h * m[0], 0.5 * h * m[1], 0.5 * h * m[2]
    scale = 1.0 / (1.0 + x * x + y * y + z * z)
    for r in range(3):
        r0, r1, r2 = R[r, 0], R[r, 1], R[r, 2]
        R1[r, 0] = scale * (
            r0 * (1.0 + x * x - y * y - z * z) + r1 * 2.0 * (x * y + z) + r2 * 2.0 * (x * z - y)
        )
        R1[r, 1] = scale * (
            r0 * 2.0 * (x * y - z) + r1 * (1.0 - x * x + y * y - z * z) + r2 * 2.0 * (y * z + x)
        )
        R1[r, 2] = scale * (
            r0 * 2.0 * (x * z + y) + r1 * 2.0 * (y * z - x) + r2 * (1.0 - x * x - y * y + z * z)
        )
    # The spin turns with the body, so that the angular momentum stays.
    for s in range(3):
        a[s] = 2.0 * m[s] - a[s]
    turn(R1, a, spin)
    return True
