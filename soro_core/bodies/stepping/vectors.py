"""Three numbers in space: products that write into given arrays."""

from __future__ import annotations

from soro_core._jit import inner
from soro_core.arrays import Array


@inner
def dot(x: Array, y: Array) -> float:
    """Inner product of two vectors (3,)."""
    return float(x[0] * y[0] + x[1] * y[1] + x[2] * y[2])


@inner
def cross(x: Array, y: Array, z: Array) -> None:
    """First three entries of z <- x times y."""
    z0 = x[1] * y[2] - x[2] * y[1]
    z1 = x[2] * y[0] - x[0] * y[2]
    z[0], z[1], z[2] = z0, z1, x[0] * y[1] - x[1] * y[0]


@inner
def subtract(x: Array, y: Array, z: Array) -> None:
    """z <- x - y."""
    for r in range(3):
        z[r] = x[r] - y[r]


@inner
def turn(R: Array, x: Array, y: Array) -> None:
    """y <- R x, from a body's frame to the world."""
    for r in range(3):
        y[r] = R[r, 0] * x[0] + R[r, 1] * x[1] + R[r, 2] * x[2]


@inner
def turn_back(R: Array, x: Array, y: Array) -> None:
    """y <- R' x, from the world to a body's frame."""
    for r in range(3):
        y[r] = R[0, r] * x[0] + R[1, r] * x[1] + R[2, r] * x[2]
