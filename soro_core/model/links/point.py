"""A point that moves with the frame b of a link's base: its motion, and forces on it as wrenches in b."""

from __future__ import annotations

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.links.linear import clear


@inner
def move_point(R: Array, p: Array, c: Array, V: Array, x: Array, u: Array) -> None:
    """x, u <- position and velocity in the world of the point c of the frame b = (R, p) with the twist V."""
    u0 = V[3] + V[1] * c[2] - V[2] * c[1]
    u1 = V[4] + V[2] * c[0] - V[0] * c[2]
    u2 = V[5] + V[0] * c[1] - V[1] * c[0]
    for r in range(3):
        x[r] = p[r] + R[r, 0] * c[0] + R[r, 1] * c[1] + R[r, 2] * c[2]
        u[r] = R[r, 0] * u0 + R[r, 1] * u1 + R[r, 2] * u2


@inner
def add_point_force(R: Array, c: Array, F: Array, f: Array) -> None:
    """f += wrench in b of the force F (in the world) at the point c of b."""
    x = R[0, 0] * F[0] + R[1, 0] * F[1] + R[2, 0] * F[2]
    y = R[0, 1] * F[0] + R[1, 1] * F[1] + R[2, 1] * F[2]
    z = R[0, 2] * F[0] + R[1, 2] * F[1] + R[2, 2] * F[2]
    f[0] += c[1] * z - c[2] * y
    f[1] += c[2] * x - c[0] * z
    f[2] += c[0] * y - c[1] * x
    f[3] += x
    f[4] += y
    f[5] += z


@inner
def point_momentum(R: Array, c: Array, K: Array, V: Array, F: Array, h: Array) -> None:
    """h <- A K A' V for a twist V in b."""
    u0 = V[3] + V[1] * c[2] - V[2] * c[1]
    u1 = V[4] + V[2] * c[0] - V[0] * c[2]
    u2 = V[5] + V[0] * c[1] - V[1] * c[0]
    x = R[0, 0] * u0 + R[0, 1] * u1 + R[0, 2] * u2
    y = R[1, 0] * u0 + R[1, 1] * u1 + R[1, 2] * u2
    z = R[2, 0] * u0 + R[2, 1] * u1 + R[2, 2] * u2
    for r in range(3):
        F[r] = K[r, 0] * x + K[r, 1] * y + K[r, 2] * z
    clear(h)
    add_point_force(R, c, F, h)
