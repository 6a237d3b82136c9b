"""Kernel of a pressure that stays normal to the deformed face, docs/design.md (8) and (9)."""

from __future__ import annotations

import math

import numpy as np

from soro_core._jit import inner, kernel
from soro_core.arrays import Array, Integers


@inner
def _normal(tangent: Array, normal: Array) -> None:
    """Area vector by xi, outwards: to the right of an edge, as a screw moves on a face; tangent (3, 2)."""
    if normal.shape[0] == 2:
        normal[0], normal[1] = tangent[1, 0], -tangent[0, 0]
        return
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        normal[i] = tangent[a, 0] * tangent[b, 1] - tangent[b, 0] * tangent[a, 1]


@inner
def _normal_by(tangent: Array, slope: Array, k: int, change: Array) -> None:
    """Derivative of the area vector by displacement k of a node; slope (d - 1,) of its shape function."""
    change[:] = 0.0
    if change.shape[0] == 2:
        if k == 0:
            change[1] = -slope[0]
        else:
            change[0] = slope[0]
        return
    a, b = (k + 1) % 3, (k + 2) % 3
    change[b] = slope[0] * tangent[a, 1] - slope[1] * tangent[a, 0]
    change[a] = slope[1] * tangent[b, 0] - slope[0] * tangent[b, 1]


@kernel
def add_pressure(
    pressure: float,
    is_revolved: bool,
    on: tuple[Integers, Array, Array, Array],
    x: Array,
    force: Array,
    into: tuple[Integers, Array],
) -> None:
    """Subtract the forces of a pressure from `force` (n, d) and add their stiffness to `data` unless empty.

    `on` has the faces, and shape (g, m), slope (g, m, d - 1) and weight (g,) of one; x (n, d) are deformed
    places; `into`: position (f, m d, m d) says where in `data` the stiffness of a face goes.
    """
    faces, shape, slope, weight = on
    position, data = into
    d, m = x.shape[1], faces.shape[1]
    tangent, normal, change = np.empty((3, 2)), np.empty(d), np.empty(d)
    with_stiffness = data.shape[0] > 0
    for f in range(faces.shape[0]):
        for g in range(shape.shape[0]):
            tangent[:] = 0.0
            radius = 0.0
            for a in range(m):
                radius += shape[g, a] * x[faces[f, a], 0]
                for i in range(d):
                    for k in range(d - 1):
                        tangent[i, k] += slope[g, a, k] * x[faces[f, a], i]
            _normal(tangent, normal)
            around = 2.0 * math.pi * radius if is_revolved else 1.0
            each = pressure * weight[g]
            for a in range(m):
                for i in range(d):
                    force[faces[f, a], i] += each * around * shape[g, a] * normal[i]
            if not with_stiffness:
                continue
            for b in range(m):
                for k in range(d):
                    _normal_by(tangent, slope[g, b], k, change)
                    for i in range(d):
                        value = around * change[i]
                        if is_revolved and k == 0:
                            value += 2.0 * math.pi * shape[g, b] * normal[i]
                        for a in range(m):
                            data[position[f, a * d + i, b * d + k]] += each * shape[g, a] * value
