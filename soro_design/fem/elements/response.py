"""Energy, stress and tangent of a material at one deformation gradient, docs/design.md (1) to (4).

A law is a row of numbers, see `soro_design.fem.elements.material`. P and A are the first and second
derivative of the energy by the deformation gradient F, with F in rows: A[3 i + j, 3 k + l] = dP_ij / dF_kl.
"""

from __future__ import annotations

import numpy as np

from soro_core._jit import inner, kernel
from soro_core.arrays import Array

# Columns of a law.
KIND, C1, C2, C3, MIXED, BULK = range(6)
HYPERELASTIC, SVK = 0.0, 1.0
# In a law of St. Venant-Kirchhoff the second and third column.
LAMBDA, MU = 1, 2


@inner
def cofactor(F: Array, H: Array) -> float:
    """H <- dJ/dF; return J."""
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            c, d = (j + 1) % 3, (j + 2) % 3
            H[i, j] = F[a, c] * F[b, d] - F[a, d] * F[b, c]
    J: float = F[0, 0] * H[0, 0] + F[0, 1] * H[0, 1] + F[0, 2] * H[0, 2]
    return J


@inner
def add_volume_curvature(F: Array, factor: float, A: Array) -> None:
    """A += factor d2J/dF2: a minor of two rows and columns holds the element of F that both leave out."""
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            c, d = (j + 1) % 3, (j + 2) % 3
            A[3 * i + j, 3 * a + c] += factor * F[b, d]
            A[3 * i + j, 3 * b + d] += factor * F[a, c]
            A[3 * i + j, 3 * a + d] -= factor * F[b, c]
            A[3 * i + j, 3 * b + c] -= factor * F[a, d]


@inner
def _products(F: Array, C: Array, b: Array, D: Array) -> None:
    """C <- F^T F, b <- F F^T, D <- F C."""
    for i in range(3):
        for j in range(3):
            C[i, j] = F[0, i] * F[0, j] + F[1, i] * F[1, j] + F[2, i] * F[2, j]
            b[i, j] = F[i, 0] * F[j, 0] + F[i, 1] * F[j, 1] + F[i, 2] * F[j, 2]
    for i in range(3):
        for j in range(3):
            D[i, j] = F[i, 0] * C[0, j] + F[i, 1] * C[1, j] + F[i, 2] * C[2, j]


@inner
def _venant(law: Array, F: Array, with_tangent: bool, work: Array, into: tuple[Array, Array]) -> float:
    """St. Venant-Kirchhoff, (3): P = F S, S = lambda tr(E) 1 + 2 mu E, E = (C - 1) / 2."""
    C, b, D = work[0], work[1], work[2]
    P, A = into
    _products(F, C, b, D)
    lam, mu = law[LAMBDA], law[MU]
    trace = 0.5 * (C[0, 0] + C[1, 1] + C[2, 2] - 3.0)
    energy: float = 0.5 * lam * trace * trace
    for i in range(3):
        for j in range(3):
            E_ij = 0.5 * (C[i, j] - (1.0 if i == j else 0.0))
            energy += mu * E_ij * E_ij
            P[i, j] = (lam * trace - mu) * F[i, j] + mu * D[i, j]
    if with_tangent:
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    for m in range(3):
                        value = lam * F[i, j] * F[k, m] + mu * F[i, m] * F[k, j]
                        if j == m:
                            value += mu * b[i, k]
                        if i == k:
                            value += mu * C[j, m] + (lam * trace - mu if j == m else 0.0)
                        A[3 * i + j, 3 * k + m] = value
    return energy


@inner
def _invariants(F: Array, with_second: bool, work: Array) -> tuple[float, float]:
    """Return I1 and, if asked for, I2, with C, b and D in `work`."""
    C, b, D = work[0], work[1], work[2]
    I1 = 0.0
    for i in range(3):
        I1 += F[i, 0] * F[i, 0] + F[i, 1] * F[i, 1] + F[i, 2] * F[i, 2]
    I2 = 0.0
    if with_second:
        _products(F, C, b, D)
        I2 = 0.5 * I1 * I1
        for i in range(3):
            for j in range(3):
                I2 -= 0.5 * C[i, j] * C[i, j]
    return I1, I2


