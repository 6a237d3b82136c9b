"""What one slice of a link adds to the derivatives of the inverse dynamics.

docs/model.md (42) to (45). The slice has the twist V, the acceleration A, the inertia N, and moves by the
column eta_j with coordinate j. Its wrench f = N A - ad_V' N V changes, apart from moving with the slice, by
N eta_j'' + Q eta_j' with q_j and by 2 N eta_j' + Q eta_j with its velocity. All is seen from one frame.
"""

from __future__ import annotations

from typing import NamedTuple

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.derivative.work import (
    BY_A,
    BY_Q,
    BY_V,
    FORCE,
    LINK_ACCELERATION,
    LINK_TWIST,
    MOMENTUM,
    NODE_ACCELERATION,
    NODE_TWIST,
    SLICE,
    TURNED,
    DerivativeWork,
)
from soro_core.model.links.lie import add, add_coad, dot6
from soro_core.model.links.link import momentum
from soro_core.model.links.sweep import add_rigid, move


@inner
def add_turned(turn: Array, linear: Array, x: Array, factor: float, out: Array) -> None:
    """out += factor * Q x = factor * (turn omega, 2 omega x linear) for a twist x = (omega, v)."""
    w0, w1, w2 = x[0], x[1], x[2]
    n0 = turn[0, 0] * w0 + turn[0, 1] * w1 + turn[0, 2] * w2
    n1 = turn[1, 0] * w0 + turn[1, 1] * w1 + turn[1, 2] * w2
    n2 = turn[2, 0] * w0 + turn[2, 1] * w1 + turn[2, 2] * w2
    f0 = 2.0 * (w1 * linear[2] - w2 * linear[1])
    f1 = 2.0 * (w2 * linear[0] - w0 * linear[2])
    f2 = 2.0 * (w0 * linear[1] - w1 * linear[0])
    add((n0, n1, n2, f0, f1, f2), factor, out)


@inner
def _add_transposed(turn: Array, linear: Array, x: Array, out: Array) -> None:
    """out += Q' x for a twist x; the linear part of Q' x is zero."""
    w0, w1, w2, v0, v1, v2 = x[0], x[1], x[2], x[3], x[4], x[5]
    n0 = turn[0, 0] * w0 + turn[1, 0] * w1 + turn[2, 0] * w2 + 2.0 * (linear[1] * v2 - linear[2] * v1)
    n1 = turn[0, 1] * w0 + turn[1, 1] * w1 + turn[2, 1] * w2 + 2.0 * (linear[2] * v0 - linear[0] * v2)
    n2 = turn[0, 2] * w0 + turn[1, 2] * w1 + turn[2, 2] * w2 + 2.0 * (linear[0] * v1 - linear[1] * v0)
    out[0] += n0
    out[1] += n1
    out[2] += n2


@inner
def _slice_turn(i: float, R: Array, p: Array, V: Array, linear: Array, turn: Array) -> None:
    """turn <- rotary block of Q of a slice, docs/model.md (44); `i` = mass k2."""
    l0, l1, l2 = linear[0], linear[1], linear[2]
    x, y, z = p[0], p[1], p[2]
    e0, e1, e2 = R[0, 2], R[1, 2], R[2, 2]
    w0, w1, w2 = V[0], V[1], V[2]
    d0, d1, d2 = i * (w1 * e2 - w2 * e1), i * (w2 * e0 - w0 * e2), i * (w0 * e1 - w1 * e0)
    along = e0 * w0 + e1 * w1 + e2 * w2
    g0, g1, g2 = i * (w0 + along * e0), i * (w1 + along * e1), i * (w2 + along * e2)
    turn[0, 0] = 2.0 * (y * l1 + z * l2 + d0 * e0)
    turn[1, 1] = 2.0 * (x * l0 + z * l2 + d1 * e1)
    turn[2, 2] = 2.0 * (x * l0 + y * l1 + d2 * e2)
    turn[0, 1] = -2.0 * l0 * y + d0 * e1 + d1 * e0 + g2
    turn[1, 0] = -2.0 * l1 * x + d0 * e1 + d1 * e0 - g2
    turn[0, 2] = -2.0 * l0 * z + d0 * e2 + d2 * e0 - g1
    turn[2, 0] = -2.0 * l2 * x + d0 * e2 + d2 * e0 + g1
    turn[1, 2] = -2.0 * l1 * z + d1 * e2 + d2 * e1 + g0
    turn[2, 1] = -2.0 * l2 * y + d1 * e2 + d2 * e1 - g0


