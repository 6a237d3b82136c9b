"""Kernels of the method `mde`: the matrix differential equation of docs/model.md (15), Ralston's rule [R62].

The state (Phi, p, B1, B2, M, C, G) is integrated along the backbone with n steps a link. It is the method of
[CPN23] in the notation of [C22], corrected: Jdot keeps the term -ad_V J, G takes the linear rows of the body
Jacobian and has the sign of dU_g/dq.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.links.lie import add_ad, add_coad, dot6, to_body, to_parent
from soro_core.model.links.linear import (
    assign,
    assign_matrix,
    clear,
    clear_matrix,
)
from soro_core.model.links.magnus import strain_at
from soro_core.model.records import CrossSection, Masses, SubInterval
from soro_core.model.tables import Tables


class MdeTerms(NamedTuple):
    """M, C (n_q, n_q), G (n_q,) and the body Jacobian of the tip, transposed (n_q, 6)."""

    M: Array
    C: Array
    G: Array
    J: Array


class MdePass(NamedTuple):
    """State along the backbone: pose, columns B1, B2 and body columns J, Jdot, one a row; twist V; terms."""

    R: Array
    p: Array
    B1: Array
    B2: Array
    J: Array
    Jd: Array
    V: Array
    work: Array
    """Scratch, (3, 6)."""
    M: Array
    C: Array
    G: Array


class MdeSlice(NamedTuple):
    """Mass of a slice [kg], its squared gyration radius about a diameter [m^2], and gravity (3,)."""

    dm: float
    k2: float
    gravity: Array


@inner
def frame_rates(xi: Array, R: Array, R_rate: Array, p_rate: Array) -> None:
    """Phi' = Phi [Gamma]x, p' = Phi U, docs/model.md (1)."""
    x, y, z = xi[0], xi[1], xi[2]
    for r in range(3):
        a, b, c = R[r, 0], R[r, 1], R[r, 2]
        R_rate[r, 0] = b * z - c * y
        R_rate[r, 1] = c * x - a * z
        R_rate[r, 2] = a * y - b * x
        p_rate[r] = a * xi[3] + b * xi[4] + c * xi[5]


@inner
def body_columns(n: int, qd: Array, R: Array, p: Array, y: MdePass) -> None:
    """J = Ad_g^-1 B1, V = J qd, Jdot = -ad_V J + Ad_g^-1 B2 for the first n coordinates; g = (R, p)."""
    B1, B2, J, Jd, V = y.B1, y.B2, y.J, y.Jd, y.V
    clear(V)
    for b in range(n):
        for r in range(6):
            J[b, r] = B1[b, r]
            Jd[b, r] = B2[b, r]
        to_body(R, p, J[b])
        to_body(R, p, Jd[b])
        for r in range(6):
            V[r] += J[b, r] * qd[b]
    for b in range(n):
        add_ad(V, J[b], -1.0, Jd[b])


@inner
def _accumulate(n: int, of: MdeSlice, R: Array, y: MdePass) -> None:
    """M, C, G += those of a slice of mass dm: J' Mcal J, J' (Mcal Jdot + C_V J), -J_v' Phi' gamma dm."""
    dm, k2, gravity = of
    J, Jd, V, M, C, G = y.J, y.Jd, y.V, y.M, y.C, y.G
    momentum, force, column = y.work[0], y.work[1], y.work[2]
    for b in range(n):
        # Mcal (Jdot + ad_V J) - ad_V' Mcal J = Mcal Jdot + C_V J
        for r in range(6):
            column[r] = Jd[b, r]
        add_ad(V, J[b], 1.0, column)
        for r in range(3):
            rotary = dm * k2 * (2.0 if r == 2 else 1.0)
            momentum[r] = rotary * J[b, r]
            momentum[3 + r] = dm * J[b, 3 + r]
            force[r] = rotary * column[r]
            force[3 + r] = dm * column[3 + r]
        add_coad(V, momentum, -1.0, force)
        for d in range(n):
            M[d, b] += dot6(J[d], momentum)
            C[d, b] += dot6(J[d], force)
        for r in range(3):
            pull = R[0, r] * gravity[0] + R[1, r] * gravity[1] + R[2, r] * gravity[2]
            G[b] -= dm * J[b, 3 + r] * pull


@inner
def begin_pass(t: Tables, at: CrossSection, M: Array, C: Array, G: Array) -> MdePass:
    """Return the state at the base; pose and Jacobian are those of `at`."""
    n_q = t.basis.shape[0]
    assign_matrix(t.base_rotation, at.R)
    assign(t.base_position, at.p)
    B1, B2, Jd = np.zeros((n_q, 6)), np.zeros((n_q, 6)), np.zeros((n_q, 6))
    return MdePass(at.R, at.p, B1, B2, at.columns, Jd, np.empty(6), np.zeros((3, 6)), M, C, G)


@inner
def terms(t: Tables, masses: Masses, q: Array, qd: Array, out: MdeTerms) -> None:
    """Fill `out` at coordinates and rates (n_q,)."""
    n_q = q.shape[0]
    clear_matrix(out.M)
    clear_matrix(out.C)
    clear(out.G)
    clear_matrix(out.J)
    y = begin_pass(t, CrossSection(np.empty((3, 3)), np.empty(3), out.J), out.M, out.C, out.G)
    for i in range(t.length.shape[0]):
        h = t.length[i] / t.steps
        of = MdeSlice(masses.link[i] / t.steps, t.gyration[i, 0], masses.gravity)
        for k in range(t.steps):
            ralston(t, i, SubInterval(h, t.shape[k], t.reference[k, i]), of, (q, qd), y)
    body_columns(n_q, qd, y.R, y.p, y)
    if masses.tip > 0.0:
        _accumulate(n_q, MdeSlice(masses.tip, 0.0, masses.gravity), y.R, y)


@inner
def strain(t: Tables, i: int, shape: Array, point: int, q: Array, xi: Array) -> None:
    """xi <- xi_0 + B q of link i at one of the two points of a step."""
    for r in range(6):
        xi[r] = t.reference[0, i, 0, r]
    strain_at(t, i, shape, point, q, xi)


@inner
def ralston(
    t: Tables, i: int, step: SubInterval, of: MdeSlice, motion: tuple[Array, Array], y: MdePass
) -> None:
    """One step along link i: y + h (k(s, y) + 3 k(s + 2h/3, y + 2h/3 k)) / 4; `motion` is (q, qd)."""
    h, shape, _ = step
    q, qd = motion
    R, p, B1, B2, V = y.R, y.p, y.B1, y.B2, y.V
    n = t.offset[i + 1]
    first = t.offset[i]
    R1, p1, R_mid, p_mid = np.empty((3, 3)), np.empty(3), np.empty((3, 3)), np.empty(3)
    column, xi = np.empty(6), np.empty(6)
    start1, start2 = np.empty((n - first, 6)), np.empty((n - first, 6))
    for stage in range(2):
        weight = 0.25 if stage == 0 else 0.75
        if stage == 0:
            assign_matrix(R, R_mid)
            assign(p, p_mid)
        body_columns(n, qd, R_mid, p_mid, y)
        _accumulate(n, MdeSlice(weight * of.dm, of.k2, of.gravity), R_mid, y)
        strain(t, i, shape, stage, q, xi)
        frame_rates(xi, R_mid, R1, p1)
        # Only the columns of this link change along it: B1' = Ad_g B, B2' = Ad_g ad_V B.
        for b in range(first, n):
            for r in range(6):
                column[r] = shape[b, stage] * t.basis[b, r]
            to_parent(R_mid, p_mid, column)
            for r in range(6):
                if stage == 0:
                    start1[b - first, r] = B1[b, r] + 0.25 * h * column[r]
                    B1[b, r] += h * 2.0 / 3.0 * column[r]
                else:
                    B1[b, r] = start1[b - first, r] + 0.75 * h * column[r]
            clear(column)
            add_ad(V, t.basis[b], shape[b, stage], column)
            to_parent(R_mid, p_mid, column)
            for r in range(6):
                if stage == 0:
                    start2[b - first, r] = B2[b, r] + 0.25 * h * column[r]
                    B2[b, r] += h * 2.0 / 3.0 * column[r]
                else:
                    B2[b, r] = start2[b - first, r] + 0.75 * h * column[r]
        if stage == 0:
            for r in range(3):
                p_mid[r] = p[r] + h * 2.0 / 3.0 * p1[r]
                p[r] += 0.25 * h * p1[r]
                for d in range(3):
                    R_mid[r, d] = R[r, d] + h * 2.0 / 3.0 * R1[r, d]
                    R[r, d] += 0.25 * h * R1[r, d]
        else:
            for r in range(3):
                p[r] += 0.75 * h * p1[r]
                for d in range(3):
                    R[r, d] += 0.75 * h * R1[r, d]