@inner
def _hyperelastic(
    law: tuple[Array, float],
    at: tuple[Array, Array],
    with_tangent: bool,
    work: Array,
    into: tuple[Array, Array],
) -> float:
    """Neo-Hooke, Mooney-Rivlin and Yeoh, (1)."""
    F, H = at
    P, A = into
    constants, bulk = law
    c01, D = constants[MIXED], work[2]
    J = F[0, 0] * H[0, 0] + F[0, 1] * H[0, 1] + F[0, 2] * H[0, 2]
    # Most laws have no second invariant, which takes as long as all else of the stress.
    I1, I2 = _invariants(F, c01 != 0.0, work)
    s = 1.0 / np.cbrt(J) ** 2
    t = s * s
    x, y = s * I1 - 3.0, t * I2 - 3.0
    c1, c2, c3 = constants[C1], constants[C2], constants[C3]
    first = c1 + x * (2.0 * c2 + 3.0 * c3 * x)
    # Factors of dI1, dI2 and dJ in the stress.
    by_I1, by_I2 = first * s, c01 * t
    by_J = -(2.0 * by_I1 * I1 + 4.0 * by_I2 * I2) / (3.0 * J) + bulk * (J - 1.0)
    for i in range(3):
        for j in range(3):
            P[i, j] = 2.0 * (by_I1 + by_I2 * I1) * F[i, j] + by_J * H[i, j]
    if c01 != 0.0:
        for i in range(3):
            for j in range(3):
                P[i, j] -= 2.0 * by_I2 * D[i, j]
    if with_tangent:
        second = 2.0 * c2 + 6.0 * c3 * x
        by_JJ = (10.0 * by_I1 * I1 + 28.0 * by_I2 * I2) / (9.0 * J * J) + bulk
        dx, mine = work[3], work[4]
        along = 2.0 * I1 / (3.0 * J)
        for i in range(3):
            for j in range(3):
                dx[i, j] = s * (2.0 * F[i, j] - along * H[i, j])
                mine[i, j] = -4.0 * (by_I1 + 2.0 * by_I2 * I1) / (3.0 * J) * F[i, j]
        if c01 != 0.0:
            for i in range(3):
                for j in range(3):
                    mine[i, j] += 8.0 * by_I2 / (3.0 * J) * D[i, j]
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    for m in range(3):
                        value = second * dx[i, j] * dx[k, m] + by_JJ * H[i, j] * H[k, m]
                        A[3 * i + j, 3 * k + m] = value + mine[i, j] * H[k, m] + mine[k, m] * H[i, j]
        for m in range(9):
            A[m, m] += 2.0 * (by_I1 + by_I2 * I1)
        if c01 != 0.0:
            _add_mixed(F, work, 2.0 * by_I2, A)
        add_volume_curvature(F, by_J, A)
    energy: float = x * (c1 + x * (c2 + x * c3)) + c01 * y + 0.5 * bulk * (J - 1.0) ** 2
    return energy


@inner
def _add_mixed(F: Array, work: Array, factor: float, A: Array) -> None:
    """A += what the derivative of I2 adds beside products of first derivatives."""
    C, b = work[0], work[1]
    for i in range(3):
        for j in range(3):
            for k in range(3):
                for m in range(3):
                    value = 2.0 * F[i, j] * F[k, m] - F[i, m] * F[k, j]
                    if i == k:
                        value -= C[j, m]
                    if j == m:
                        value -= b[i, k]
                    A[3 * i + j, 3 * k + m] += factor * value


@inner
def respond(
    law: Array,
    bulk: float,
    at: tuple[Array, Array],
    with_tangent: bool,
    work: Array,
    into: tuple[Array, Array],
) -> float:
    """P and, if asked for, A in `into` <- stress and tangent; return the energy per reference volume.

    `at` has F and H; H and J > 0 come from `cofactor`; `bulk` replaces that of the law where the element
    averages the volume; `work` is (5, 3, 3).
    """
    if law[KIND] == SVK:
        energy = _venant(law, at[0], with_tangent, work, into)
    else:
        energy = _hyperelastic((law, bulk), at, with_tangent, work, into)
    return energy


@kernel
def response(law: Array, F: Array, P: Array, A: Array) -> float:
    """P (3, 3), A (9, 9) <- stress [Pa] and tangent [Pa] at F (3, 3), J > 0; return the energy [J/m3]."""
    H, work = np.empty((3, 3)), np.empty((5, 3, 3))
    cofactor(F, H)
    return respond(law, law[BULK], (F, H), True, work, (P, A))
