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
def _venant(law: Array, F: Array, products: Array, P: Array, A: Array) -> float:
    """St. Venant-Kirchhoff, (3): P = F S, S = lambda tr(E) 1 + 2 mu E, E = (C - 1) / 2."""
    C, b, D = products[0], products[1], products[2]
    lam, mu = law[LAMBDA], law[MU]
    trace = 0.5 * (C[0, 0] + C[1, 1] + C[2, 2] - 3.0)
    energy: float = 0.5 * lam * trace * trace
    for i in range(3):
        for j in range(3):
            E_ij = 0.5 * (C[i, j] - (1.0 if i == j else 0.0))
            energy += mu * E_ij * E_ij
            P[i, j] = (lam * trace - mu) * F[i, j] + mu * D[i, j]
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
def respond(law: Array, bulk: float, at: tuple[Array, Array], work: Array, P: Array, A: Array) -> float:
    """P, A <- stress and tangent; return the energy per reference volume. `work` is (3, 3, 3).

    `at` has F and H; H and J > 0 come from `cofactor`; `bulk` replaces that of the law where the element
    averages the volume.
    """
    F, H = at
    C, b, D = work[0], work[1], work[2]
    _products(F, C, b, D)
    if law[KIND] == SVK:
        return _venant(law, F, work, P, A)
    J = F[0, 0] * H[0, 0] + F[0, 1] * H[0, 1] + F[0, 2] * H[0, 2]
    I1 = C[0, 0] + C[1, 1] + C[2, 2]
    I2 = 0.5 * I1 * I1
    for i in range(3):
        for j in range(3):
            I2 -= 0.5 * C[i, j] * C[i, j]
    s, t = J ** (-2.0 / 3.0), J ** (-4.0 / 3.0)
    x, y = s * I1 - 3.0, t * I2 - 3.0
    c01 = law[MIXED]
    first = law[C1] + x * (2.0 * law[C2] + 3.0 * law[C3] * x)
    second = 2.0 * law[C2] + 6.0 * law[C3] * x
    # Factors of dI1, dI2 and dJ in the stress.
    by_J = -(2.0 * first * s * I1 + 4.0 * c01 * t * I2) / (3.0 * J) + bulk * (J - 1.0)
    by_JJ = (10.0 * first * s * I1 + 28.0 * c01 * t * I2) / (9.0 * J * J) + bulk
    for i in range(3):
        for j in range(3):
            P[i, j] = 2.0 * (first * s + c01 * t * I1) * F[i, j] - 2.0 * c01 * t * D[i, j] + by_J * H[i, j]
    mixed1, mixed2 = -2.0 * first * s / (3.0 * J), -4.0 * c01 * t / (3.0 * J)
    for i in range(3):
        for j in range(3):
            dI2 = 2.0 * (I1 * F[i, j] - D[i, j])
            dx = s * (2.0 * F[i, j] - 2.0 * I1 / (3.0 * J) * H[i, j])
            mine = mixed1 * 2.0 * F[i, j] + mixed2 * dI2
            for k in range(3):
                for m in range(3):
                    dI2_ = 2.0 * (I1 * F[k, m] - D[k, m])
                    dx_ = s * (2.0 * F[k, m] - 2.0 * I1 / (3.0 * J) * H[k, m])
                    other = mixed1 * 2.0 * F[k, m] + mixed2 * dI2_
                    value = second * dx * dx_ + by_JJ * H[i, j] * H[k, m]
                    value += mine * H[k, m] + other * H[i, j]
                    value += c01 * t * (4.0 * F[i, j] * F[k, m] - 2.0 * F[i, m] * F[k, j])
                    if i == k:
                        value -= 2.0 * c01 * t * C[j, m]
                        if j == m:
                            value += 2.0 * (first * s + c01 * t * I1)
                    if j == m:
                        value -= 2.0 * c01 * t * b[i, k]
                    A[3 * i + j, 3 * k + m] = value
    add_volume_curvature(F, by_J, A)
    energy: float = x * (law[C1] + x * (law[C2] + x * law[C3])) + c01 * y + 0.5 * bulk * (J - 1.0) ** 2
    return energy


@kernel
def response(law: Array, F: Array, P: Array, A: Array) -> float:
    """P (3, 3), A (9, 9) <- stress [Pa] and tangent [Pa] at F (3, 3), J > 0; return the energy [J/m3]."""
    H, work = np.empty((3, 3)), np.empty((3, 3, 3))
    cofactor(F, H)
    return respond(law, law[BULK], (F, H), work, P, A)
