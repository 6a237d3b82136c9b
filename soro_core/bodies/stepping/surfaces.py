"""Distance from a point to the surface of a body, and the corners and edges that a body offers to others.

In the body's frame: a capsule and a cylinder lie along z, the ground is z <= 0.
"""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.bodies.stepping.records import BALL, BOX, CAPSULE, CYLINDER, GROUND

# Below this part of a length, a direction is none.
_NONE = 1e-9
# Points by which each rim of a cylinder touches.
RIM = 6
# Gap [m] below which a contact is solved for, beside what the motion of a step closes.
NEAR = 2e-4
# A corner this far beside a face [m] still stands on it; an edge this steep, by its sine, does not lie on it.
BESIDE, STEEP = 1e-5, 0.02


@inner
def surface_distance(kind: int, size: Array, x: Array, n: Array) -> float:
    """Signed distance [m] of x from the surface, negative inside; n <- its gradient, out of the body."""
    if kind == GROUND:
        n[0], n[1], n[2] = 0.0, 0.0, 1.0
        return float(x[2])
    if kind == BOX:
        return _box_distance(size, x, n)
    if kind == CYLINDER:
        return _cylinder_distance(size, x, n)
    along = min(max(x[2], -size[1]), size[1]) if kind == CAPSULE else 0.0
    z = x[2] - along
    d = math.sqrt(x[0] * x[0] + x[1] * x[1] + z * z)
    if d > _NONE * size[0]:
        n[0], n[1], n[2] = x[0] / d, x[1] / d, z / d
    else:
        n[0], n[1], n[2] = 1.0, 0.0, 0.0
    return float(d - size[0])


@inner
def _cylinder_distance(size: Array, x: Array, n: Array) -> float:
    rho = math.sqrt(x[0] * x[0] + x[1] * x[1])
    ex, ey = (x[0] / rho, x[1] / rho) if rho > _NONE * size[0] else (1.0, 0.0)
    up = 1.0 if x[2] >= 0.0 else -1.0
    a, b = rho - size[0], abs(x[2]) - size[1]
    if a > 0.0 and b > 0.0:
        d = math.sqrt(a * a + b * b)
        n[0], n[1], n[2] = ex * a / d, ey * a / d, up * b / d
        return d
    if a > b:
        n[0], n[1], n[2] = ex, ey, 0.0
        return float(a)
    n[0], n[1], n[2] = 0.0, 0.0, up
    return float(b)


@inner
def _box_distance(size: Array, x: Array, n: Array) -> float:
    nearest, axis, square = -math.inf, 0, 0.0
    for r in range(3):
        beyond = abs(x[r]) - size[r]
        n[r] = math.copysign(beyond, x[r]) if beyond > 0.0 else 0.0
        if beyond > nearest:
            nearest, axis = beyond, r
        if beyond > 0.0:
            square += beyond * beyond
    if square > 0.0:
        d = math.sqrt(square)
        for r in range(3):
            n[r] /= d
        return d
    n[axis] = math.copysign(1.0, x[axis])
    return nearest


@inner
def corners(kind: int, size: Array, out: Array, found: Array) -> int:
    """found <- points by which a body touches others; gives their number.

    `out` is the direction towards the other body. A cylinder touches with the point of each rim that lies the
    farthest along it, and with five more so that it can stand.
    """
    if kind == BALL:
        found[0, 0] = found[0, 1] = found[0, 2] = 0.0
        return 1
    if kind == CAPSULE:
        for i in range(2):
            found[i, 0] = found[i, 1] = 0.0
            found[i, 2] = size[1] * (2 * i - 1)
        return 2
    if kind == BOX:
        for i in range(8):
            for r in range(3):
                found[i, r] = size[r] if (i >> r) & 1 else -size[r]
        return 8
    if kind == CYLINDER:
        across = math.sqrt(out[0] * out[0] + out[1] * out[1])
        # One that stands keeps its points: it tilts a little as its contacts yield, and points that moved
        # with this tilt would rock it.
        tilts = across * 2.0 * size[0] > NEAR
        c, s = (out[0] / across, out[1] / across) if tilts else (1.0, 0.0)
        for i in range(2 * RIM):
            angle = (i % RIM) * 2.0 * math.pi / RIM
            ca, sa = math.cos(angle), math.sin(angle)
            found[i, 0] = size[0] * (c * ca - s * sa)
            found[i, 1] = size[0] * (s * ca + c * sa)
            found[i, 2] = size[1] if i < RIM else -size[1]
        return 2 * RIM
    return 0


@inner
def edge(kind: int, k: int) -> tuple[int, int]:
    """Corners at the ends of edge k, (0, 0) behind the last: that of a capsule is its axis."""
    if kind == CAPSULE and k == 0:
        return 0, 1
    if kind == CYLINDER and k == 0:
        return 0, RIM
    if kind == BOX and k < 12:
        axis, place = k // 4, k % 4
        # The two other axes spread the four edges along this one.
        low, high = (axis + 1) % 3, (axis + 2) % 3
        start = ((place & 1) << low) | ((place >> 1) << high)
        return start, start | (1 << axis)
    return 0, 0


@inner
def skin(kind: int, size: Array) -> float:
    """Radius about the corners and edges of a body [m]."""
    return float(size[0]) if kind in (BALL, CAPSULE) else 0.0
