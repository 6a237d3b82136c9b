"""Derivatives of the inverse dynamics of a chain of links, docs/model.md (42) to (46).

One pass outward along the links (`link`) and one inward. A coordinate moves all links beyond its own as one
rigid body, so that two links meet in products of six numbers only: these alone grow with the square of the
coordinates.
"""

from __future__ import annotations

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.derivative.curvature import curve_constant, curve_varying
from soro_core.model.derivative.link import pass_constant, pass_varying
from soro_core.model.derivative.slice import add_block, add_outer, add_turned
from soro_core.model.derivative.work import (
    BY_A,
    BY_Q,
    BY_V,
    FORCE,
    LINK,
    LINK_ACCELERATION,
    LINK_TWIST,
    TURNED,
    DerivativeWork,
)
from soro_core.model.links.articulated import complete_rigid
from soro_core.model.links.lie import add, dot6, wrench_to_parent
from soro_core.model.links.linear import clear, clear_matrix
from soro_core.model.links.sweep import start
from soro_core.model.tables import Tables


@inner
def _outward(t: Tables, d: DerivativeWork, q: Array, qd: Array, a: Array) -> None:
    """Fill `d` with what each link has by itself."""
    for by in range(3):
        clear_matrix(d.equation[by])
    for row in range(4):
        clear_matrix(d.outer[row])
    clear_matrix(d.wrench)
    clear_matrix(d.linear)
    clear_matrix(d.rotation[LINK])
    clear(d.position[LINK])
    for r in range(3):
        d.rotation[LINK, r, r] = 1.0
    V, A = d.twists[LINK_TWIST], d.twists[LINK_ACCELERATION]
    start(t, t.gravity, V, V, A)
    for i in range(t.length.shape[0]):
        clear_matrix(d.inertia[i])
        clear_matrix(d.turn[i])
        if t.varying[i]:
            pass_varying(t, d, i, q, qd, a)
        else:
            pass_constant(t, d, i, q, qd, a)


@inner
def _change_beyond(d: DerivativeWork, beyond: int, c: int) -> None:
    """d.change <- change by coordinate c of the wrench of what lies beyond its link, a rigid body."""
    N, turn, linear = d.inertia[beyond], d.turn[beyond], d.linear[beyond]
    E, E1, E2 = d.end[0, c], d.end[1, c], d.end[2, c]
    for r in range(6):
        d.change[BY_A, r] = dot6(N[r], E)
        d.change[BY_Q, r] = dot6(N[r], E2)
        d.change[BY_V, r] = 2.0 * dot6(N[r], E1)
    add_turned(turn, linear, E1, 1.0, d.change[BY_Q])
    add_turned(turn, linear, E, 1.0, d.change[BY_V])


@inner
def _meet(d: DerivativeWork, first: int, behind: int) -> None:
    """Fill the rows and columns of a link's coordinates and those of all links beyond it."""
    M, by_q, by_v = d.equation[BY_A], d.equation[BY_Q], d.equation[BY_V]
    for j in range(first, behind):
        E, E1, E2 = d.end[0, j], d.end[1, j], d.end[2, j]
        for b in range(behind, M.shape[0]):
            h, y = d.outer[BY_A, b], d.outer[TURNED, b]
            M[b, j] = dot6(h, E)
            by_q[b, j] = dot6(h, E2) + dot6(y, E1)
            by_v[b, j] = 2.0 * dot6(h, E1) + dot6(y, E)
            by_q[j, b] = dot6(E, d.outer[BY_Q, b])
            by_v[j, b] = dot6(E, d.outer[BY_V, b])


@inner
def _inward(t: Tables, d: DerivativeWork, wrench: Array) -> None:
    """Add what the links beyond each link do, and a wrench at the tip."""
    n = t.length.shape[0]
    F = d.wrench[n]
    clear_matrix(d.inertia[n])
    clear_matrix(d.turn[n])
    for r in range(6):
        F[r] = -wrench[r]
    wrench_to_parent(d.rotation[LINK], d.position[LINK], F)
    for i in range(n - 1, -1, -1):
        first, behind = t.offset[i], t.offset[i + 1]
        for c in range(first, behind):
            _change_beyond(d, n, c)
            add_block(d, first, behind - first, c - first, d.end[0, first:behind])
            if i > 0:
                add_outer(d, c, d.end[0, c], F, d.turn[n], d.linear[n])
        if t.varying[i]:
            curve_varying(t, d, i, F, d.twists[FORCE])
        else:
            curve_constant(t, d, i, F)
        _meet(d, first, behind)
        if i > 0:
            f = d.wrench[i]
            add((f[0], f[1], f[2], f[3], f[4], f[5]), 1.0, F)
            complete_rigid(d.inertia[i])
            for r in range(6):
                for c in range(6):
                    d.inertia[n, r, c] += d.inertia[i, r, c]
            for r in range(3):
                d.linear[n, r] += d.linear[i, r]
                for c in range(3):
                    d.turn[n, r, c] += d.turn[i, r, c]


@inner
def inverse_derivatives(t: Tables, d: DerivativeWork, wrench: Array, q: Array, qd: Array, a: Array) -> None:
    """d.equation <- derivatives of M a + C qd + G - J_tip' wrench by a, q and qd.

    Only the lower triangle of the first, the inertia matrix, is written.
    """
    _outward(t, d, q, qd, a)
    _inward(t, d, wrench)
