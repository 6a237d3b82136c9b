"""Law of one point against one obstacle: compliant normal force, regularised Coulomb friction.

With the depth d, the normal n out of the obstacle and the velocity u of the point that touches, N = k d
max(0, 1 - c n.u) ([HC75] with exponent 1): continuous, zero where the contact opens, never pulling. With
the slip v = u - n n.u, friction is -mu N v / sqrt(|v|^2 + v_s^2): smooth through rest and dissipative
always; under a load below its limit the point creeps at less than some v_s. A row of obstacles: point or
centre, normal, k, c, mu, v_s, radius (below 0: a plane), velocity of the obstacle, which u is relative to.
"""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.records import TangentFactors


@inner
def gap(obstacle: Array, x: Array, n: Array) -> float:
    """Distance of the point x from the surface, negative inside; n <- the normal there."""
    if obstacle[10] < 0.0:
        height = 0.0
        for r in range(3):
            n[r] = obstacle[3 + r]
            height += n[r] * (x[r] - obstacle[r])
        return height
    square = 0.0
    for r in range(3):
        n[r] = x[r] - obstacle[r]
        square += n[r] * n[r]
    distance = math.sqrt(square)
    if distance > 0.0:
        for r in range(3):
            n[r] /= distance
    else:
        n[0], n[1], n[2] = 0.0, 0.0, 1.0  # in the centre, any direction leads out
    return distance - float(obstacle[10])


@inner
def normal_force(obstacle: Array, depth: float, closing: float) -> float:
    """N >= 0 at a depth above 0; `closing` is the speed of sinking in."""
    force: float = obstacle[6] * depth * max(0.0, 1.0 + obstacle[7] * closing)
    return force


@inner
def add_force(obstacle: Array, depth: float, n: Array, u: Array, F: Array) -> None:
    """F += force on the arm, in the world."""
    speed = u[0] * n[0] + u[1] * n[1] + u[2] * n[2]
    N = normal_force(obstacle, depth, -speed)
    v0, v1, v2 = u[0] - speed * n[0], u[1] - speed * n[1], u[2] - speed * n[2]
    share = obstacle[8] * N / math.sqrt(v0 * v0 + v1 * v1 + v2 * v2 + obstacle[9] * obstacle[9])
    F[0] += N * n[0] - share * v0
    F[1] += N * n[1] - share * v1
    F[2] += N * n[2] - share * v2


@inner
def add_tangent(obstacle: Array, depth: float, n: Array, u: Array, factors: TangentFactors, K: Array) -> None:
    """K += -(by_q dF/dx + by_v dF/du), symmetric and positive semi-definite, (3, 3).

    Left out are the turn of the normal and how friction follows the normal force, which are not. Where slip
    has outgrown v_s, the derivative of friction is nearly zero along v; with `secant` = 1 its place is
    taken by the ratio of force to velocity, with which one linear step never turns a slip around.
    """
    by_q, by_v, secant = factors
    speed = u[0] * n[0] + u[1] * n[1] + u[2] * n[2]
    N = normal_force(obstacle, depth, -speed)
    stiffness = obstacle[6] * max(0.0, 1.0 - obstacle[7] * speed)
    damping = obstacle[6] * obstacle[7] * depth if N > 0.0 else 0.0
    v0, v1, v2 = u[0] - speed * n[0], u[1] - speed * n[1], u[2] - speed * n[2]
    inverse = 1.0 / math.sqrt(v0 * v0 + v1 * v1 + v2 * v2 + obstacle[9] * obstacle[9])
    ratio = by_v * obstacle[8] * N * inverse
    along = by_q * stiffness + by_v * damping - ratio
    less = ratio * (1.0 - secant) * inverse * inverse
    v = (v0, v1, v2)
    for r in range(3):
        K[r, r] += ratio
        for c in range(3):
            K[r, c] += along * n[r] * n[c] - less * v[r] * v[c]


@inner
def stored_energy(obstacle: Array, depth: float) -> float:
    """Energy of the normal force without its damping [J]."""
    energy: float = 0.5 * obstacle[6] * depth * depth
    return energy
