"""What the forces on a link feel of the change of its columns: sum of f . d(eta_j)/dq_i over its slices.

docs/model.md (46). A column is T(Omega) X = sum_n a_n ad_Omega^n X. Its change is taken against the force
from the left, with one recursion for all coordinates: Psi_n = a_n f + ad_Omega' Psi_(n+1).
"""

from __future__ import annotations

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.derivative.link import COMMUTATOR
from soro_core.model.derivative.work import ADDED, BY_Q, START, UNIT, UNIT_BRACKET, DerivativeWork
from soro_core.model.links.lie import ad, add_coad, dot6
from soro_core.model.links.linear import clear
from soro_core.model.tables import Tables


@inner
def _duals(count: int, omega: Array, powers: Array, phi: Array, dual: Array) -> None:
    """dual[j] <- gradient by Omega of sum_n a_n f . ad_Omega^n X_j; phi (10, 6): a_n f, then a_n' f.

    The first five rows of phi become Psi_n.
    """
    for n in range(3, -1, -1):
        add_coad(omega, phi[n + 1], 1.0, phi[n])
    for j in range(count):
        z = dual[j]
        clear(z)
        slope = 0.0
        for n in range(4):
            add_coad(powers[n, j], phi[n + 1], -1.0, z)
            slope += dot6(powers[n + 1, j], phi[6 + n])
        for r in range(3):
            z[r] += 2.0 * slope * omega[r]


@inner
def curve_constant(t: Tables, d: DerivativeWork, i: int, beyond: Array) -> None:
    """Add the term of link i, of constant strain; `beyond`: wrench of all beyond the link."""
    first = t.offset[i]
    m = t.offset[i + 1] - first
    for n in range(5):
        for r in range(6):
            d.phi[n, r] = d.force[i, 0, n, r] + d.coefficient[i, 0, 0, n] * beyond[r]
            d.phi[5 + n, r] = d.force[i, 0, 5 + n, r] + d.coefficient[i, 0, 1, n] * beyond[r]
    powers = d.powers[i, 0]
    _duals(m, d.omega[i, 0, 0], powers, d.phi, d.dual)
    for e in range(m):
        for j in range(m):
            d.equation[BY_Q, first + e, first + j] += dot6(d.dual[j], powers[0, e])


@inner
def _curve_step(t: Tables, d: DerivativeWork, i: int, k: int, count: int, f: Array) -> None:
    """Add the term of sub-interval k; f: wrench of all beyond its start."""
    first = t.offset[i]
    m = t.offset[i + 1] - first
    h = t.fraction[k] * t.length[i]
    commutator = COMMUTATOR * h * h
    for n in range(5):
        for r in range(6):
            d.phi[n, r] = d.coefficient[i, k, 0, n] * f[r]
            d.phi[5 + n, r] = d.coefficient[i, k, 1, n] * f[r]
    powers = d.powers[i, k]
    _duals(count, d.omega[i, k, 0], powers, d.phi, d.dual)
    unit = d.twists[UNIT_BRACKET]
    for g in range(count):
        for e in range(count):
            d.pairs[e, g] = dot6(d.dual[g], powers[0, e])
    # The commutator of the two points: +- for (first, second) and (second, first).
    for g in range(count // 2):
        for e in range(count // 2):
            ad(d.columns[i, k, UNIT, e], d.columns[i, k, UNIT, g], unit)
            mixed = commutator * dot6(unit, d.phi[0])
            d.pairs[2 * e, 2 * g + 1] += mixed
            d.pairs[2 * e + 1, 2 * g] -= mixed
    # The section at the start of the sub-interval turns what it adds.
    for g in range(count):
        clear(d.dual[g])
        add_coad(d.columns[i, k, ADDED, g], f, -1.0, d.dual[g])
    for j in range(m):
        g = 2 * d.group[first + j]
        j1, j2 = t.shape[k, first + j, 0], t.shape[k, first + j, 1]
        for e in range(m):
            b = 2 * d.group[first + e]
            e1, e2 = t.shape[k, first + e, 0], t.shape[k, first + e, 1]
            column = d.columns[i, k, START, e]
            d.equation[BY_Q, first + e, first + j] += j1 * (
                e1 * d.pairs[b, g] + e2 * d.pairs[b + 1, g] + dot6(column, d.dual[g])
            ) + j2 * (e1 * d.pairs[b, g + 1] + e2 * d.pairs[b + 1, g + 1] + dot6(column, d.dual[g + 1]))


@inner
def curve_varying(t: Tables, d: DerivativeWork, i: int, beyond: Array, f: Array) -> None:
    """Add the term of link i, of varying strain; f (6,) is scratch."""
    count = 2 * (d.group[t.offset[i + 1] - 1] + 1)
    for k in range(t.fraction.shape[0]):
        for r in range(6):
            f[r] = beyond[r] + d.wrench[i, r] - d.force[i, k, 0, r]
        _curve_step(t, d, i, k, count, f)
