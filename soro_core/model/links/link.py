"""A link of constant strain in closed form, seen from the frame b of its base.

With B1(s) = int_0^s Ad_exp(t xi) B dt of docs/model.md (5), (7), the twist of the link's particle at s,
expressed in b, is V_b + B1 qd_i. A slice of mass dm has in b the inertia N = Ad^-T Mcal Ad^-1, which for a
round section needs only its position and its tangent.
"""

from __future__ import annotations

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.links.lie import ad, add_ad
from soro_core.model.tables import Tables
from soro_core.model.work import STRAIN, STRAIN_RATE, Work


@inner
def strain_twist(t: Tables, i: int, q: Array, xi: Array) -> None:
    """xi <- xi_0 + B q of link i."""
    for r in range(6):
        xi[r] = t.reference[0, i, 0, r]
    for c in range(t.offset[i], t.offset[i + 1]):
        for r in range(6):
            xi[r] += t.basis[c, r] * q[c]


@inner
def ad_powers(t: Tables, i: int, xi: Array, powers: Array) -> None:
    """powers[n, j] <- ad_xi^n of column j of B, n = 0 ... 4; shape (5, m, 6)."""
    first = t.offset[i]
    for j in range(t.offset[i + 1] - first):
        for r in range(6):
            powers[0, j, r] = t.basis[first + j, r]
        for n in range(4):
            ad(xi, powers[n, j], powers[n + 1, j])


@inner
def chain_powers(t: Tables, w: Work, i: int, v: Array) -> None:
    """w.chain[0, n] <- ad_xi^n B v of link i, w.chain[1, n] <- its rate along the strain rate."""
    xi, xi_rate, powers, chain = w.vectors[STRAIN], w.vectors[STRAIN_RATE], w.powers, w.chain
    first = t.offset[i]
    m = t.offset[i + 1] - first
    for n in range(5):
        for r in range(6):
            x = 0.0
            for j in range(m):
                x += powers[n, j, r] * v[first + j]
            chain[0, n, r] = x
        if n > 0:
            ad(xi_rate, chain[0, n - 1], chain[1, n])
            add_ad(xi, chain[1, n - 1], 1.0, chain[1, n])
        else:
            for r in range(6):
                chain[1, 0, r] = 0.0


@inner
def columns_at(m: int, s: float, a: Array, powers: Array, B1: Array) -> None:
    """B1[j] <- column j of int_0^s Ad_exp(t xi) B dt in the frame of the link's base; shape (m, 6)."""
    f1 = a[1] * s * s
    f2 = a[2] * s * s * s
    f3 = a[3] * s * s * s * s
    f4 = a[4] * s * s * s * s * s
    for j in range(m):
        p0, p1, p2, p3, p4 = powers[0, j], powers[1, j], powers[2, j], powers[3, j], powers[4, j]
        x0 = s * p0[0] + f1 * p1[0] + f2 * p2[0] + f3 * p3[0] + f4 * p4[0]
        x1 = s * p0[1] + f1 * p1[1] + f2 * p2[1] + f3 * p3[1] + f4 * p4[1]
        x2 = s * p0[2] + f1 * p1[2] + f2 * p2[2] + f3 * p3[2] + f4 * p4[2]
        x3 = s * p0[3] + f1 * p1[3] + f2 * p2[3] + f3 * p3[3] + f4 * p4[3]
        x4 = s * p0[4] + f1 * p1[4] + f2 * p2[4] + f3 * p3[4] + f4 * p4[4]
        x5 = s * p0[5] + f1 * p1[5] + f2 * p2[5] + f3 * p3[5] + f4 * p4[5]
        row = B1[j]
        row[0], row[1], row[2], row[3], row[4], row[5] = x0, x1, x2, x3, x4, x5


@inner
def chain_rate_at(s: float, y_rate: float, a: Array, chain: Array, rate: Array) -> None:
    """rate <- d/dt(B1) v at s; y_rate is the rate of y = (s |omega|)^2."""
    s2 = s * s
    f1, f2, f3, f4 = a[1] * s2, a[2] * s2 * s, a[3] * s2 * s2, a[4] * s2 * s2 * s
    d1, d2, d3, d4 = (
        a[6] * y_rate * s2,
        a[7] * y_rate * s2 * s,
        a[8] * y_rate * s2 * s2,
        a[9] * y_rate * s2 * s2 * s,
    )
    for r in range(6):
        rate[r] = (
            d1 * chain[0, 1, r]
            + d2 * chain[0, 2, r]
            + d3 * chain[0, 3, r]
            + d4 * chain[0, 4, r]
            + f1 * chain[1, 1, r]
            + f2 * chain[1, 2, r]
            + f3 * chain[1, 3, r]
            + f4 * chain[1, 4, r]
        )


@inner
def momentum(mass: float, k2: float, R: Array, p: Array, V: Array, h: Array) -> None:
    """h <- N V: momentum about the frame's origin of a round slice at p with normal R e3.

    `k2` = r^2 / 4: the rotary inertia is mass k2 (I + e3 e3') in the frame of the section.
    """
    l0 = mass * (V[3] + V[1] * p[2] - V[2] * p[1])
    l1 = mass * (V[4] + V[2] * p[0] - V[0] * p[2])
    l2 = mass * (V[5] + V[0] * p[1] - V[1] * p[0])
    along = R[0, 2] * V[0] + R[1, 2] * V[1] + R[2, 2] * V[2]
    i = mass * k2
    h[0] = i * (V[0] + along * R[0, 2]) + p[1] * l2 - p[2] * l1
    h[1] = i * (V[1] + along * R[1, 2]) + p[2] * l0 - p[0] * l2
    h[2] = i * (V[2] + along * R[2, 2]) + p[0] * l1 - p[1] * l0
    h[3] = l0
    h[4] = l1
    h[5] = l2


@inner
def node(t: Tables, i: int, k: int, mass: Array, tip_mass: float) -> tuple[float, float, float]:
    """Place, mass and squared gyration radius of node k, with the point mass there and that of the tip."""
    dm = t.mass_share[i, k] * mass[i]
    k2 = t.gyration[i, k]
    point = t.point_mass[i, k]
    if k == t.nodes.shape[0] - 1 and i == t.length.shape[0] - 1:
        point += tip_mass
    if point > 0.0:
        k2 *= dm / (dm + point)
        dm += point
    return t.nodes[k] * t.length[i], dm, k2
