"""Dynamics and kinematics by the method `mde`, from the terms that its equation gives."""

from __future__ import annotations

import numpy as np

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.links.lie import dot6
from soro_core.model.links.linear import assign, assign_matrix, cholesky_solve, lu_factor, lu_solve
from soro_core.model.links.mde import (
    MdeSlice,
    MdeTerms,
    begin_pass,
    body_columns,
    frame_rates,
    ralston,
    strain,
    terms,
)
from soro_core.model.links.sweep import NO
from soro_core.model.records import CrossSection, Masses, Motion, SubInterval, TangentFactors
from soro_core.model.tables import Site, Tables
from soro_core.model.work import Work


@inner
def inertia(t: Tables, w: Work, mass: Array, tip_mass: float, q: Array, M: Array) -> None:
    """M <- inertia matrix (n_q, n_q)."""
    out = MdeTerms(M, w.mde_coriolis, w.bias, w.columns)
    terms(t, Masses(mass, tip_mass, t.gravity), q, w.zero, out)


@inner
def inertial_force(t: Tables, w: Work, masses: Masses, none: Array, motion: Motion, tau: Array) -> None:
    """tau <- M(q) a + C(q, qd) v + G(q); `none` (6,) is not needed here."""
    M, C = w.mde_inertia, w.mde_coriolis
    q, qd, v, a = motion
    terms(t, masses, q, qd, MdeTerms(M, C, tau, w.columns))
    for b in range(q.shape[0]):
        for d in range(q.shape[0]):
            tau[b] += M[b, d] * a[d] + C[b, d] * v[d]


@inner
def motion_force(t: Tables, w: Work, none: Array, tip_mass: float, motion: Motion, tau: Array) -> None:
    """tau <- M a + C qd + G with this mass at the tip; `none` (6,) is zero."""
    inertial_force(t, w, Masses(t.mass, tip_mass, t.gravity), none, motion, tau)


@inner
def tip_mass_force(t: Tables, w: Work, q: Array, qd: Array, a: Array, tau: Array) -> None:
    """tau <- force per kg at the tip."""
    masses = Masses(np.zeros(t.mass.shape[0]), 1.0, t.gravity)
    inertial_force(t, w, masses, w.zero, Motion(q, qd, qd, a), tau)


@inner
def inverse_dynamics(t: Tables, w: Work, wrench: Array, motion: Motion, bodies: float, tau: Array) -> None:
    """tau <- M a + C qd + G - J_tip' wrench; what `factor_system` needs is left in any case."""
    inertial_force(t, w, Masses(t.mass, t.tip_mass[0], t.gravity), wrench, motion, tau)
    for b in range(tau.shape[0]):
        tau[b] -= dot6(w.columns[b], wrench)


@inner
def external_force(t: Tables, w: Work, wrench: Array, q: Array, qd: Array, tau: Array) -> float:
    """tau <- J_tip' wrench: all that can act from outside here, which stores no energy."""
    masses = Masses(t.mass, t.tip_mass[0], t.gravity)
    terms(t, masses, q, w.zero, MdeTerms(w.mde_inertia, w.mde_coriolis, tau, w.columns))
    for b in range(q.shape[0]):
        tau[b] = dot6(w.columns[b], wrench)
    return 0.0


@inner
def acceleration(t: Tables, w: Work, wrench: Array, q: Array, qd: Array, qdd: Array) -> bool:
    """qdd <- M^-1 (w.applied + J_tip' wrench - C qd - G); False if M is not positive definite."""
    inverse_dynamics(t, w, wrench, Motion(q, qd, qd, w.zero), NO, w.bias)
    for b in range(q.shape[0]):
        qdd[b] = w.applied[b] - w.bias[b]
    return cholesky_solve(w.mde_inertia, qdd)


@inner
def factor_system(t: Tables, w: Work, q: Array, qd: Array, factors: TangentFactors) -> bool:
    """Factor M(q) + w.block for `solve`, after `inverse_dynamics` at q; False if it is singular.

    The last three arguments are for contact, which this method does not have.
    """
    A = w.mde_system
    assign_matrix(w.mde_inertia, A)
    for i in range(t.length.shape[0]):
        first = t.offset[i]
        for c in range(first, t.offset[i + 1]):
            for j in range(t.offset[i + 1] - first):
                A[c, first + j] += w.block[c, j]
    return lu_factor(A, w.pivots)


@inner
def solve(t: Tables, w: Work, x: Array) -> None:
    """x <- (M + block)^-1 x with the factors of `factor_system`."""
    lu_solve(w.mde_system, w.pivots, x)


@inner
def kinematics(t: Tables, w: Work, site: Site, q: Array, at: CrossSection) -> None:
    """at <- pose and body Jacobian, transposed (n_q, 6), at a place; the last step may be shorter."""
    qd, massless = w.zero, MdeSlice(0.0, 0.0, t.gravity)
    y = begin_pass(t, at, w.mde_inertia, w.mde_coriolis, w.bias)
    for i in range(site.link + 1):
        last = i == site.link
        h = t.length[i] / t.steps
        for k in range(site.whole if last else t.steps):
            ralston(t, i, SubInterval(h, t.shape[k], t.reference[k, i]), massless, (q, qd), y)
        if last and site.step > 0.0:
            ralston(t, i, SubInterval(site.step, site.shape, site.rest), massless, (q, qd), y)
    body_columns(q.shape[0], qd, y.R, y.p, y)


@inner
def energy(t: Tables, w: Work, q: Array, qd: Array) -> tuple[float, float]:
    """Kinetic and gravitational energy [J]."""
    M = w.mde_inertia
    inertia(t, w, t.mass, t.tip_mass[0], q, M)
    kinetic = 0.0
    for b in range(q.shape[0]):
        for d in range(q.shape[0]):
            kinetic += 0.5 * qd[b] * M[b, d] * qd[d]
    return kinetic, potential(t, w, q)


@inner
def potential(t: Tables, w: Work, q: Array) -> float:
    """Gravitational energy [J], integrated with the same steps as the frame."""
    R, p = np.empty((3, 3)), np.empty(3)
    assign_matrix(t.base_rotation, R)
    assign(t.base_position, p)
    R1, p1, R2, p2 = np.empty((3, 3)), np.empty(3), np.empty((3, 3)), np.empty(3)
    xi, at, R_mid = np.empty(6), np.empty(3), np.empty((3, 3))
    energy = 0.0
    for i in range(t.length.shape[0]):
        h = t.length[i] / t.steps
        dm = t.mass[i] / t.steps
        for k in range(t.steps):
            strain(t, i, t.shape[k], 0, q, xi)
            frame_rates(xi, R, R1, p1)
            for r in range(3):
                at[r] = p[r] + h * 2.0 / 3.0 * p1[r]
                for d in range(3):
                    R_mid[r, d] = R[r, d] + h * 2.0 / 3.0 * R1[r, d]
            strain(t, i, t.shape[k], 1, q, xi)
            frame_rates(xi, R_mid, R2, p2)
            for r in range(3):
                energy -= dm * t.gravity[r] * (0.25 * p[r] + 0.75 * at[r])
                p[r] += h * (0.25 * p1[r] + 0.75 * p2[r])
                for d in range(3):
                    R[r, d] += h * (0.25 * R1[r, d] + 0.75 * R2[r, d])
    for r in range(3):
        energy -= t.tip_mass[0] * t.gravity[r] * p[r]
    return energy
