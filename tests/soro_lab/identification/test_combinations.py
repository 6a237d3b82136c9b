"""Ratios and products that data determine although they leave the numbers themselves open."""

import numpy as np
import pytest

from soro_lab.identification.arm.cases.parameters import ArmParameter
from soro_lab.identification.arm.search.combinations import combinations
from soro_lab.identification.arm.search.uncertainty import Uncertainty

NAMES = ("link0/k_e", "link0/gain", "link0/arm", "link0/k_b")
VALUES = {"link0/k_e": 900.0, "link0/gain": 1.2, "link0/arm": 0.8, "link0/k_b": 0.03}


def certainty(covariance, at_bound=()):
    """Of numbers whose logarithms have this covariance."""
    spread = np.sqrt(np.diag(covariance))
    deviations = dict(zip(NAMES, spread, strict=True))
    return Uncertainty(deviations, covariance / np.outer(spread, spread), {}, at_bound)


def numbers():
    return [ArmParameter(name, VALUES[name], "1", "factor", 1.0, 1e-9, 1e9) for name in NAMES]


def covariance():
    """A common factor of stiffness and gain is open, 30 %; their ratio and gain times arm are seen."""
    draw = np.random.default_rng(1)
    common, ratio, product, own = (size * draw.normal(size=4000) for size in (0.3, 0.004, 0.01, 0.01))
    return np.cov([common, common + ratio, -common + product, own])


def test_a_ratio_and_a_product_are_known_where_their_numbers_are_not():
    ratio, product = combinations(numbers(), certainty(covariance()), VALUES)
    assert ratio.name == "link0/k_e:link0/gain"
    assert ratio.value == pytest.approx(750.0)
    assert ratio.deviation == pytest.approx(0.004, rel=0.05)
    assert product.name == "link0/k_e*link0/arm"
    assert product.value == pytest.approx(720.0)
    assert product.deviation == pytest.approx(0.01, rel=0.05)


def test_numbers_that_are_sure_or_at_a_bound_have_none():
    assert combinations(numbers(), certainty(1e-4 * covariance()), VALUES) == ()
    names = {
        name
        for found in combinations(numbers(), certainty(covariance(), ("link0/gain",)), VALUES)
        for name in (found.first, found.second)
    }
    assert names == {"link0/k_e", "link0/arm"}


def test_numbers_that_have_nothing_in_common_have_none():
    assert combinations(numbers(), certainty(np.diag([0.09, 0.09, 0.09, 0.09])), VALUES) == ()
