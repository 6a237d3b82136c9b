"""The chain of links as joints: its factors at a cost that grows linearly with the links.

With the inertia of every link by itself (`sweep`), the joint is the link's own deformation: its 6 x m
columns E at the end take the place of a joint's axis in the articulated-body algorithm [F08, chapter 7],
docs/model.md (14). A matrix that is block-diagonal by links may be added to M, so
that the same factors solve the implicit steppers' systems.
"""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.links.lie import dot6, to_body, wrench_to_parent
from soro_core.model.links.linear import ROUND_OFF, assign, clear, clear_matrix
from soro_core.model.tables import Tables
from soro_core.model.work import JOINT_ACCELERATION, JOINT_WRENCH, Work


@inner
def complete_rigid(N: Array) -> None:
    """N from its mass, first moment and rotary block: momentum (angular, linear) = N twist."""
    x, y, z, dm = N[3, 0], N[4, 0], N[5, 0], N[3, 3]
    N[0, 1], N[0, 2], N[1, 2] = N[1, 0], N[2, 0], N[2, 1]
    N[3, 0] = N[4, 1] = N[5, 2] = N[0, 3] = N[1, 4] = N[2, 5] = 0.0
    N[0, 4] = N[4, 0] = -z
    N[0, 5] = N[5, 0] = y
    N[1, 3] = N[3, 1] = z
    N[1, 5] = N[5, 1] = -x
    N[2, 3] = N[3, 2] = -y
    N[2, 4] = N[4, 2] = x
    N[3, 4] = N[4, 3] = N[3, 5] = N[5, 3] = N[4, 5] = N[5, 4] = 0.0
    N[4, 4] = N[5, 5] = dm


@inner
def inertia_to_parent(R: Array, p: Array, N: Array, T: Array) -> None:
    """N <- Ad_g^-T N Ad_g^-1 for a symmetric N; T (6, 6) is overwritten.

    Blocks: rotary I, coupling H, linear L. Rotated, then moved: H + [p] L, and I - H [p] + [p] (H + [p] L)'.
    """
    for b in range(2):
        for d in range(b + 1):
            for i in range(3):
                for j in range(3):
                    x = 0.0
                    for k in range(3):
                        x += R[i, k] * N[3 * b + k, 3 * d + j]
                    T[i, j] = x
            for i in range(3):
                for j in range(3):
                    N[3 * b + i, 3 * d + j] = T[i, 0] * R[j, 0] + T[i, 1] * R[j, 1] + T[i, 2] * R[j, 2]
    x, y, z = p[0], p[1], p[2]
    # N[3:, :3] is H'. I - H [p]: rows of H are columns of H'.
    for i in range(3):
        h0, h1, h2 = N[3, i], N[4, i], N[5, i]
        N[i, 0] -= h1 * z - h2 * y
        N[i, 1] -= h2 * x - h0 * z
        N[i, 2] -= h0 * y - h1 * x
    # H' + L [p]' = H' - L [p]
    for i in range(3):
        l0, l1, l2 = N[3 + i, 3], N[3 + i, 4], N[3 + i, 5]
        N[3 + i, 0] -= l1 * z - l2 * y
        N[3 + i, 1] -= l2 * x - l0 * z
        N[3 + i, 2] -= l0 * y - l1 * x
    # + [p] (H + [p] L)'
    for j in range(3):
        h0, h1, h2 = N[3, j], N[4, j], N[5, j]
        N[0, j] += y * h2 - z * h1
        N[1, j] += z * h0 - x * h2
        N[2, j] += x * h1 - y * h0
    for i in range(3):
        for j in range(3):
            N[j, 3 + i] = N[3 + i, j]