class LinkSlice(NamedTuple):
    """First coordinate of a link and their number, mass [kg] and squared gyration radius [m^2] of a slice."""

    first: int
    m: int
    dm: float
    k2: float


@inner
def add_slice(d: DerivativeWork, i: int, of: LinkSlice, qd: Array, a: Array) -> None:
    """Add the slice of link i at the pose SLICE with the columns `d.node`; leave its motion and force.

    What the links inward need of this one is left out for the first link.
    """
    first, m, dm, k2 = of
    R, p = d.rotation[SLICE], d.position[SLICE]
    V, A = d.twists[NODE_TWIST], d.twists[NODE_ACCELERATION]
    h, f = d.twists[MOMENTUM], d.twists[FORCE]
    eta, eta1, eta2 = d.node[0], d.node[1], d.node[2]
    turn, linear = d.slice_turn, h[3:]
    move(m, eta, qd, first, d.twists[LINK_TWIST], V)
    move(m, eta, a, first, d.twists[LINK_ACCELERATION], A)
    move(m, eta1, qd, first, A, A)
    momentum(dm, k2, R, p, V, h)
    momentum(dm, k2, R, p, A, f)
    add_coad(V, h, -1.0, f)
    _slice_turn(dm * k2, R, p, V, linear, turn)
    add((f[0], f[1], f[2], f[3], f[4], f[5]), 1.0, d.wrench[i])
    if i > 0:
        add_rigid(dm, k2, R, p, d.inertia[i])
        for r in range(3):
            d.linear[i, r] += linear[r]
            for c in range(3):
                d.turn[i, r, c] += turn[r, c]
    by_a, by_q, by_v = d.change[BY_A], d.change[BY_Q], d.change[BY_V]
    for j in range(m):
        momentum(dm, k2, R, p, eta[j], by_a)
        momentum(dm, k2, R, p, eta2[j], by_q)
        add_turned(turn, linear, eta1[j], 1.0, by_q)
        momentum(2.0 * dm, k2, R, p, eta1[j], by_v)
        add_turned(turn, linear, eta[j], 1.0, by_v)
        add_block(d, first, m, j, eta)
        if i > 0:
            add_outer(d, first + j, eta[j], f, turn, linear)


@inner
def add_block(d: DerivativeWork, first: int, m: int, j: int, eta: Array) -> None:
    """Add what the coordinates of a link, of the columns `eta`, feel of `d.change` by coordinate j."""
    c = first + j
    for e in range(m):
        d.equation[BY_Q, first + e, c] += dot6(eta[e], d.change[BY_Q])
        d.equation[BY_V, first + e, c] += dot6(eta[e], d.change[BY_V])
    for e in range(j + 1):
        d.equation[BY_A, c, first + e] += dot6(eta[e], d.change[BY_A])


@inner
def add_outer(d: DerivativeWork, c: int, eta: Array, f: Array, turn: Array, linear: Array) -> None:
    """Add `d.change` by coordinate c, and its motion of the wrench f, to what the links inward need."""
    for by in range(3):
        x, out = d.change[by], d.outer[by, c]
        add((x[0], x[1], x[2], x[3], x[4], x[5]), 1.0, out)
    add_coad(eta, f, -1.0, d.outer[BY_Q, c])
    _add_transposed(turn, linear, eta, d.outer[TURNED, c])
