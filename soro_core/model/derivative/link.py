"""One pass along a link for the derivatives of the inverse dynamics: its columns, their rates, its slices.

docs/model.md (40), (41). A link of constant strain is one exponential from its base, a varying one a
sub-interval after the other; both are seen from the frame of the arm's base, so the motion of the link's base
needs no terms of its own.
"""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.derivative.rates import add_bracket, along, begin, bracket, carry, coefficients, combine
from soro_core.model.derivative.slice import LinkSlice, add_slice
from soro_core.model.derivative.work import (
    ADDED,
    FORCE,
    LINK,
    LINK_ACCELERATION,
    LINK_TWIST,
    NODE_ACCELERATION,
    NODE_TWIST,
    SECTION,
    SECTION_ACCELERATION,
    SECTION_TWIST,
    SLICE,
    START,
    STEP,
    UNIT,
    DerivativeWork,
)
from soro_core.model.links.lie import exponential, to_parent
from soro_core.model.links.linear import assign, assign_matrix, clear, clear_matrix
from soro_core.model.links.link import node, strain_twist
from soro_core.model.links.magnus import strain_at
from soro_core.model.records import Motion
from soro_core.model.tables import Tables

COMMUTATOR = math.sqrt(3.0) / 12.0


@inner
def _turn_rates(omega: Array) -> tuple[float, float, float]:
    """y = |omega|^2 of an exponent (3, 6) and its rates."""
    y, y1, y2 = 0.0, 0.0, 0.0
    for r in range(3):
        y += omega[0, r] * omega[0, r]
        y1 += 2.0 * omega[0, r] * omega[1, r]
        y2 += 2.0 * (omega[1, r] * omega[1, r] + omega[0, r] * omega[2, r])
    return y, y1, y2


@inner
def _place_slice(d: DerivativeWork, omega: Array, s: float, start: int) -> None:
    """Pose SLICE <- exp(s omega) times the pose `start`."""
    R, p = d.rotation[STEP], d.position[STEP]
    R0, p0 = d.rotation[start], d.position[start]
    R1, p1 = d.rotation[SLICE], d.position[SLICE]
    exponential(omega, s, d.stumpff, R, p)
    for r in range(3):
        p1[r] = p[r] + R[r, 0] * p0[0] + R[r, 1] * p0[1] + R[r, 2] * p0[2]
        for c in range(3):
            R1[r, c] = R[r, 0] * R0[0, c] + R[r, 1] * R0[1, c] + R[r, 2] * R0[2, c]


@inner
def _finish(d: DerivativeWork, first: int, m: int) -> None:
    """Keep the columns of the end; the next link begins there."""
    for order in range(3):
        for j in range(m):
            assign(d.node[order, j], d.end[order, first + j])
    assign_matrix(d.rotation[SLICE], d.rotation[LINK])
    assign(d.position[SLICE], d.position[LINK])
    assign(d.twists[NODE_TWIST], d.twists[LINK_TWIST])
    assign(d.twists[NODE_ACCELERATION], d.twists[LINK_ACCELERATION])


@inner
def pass_constant(t: Tables, d: DerivativeWork, i: int, q: Array, qd: Array, a: Array) -> None:
    """Pass along link i, of constant strain."""
    first = t.offset[i]
    m = t.offset[i + 1] - first
    R, p = d.rotation[LINK], d.position[LINK]
    V, A = d.twists[LINK_TWIST], d.twists[LINK_ACCELERATION]
    omega, powers, sums = d.omega[i, 0], d.powers[i, 0], d.force[i, 0]
    strain_twist(t, i, q, omega[0])
    clear(omega[1])
    clear(omega[2])
    for j in range(m):
        X = powers[0, j]
        for r in range(6):
            X[r] = t.basis[first + j, r]
            omega[1, r] += X[r] * qd[first + j]
            omega[2, r] += X[r] * a[first + j]
        to_parent(R, p, X)
        begin(V, A, X, d.rates[0, 0, j], d.rates[1, 0, j])
    carry(R, p, V, A, omega)
    bracket(m, omega, powers, d.rates)
    y, y1, y2 = _turn_rates(omega)
    clear_matrix(sums)
    k, f = d.factor, d.twists[FORCE]
    s = 0.0
    for n in range(t.nodes.shape[0]):
        s, dm, k2 = node(t, i, n, t.mass, t.tip_mass[0])
        coefficients(y * s * s, d.stumpff, d.tangent)
        along(s, y1, y2, d.tangent, k)
        combine(m, k, powers, d.rates, d.node)
        _place_slice(d, omega[0], s, LINK)
        add_slice(d, i, LinkSlice(first, m, dm, k2), qd, a)
        # Sums of the forces by the coefficients, for `curvature`.
        power = s * s * s
        for e in range(5):
            slope = power * d.tangent[5 + e]
            for r in range(6):
                sums[e, r] += k[0, e] * f[r]
                sums[5 + e, r] += slope * f[r]
            power *= s
    power = s * s * s
    for e in range(5):
        d.coefficient[i, 0, 0, e] = k[0, e]
        d.coefficient[i, 0, 1, e] = power * d.tangent[5 + e]
        power *= s
    _finish(d, first, m)


