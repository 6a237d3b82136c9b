"""Tendons: the generalised force of their tensions, docs/model_terms.md.

A tendon at d in the frame of the section has there the tangent u = U + Gamma x d + d' by arc length of the
backbone, linear in q, and the length l = int |u| dsigma. Its tension T does the work -T dl: the force is
-T dl/dq = -T int (u / |u|)' du/dq dsigma, whatever its route. A tendon only pulls: below 0 a tension does
nothing, as where the parabola through the values of a step passes below them.
"""

from __future__ import annotations

import math

from soro_core._by_type import select_by_type
from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.tables import NoTendons, Tables, Tendons


@inner
def _tangent(t: Tables, k: int, q: Array) -> tuple[float, float, float, float]:
    """Unit tangent of the tendon at point k, and its length by arc length of the backbone."""
    e, first = t.tendons, t.offset[t.tendons.link[k]]
    x, y, z = e.rest[k, 0], e.rest[k, 1], e.rest[k, 2]
    for j in range(t.offset[e.link[k] + 1] - first):
        x += e.columns[k, j, 0] * q[first + j]
        y += e.columns[k, j, 1] * q[first + j]
        z += e.columns[k, j, 2] * q[first + j]
    stretch = math.sqrt(x * x + y * y + z * z)
    return x / stretch, y / stretch, z / stretch, stretch


@inner
def _add_gradient(t: Tables, k: int, q: Array, factor: float, force: Array) -> None:
    """force += factor * d(length)/dq of what point k stands for."""
    e, first = t.tendons, t.offset[t.tendons.link[k]]
    x, y, z, _ = _tangent(t, k, q)
    scaled = factor * e.weight[k]
    for j in range(t.offset[e.link[k] + 1] - first):
        force[first + j] += scaled * (
            x * e.columns[k, j, 0] + y * e.columns[k, j, 1] + z * e.columns[k, j, 2]
        )


@inner
def _gradients(e: Tendons, t: Tables, q: Array, gradients: Array) -> None:
    for k in range(e.weight.shape[0]):
        _add_gradient(t, k, q, -1.0, gradients[e.input[k]])


@inner
def _forces(e: Tendons, t: Tables, q: Array, tension: Array, force: Array) -> None:
    for k in range(e.weight.shape[0]):
        T = tension[e.input[k]]
        if T > 0.0:
            _add_gradient(t, k, q, -T, force)


@inner
def _stiffness(e: Tendons, t: Tables, q: Array, tension: Array, factor: float, K: Array) -> None:
    for k in range(e.weight.shape[0]):
        T = tension[e.input[k]]
        if not T > 0.0:
            continue
        x, y, z, stretch = _tangent(t, k, q)
        scaled, c, first = factor * T * e.weight[k] / stretch, e.columns[k], t.offset[e.link[k]]
        for i in range(t.offset[e.link[k] + 1] - first):
            along = x * c[i, 0] + y * c[i, 1] + z * c[i, 2]
            for j in range(t.offset[e.link[k] + 1] - first):
                across = c[i, 0] * c[j, 0] + c[i, 1] * c[j, 1] + c[i, 2] * c[j, 2]
                across -= along * (x * c[j, 0] + y * c[j, 1] + z * c[j, 2])
                K[first + i, j] += scaled * across


@inner
def _shortening(e: Tendons, t: Tables, q: Array, amount: Array) -> None:
    for k in range(e.weight.shape[0]):
        x, y, z = e.rest[k, 0], e.rest[k, 1], e.rest[k, 2]
        amount[e.input[k]] += e.weight[k] * (math.sqrt(x * x + y * y + z * z) - _tangent(t, k, q)[3])


@inner
def _no_rows(e: Tendons, t: Tables, q: Array, rows: Array) -> None:
    return


@inner
def _no_forces(e: Tendons, t: Tables, q: Array, tension: Array, force: Array) -> None:
    return


@inner
def _no_stiffness(e: Tendons, t: Tables, q: Array, tension: Array, factor: float, K: Array) -> None:
    return


add_tendon_gradients = select_by_type(NoTendons, _no_rows, _gradients)
"""add_tendon_gradients(t.tendons, t, q, gradients): rows of H' (n_u, n_q) of the tendons -= d(length)/dq."""
add_tendon_force = select_by_type(NoTendons, _no_forces, _forces)
"""add_tendon_force(t.tendons, t, q, inputs, force): force -= tensions times d(length)/dq; inputs (n_u,)."""
add_tendon_stiffness = select_by_type(NoTendons, _no_stiffness, _stiffness)
"""add_tendon_stiffness(t.tendons, t, q, inputs, factor, K): K += factor * tensions times d2(length)/dq2, the
block of each link (n_q, width); positive semi-definite, 0 where the tangent keeps its direction."""
add_shortening = select_by_type(NoTendons, _no_rows, _shortening)
"""add_shortening(t.tendons, t, q, amount): amount (n_u,) += how much shorter each is than at q = 0 [m]."""
