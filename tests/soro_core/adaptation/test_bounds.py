"""A quadratic form within bounds, against a solver of scipy."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from soro_core.adaptation.learning.bounds import bounded_minimum


def problem(seed, n=8):
    rng = np.random.default_rng(seed)
    rows, right = rng.standard_normal((2 * n, n)), 2.0 * rng.standard_normal(2 * n)
    return rows, right, rows.T @ rows, rows.T @ right


def test_what_is_within_the_bounds_stays():
    *_, A, b = problem(0)
    free = np.linalg.solve(A, b)
    assert bounded_minimum(A, b, free, free - 1e-3, free + 1e-3) is free


@pytest.mark.parametrize("seed", range(20))
def test_one_bound_that_binds_gives_the_minimum(seed):
    rows, right, A, b = problem(seed)
    free = np.linalg.solve(A, b)
    lower, upper = np.full(free.size, -np.inf), np.full(free.size, np.inf)
    k = seed % free.size
    upper[k] = free[k] - 0.3
    found = bounded_minimum(A, b, free, lower, upper)
    np.testing.assert_allclose(found, lsq_linear(rows, right, (lower, upper)).x, atol=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_several_bounds_give_nearly_the_minimum_and_never_more_than_clipping(seed):
    rows, right, A, b = problem(seed)
    free = np.linalg.solve(A, b)
    bound = np.full(free.size, 0.4)

    def cost(theta):
        return 0.5 * theta @ A @ theta - b @ theta

    found = bounded_minimum(A, b, free, -bound, bound)
    assert (np.abs(found) <= bound).all()
    best = cost(lsq_linear(rows, right, (-bound, bound)).x)
    clipped = cost(np.clip(free, -bound, bound))
    assert cost(found) - best <= 0.1 * (clipped - best) + 1e-9