@inner
def _strains(t: Tables, d: DerivativeWork, i: int, k: int, motion: Motion) -> None:
    """d.jet[0], d.jet[1] <- strains at the two Gauss points of sub-interval k of link i, and their rates."""
    shape, R, p = t.shape[k], d.rotation[SECTION], d.position[SECTION]
    for point in range(2):
        x = d.jet[point]
        assign(t.reference[k, i, point], x[0])
        clear(x[1])
        clear(x[2])
        strain_at(t, i, shape, point, motion.q, x[0])
        strain_at(t, i, shape, point, motion.qd, x[1])
        strain_at(t, i, shape, point, motion.a, x[2])
        carry(R, p, d.twists[SECTION_TWIST], d.twists[SECTION_ACCELERATION], x)


@inner
def _summands(t: Tables, d: DerivativeWork, i: int, k: int, h: float) -> int:
    """Columns 2 g, 2 g + 1 of powers[0] <- X_1, X_2 of strain g, (9), and their rates; gives how many."""
    R, p, c = d.rotation[SECTION], d.position[SECTION], COMMUTATOR * h * h
    first = t.offset[i]
    unit, X = d.jet[2], d.jet[3]
    count = 0
    for b in range(first, t.offset[i + 1]):
        g = d.group[b]
        if 2 * g < count:
            continue
        assign(t.basis[b], unit[0])
        to_parent(R, p, unit[0])
        begin(d.twists[SECTION_TWIST], d.twists[SECTION_ACCELERATION], unit[0], unit[1], unit[2])
        assign(unit[0], d.columns[i, k, UNIT, g])
        for point in range(2):
            for order in range(3):
                for r in range(6):
                    X[order, r] = 0.5 * h * unit[order, r]
            # X_1 has the strain of the second point, and the other way round.
            add_bracket(d.jet[1 - point], unit, -c if point == 0 else c, X)
            assign(X[0], d.powers[i, k, 0, count])
            assign(X[1], d.rates[0, 0, count])
            assign(X[2], d.rates[1, 0, count])
            count += 1
    return count


@inner
def pass_varying(t: Tables, d: DerivativeWork, i: int, q: Array, qd: Array, a: Array) -> None:
    """Pass along link i, of varying strain."""
    first = t.offset[i]
    m = t.offset[i + 1] - first
    V, A = d.twists[SECTION_TWIST], d.twists[SECTION_ACCELERATION]
    assign_matrix(d.rotation[LINK], d.rotation[SLICE])
    assign(d.position[LINK], d.position[SLICE])
    assign(d.twists[LINK_TWIST], d.twists[NODE_TWIST])
    assign(d.twists[LINK_ACCELERATION], d.twists[NODE_ACCELERATION])
    R, p = d.rotation[SECTION], d.position[SECTION]
    for order in range(3):
        clear_matrix(d.node[order])
    for k in range(t.fraction.shape[0]):
        h = t.fraction[k] * t.length[i]
        c = COMMUTATOR * h * h
        assign_matrix(d.rotation[SLICE], R)
        assign(d.position[SLICE], p)
        assign(d.twists[NODE_TWIST], V)
        assign(d.twists[NODE_ACCELERATION], A)
        assign(d.wrench[i], d.force[i, k, 0])
        omega, powers = d.omega[i, k], d.powers[i, k]
        _strains(t, d, i, k, Motion(q, qd, qd, a))
        for order in range(3):
            for r in range(6):
                omega[order, r] = 0.5 * h * (d.jet[0, order, r] + d.jet[1, order, r])
        add_bracket(d.jet[0], d.jet[1], c, omega)
        count = _summands(t, d, i, k, h)
        bracket(count, omega, powers, d.rates)
        y, y1, y2 = _turn_rates(omega)
        coefficients(y, d.stumpff, d.tangent)
        along(1.0, y1, y2, d.tangent, d.factor)
        combine(count, d.factor, powers, d.rates, d.pieces)
        for e in range(5):
            d.coefficient[i, k, 0, e] = d.tangent[e]
            d.coefficient[i, k, 1, e] = d.tangent[5 + e]
        for e in range(count):
            assign(d.pieces[0, e], d.columns[i, k, ADDED, e])
        for j in range(m):
            assign(d.node[0, j], d.columns[i, k, START, j])
            g = 2 * d.group[first + j]
            f1, f2 = t.shape[k, first + j, 0], t.shape[k, first + j, 1]
            for order in range(3):
                for r in range(6):
                    d.node[order, j, r] += f1 * d.pieces[order, g, r] + f2 * d.pieces[order, g + 1, r]
        _place_slice(d, omega[0], 1.0, SECTION)
        _, dm, k2 = node(t, i, k, t.mass, t.tip_mass[0])
        add_slice(d, i, LinkSlice(first, m, dm, k2), qd, a)
    _finish(d, first, m)
