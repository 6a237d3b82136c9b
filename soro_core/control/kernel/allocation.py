"""Bounded, weighted least squares of the pressures, compiled (`soro_core.control.pressures.allocation`).

A primal active-set method in scaled pressures. Every iterate is within the bounds, so the answer is
admissible even if the iterations run out; the problem is strictly convex, so the method terminates.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soro_core._jit import entry, inner
from soro_core.arrays import Array, Flags
from soro_core.model.links.linear import lu_factor, lu_solve

TOLERANCE = 1e-9
# Rows of H smaller than this part of the largest one of their kind are round-off: the sine of pi is 1e-16.
_ROUND_OFF = 1e-12


@entry
def solve(
    actuation: Array,
    force: Array,
    pressures: tuple[Array, Array, Array],
    weight: Array,
    regularisation: float,
    x: Array,
) -> int:
    """Move scaled pressures x from 0 to 1 to the least |A (H p - f)|^2 + rho |p - p_0|^2, (39).

    `pressures`: minimum, span and preferred pressure of each chamber, (n_u,) [Pa]. Gives the number of
    iterations: 0 for numbers that are not finite, negative if there were too many.
    """
    minimum_pa, span_pa, preferred_pa = pressures
    n_q, n = actuation.shape
    A, b = np.zeros((n_q, n)), np.zeros(n_q)
    hessian, linear = np.empty((n, n)), np.empty(n)
    for r in range(n_q):
        for c in range(n_q):
            missing = force[c]
            for u in range(n):
                A[r, u] += weight[r, c] * actuation[c, u]
                missing -= actuation[c, u] * minimum_pa[u]
            b[r] += weight[r, c] * missing
        for u in range(n):
            A[r, u] *= span_pa[u]
    trace = 0.0
    for u in range(n):
        linear[u] = 0.0
        for r in range(n_q):
            linear[u] += A[r, u] * b[r]
        for v in range(n):
            hessian[u, v] = 0.0
            for r in range(n_q):
                hessian[u, v] += A[r, u] * A[r, v]
        trace += hessian[u, u]
    rho = regularisation * max(trace / n, 1e-300)
    largest = 0.0
    for u in range(n):
        hessian[u, u] += rho
        linear[u] += rho * (preferred_pa[u] - minimum_pa[u]) / span_pa[u]
        if not math.isfinite(linear[u]):
            return 0
        for v in range(n):
            if not math.isfinite(hessian[u, v]):
                return 0
            largest = max(largest, abs(hessian[u, v]))
    return _active_set(hessian, linear, largest, x)


@inner
def _free_step(hessian: Array, slope: Array, free: Flags, step: Array) -> bool:
    """step <- the change of the free x that makes their slope 0; False if the matrix is singular."""
    count, n = 0, slope.shape[0]
    index = np.empty(n, np.int64)
    for u in range(n):
        step[u] = 0.0
        if free[u]:
            index[count] = u
            count += 1
    G, right, pivots = np.empty((count, count)), np.empty(count), np.empty(count, np.int64)
    for k in range(count):
        right[k] = -slope[index[k]]
        for j in range(count):
            G[k, j] = hessian[index[k], index[j]]
    if not lu_factor(G, pivots):
        return False
    lu_solve(G, pivots, right)
    for k in range(count):
        step[index[k]] = right[k]
    return True


@inner
def _active_set(hessian: Array, linear: Array, largest: float, x: Array) -> int:
    """Minimise x'Gx/2 - c'x over [0, 1]^n from a feasible x, G positive definite; gives the iterations."""
    n = x.shape[0]
    free, slope, step = np.empty(n, np.bool_), np.empty(n), np.empty(n)
    for u in range(n):
        free[u] = 0.0 < x[u] < 1.0
    most: int = 10 * n + 9
    for iteration in range(1, most + 1):
        for u in range(n):
            slope[u] = -linear[u]
            for v in range(n):
                slope[u] += hessian[u, v] * x[v]
        if not _free_step(hessian, slope, free, step):
            return -iteration
        # The first bound on the way.
        share, blocking = 1.0, -1
        for u in range(n):
            if free[u] and step[u] != 0.0:
                ratio = ((1.0 if step[u] > 0.0 else 0.0) - x[u]) / step[u]
                if ratio < share:
                    share, blocking = ratio, u
        share = max(share, 0.0)
        for u in range(n):
            if free[u]:
                x[u] = min(max(x[u] + share * step[u], 0.0), 1.0)
        if blocking >= 0:
            x[blocking] = 1.0 if step[blocking] > 0.0 else 0.0
            free[blocking] = False
            continue
        # Multipliers of the bounds: positive where moving inwards would lower the cost.
        worst, gain = -1, TOLERANCE * largest
        for u in range(n):
            if not free[u]:
                slope[u] = -linear[u]
                for v in range(n):
                    slope[u] += hessian[u, v] * x[v]
                inwards = -slope[u] if x[u] <= 0.0 else slope[u]
                if inwards > gain:
                    worst, gain = u, inwards
        if worst < 0:
            return iteration
        free[worst] = True
    return -most


@entry
def balance(root: Array, index: NDArray[np.int64], stretch: Flags, actuation: Array, weight: Array) -> None:
    """weight <- A of `control.pressures.allocation.balanced_weight`, with `stretch` (n_strains,)."""
    n_q, n_u = actuation.shape
    square, largest = np.zeros(stretch.shape[0]), np.zeros(2)
    for r in range(n_q):
        for u in range(n_u):
            row = 0.0
            for c in range(n_q):
                row += root[r, c] * actuation[c, u]
            square[index[r]] += row * row
    for k in range(stretch.shape[0]):
        square[k] = math.sqrt(square[k])
        kind = 1 if stretch[k] else 0
        largest[kind] = max(largest[kind], square[k])
    for r in range(n_q):
        length = square[index[r]]
        driven = length > _ROUND_OFF * largest[1 if stretch[index[r]] else 0]
        for c in range(n_q):
            weight[r, c] = root[r, c] / length if driven else 0.0