@inner
def factor(t: Tables, w: Work, added: float) -> bool:
    """Factor M, with w.block if `added` > 0, from the bodies of `sweep`; False: not positive definite."""
    n = t.length.shape[0]
    beyond, T = w.beyond, w.rotated
    clear_matrix(beyond)
    for i in range(n - 1, -1, -1):
        first = t.offset[i]
        m = t.offset[i + 1] - first
        D, K, U, E, F, N = w.mass[i], w.gain[i], w.force[i], w.end_columns[i], w.coupling[i], w.inertia[i]
        if i < n - 1:
            inertia_to_parent(w.end_rotation[i], w.end_position[i], beyond, T)
            for j in range(m):
                for r in range(6):
                    U[j, r] = dot6(beyond[r], E[j])
                for e in range(j + 1):
                    D[j, e] += dot6(E[e], U[j])
                for r in range(6):
                    U[j, r] += F[j, r]
        else:
            for j in range(m):
                assign(F[j], U[j])
        if added > 0.0:
            for j in range(m):
                for e in range(j + 1):
                    D[j, e] += w.block[first + j, e]
        if not cholesky(m, D):
            return False
        if i > 0:
            _cholesky_rows(m, D, U, K)
            complete_rigid(N)
            if added > 0.0 and w.extra.shape[0] > 0:
                for r in range(6):
                    for c in range(6):
                        N[r, c] += w.extra[i, r, c]
            for r in range(6):
                for c in range(r + 1):
                    x = beyond[r, c] + N[r, c]
                    for j in range(m):
                        x -= U[j, r] * K[j, c]
                    beyond[r, c] = x
                    beyond[c, r] = x
    return True


@inner
def solve(t: Tables, w: Work, x: Array) -> None:
    """x <- (M + block)^-1 x with the factors of `factor`."""
    n = t.length.shape[0]
    f, A = w.vectors[JOINT_WRENCH], w.vectors[JOINT_ACCELERATION]
    clear(f)
    for i in range(n - 1, -1, -1):
        first = t.offset[i]
        m = t.offset[i + 1] - first
        if i < n - 1:
            wrench_to_parent(w.end_rotation[i], w.end_position[i], f)
            for j in range(m):
                x[first + j] -= dot6(w.end_columns[i, j], f)
        _cholesky_vector(m, w.mass[i], x, first)
        for j in range(m):
            for r in range(6):
                f[r] += w.force[i, j, r] * x[first + j]
    clear(A)
    for i in range(n):
        first = t.offset[i]
        if i > 0:
            for j in range(t.offset[i + 1] - first):
                x[first + j] -= dot6(w.gain[i, j], A)
        for j in range(t.offset[i + 1] - first):
            for r in range(6):
                A[r] += w.end_columns[i, j, r] * x[first + j]
        if i < n - 1:
            to_body(w.end_rotation[i], w.end_position[i], A)


@inner
def cholesky(m: int, D: Array) -> bool:
    """D (m, m) <- its lower factor, with reciprocals on the diagonal; False: not positive definite."""
    for j in range(m):
        d = D[j, j]
        least = ROUND_OFF * d
        for k in range(j):
            d -= D[j, k] * D[j, k]
        if not 0.0 < d < math.inf or d <= least:
            return False
        d = 1.0 / math.sqrt(d)
        D[j, j] = d  # the reciprocal, which is what the solutions need
        for i in range(j + 1, m):
            e = D[i, j]
            for k in range(j):
                e -= D[i, k] * D[j, k]
            D[i, j] = e * d
    return True


@inner
def _cholesky_rows(m: int, D: Array, U: Array, K: Array) -> None:
    """K <- D^-1 U (m, 6) with the factor of `cholesky`."""
    for i in range(m):
        assign(U[i], K[i])
        for k in range(i):
            for r in range(6):
                K[i, r] -= D[i, k] * K[k, r]
        for r in range(6):
            K[i, r] *= D[i, i]
    for i in range(m - 1, -1, -1):
        for k in range(i + 1, m):
            for r in range(6):
                K[i, r] -= D[k, i] * K[k, r]
        for r in range(6):
            K[i, r] *= D[i, i]


@inner
def _cholesky_vector(m: int, D: Array, x: Array, first: int) -> None:
    """Solve for x[first : first + m] with the factor of `cholesky`."""
    for i in range(m):
        y = x[first + i]
        for k in range(i):
            y -= D[i, k] * x[first + k]
        x[first + i] = y * D[i, i]
    for i in range(m - 1, -1, -1):
        y = x[first + i]
        for k in range(i + 1, m):
            y -= D[k, i] * x[first + k]
        x[first + i] = y * D[i, i]
