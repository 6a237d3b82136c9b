"""The nodes of a link against closed forms: those of scipy are roots of a Jacobi polynomial."""

import numpy as np
import pytest
from scipy.special import roots_jacobi

from soro_core.model.build import radau
from soro_core.robot.bases import gauss

NUMBERS = (1, 2, 3, 5, 8, 16, 32, 64)


@pytest.mark.parametrize("n", NUMBERS)
def test_nodes_are_real_and_right_to_the_last_digits(n):
    places, weights = radau(n)
    assert (places.dtype, weights.dtype) == (np.float64, np.float64)
    assert places[-1] == 1.0
    wanted = (1.0 - roots_jacobi(n - 1, 0.0, 1.0)[0][::-1]) / 2.0 if n > 1 else []
    assert places[:-1] == pytest.approx(wanted, rel=0.0, abs=3e-16)


@pytest.mark.parametrize("n", NUMBERS)
@pytest.mark.parametrize(("rule", "degree"), [(radau, lambda n: 2 * n - 2), (gauss, lambda n: 2 * n - 1)])
def test_rules_are_exact_up_to_their_degree(rule, degree, n):
    places, weights = rule(n)
    power = np.arange(degree(n) + 1)
    assert weights @ places[:, None] ** power == pytest.approx(1.0 / (power + 1.0), rel=1e-13)
