"""Projection onto the admissible parameters: inside, nearest, and never farther from any admissible point."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from soro_core.control.passivity.projection import Pair, Polytope

SEEDS = st.integers(0, 2**32 - 1)


def polytope(seed):
    rng = np.random.default_rng(seed)
    lower = rng.uniform(-1.0, 0.2, 6)
    upper = lower + rng.uniform(0.5, 2.0, 6)
    # The pairs must leave room: the largest high minus the smallest low is above the margin.
    room01, room23 = upper[0] - lower[1], upper[2] - lower[3]
    pairs = (
        Pair(0, 1, room01 - rng.uniform(0.1, 2.0)),
        Pair(2, 3, room23 - rng.uniform(0.1, 2.0)),
        Pair(4, -1, 0.2, low_value=upper[4] - 0.4),
    )
    return Polytope(lower, upper, 10.0 ** rng.uniform(-3, 3, 6), pairs), rng


def admissible(shape, rng):
    point = rng.uniform(shape.lower, shape.upper)
    for pair in shape.pairs:
        low = pair.low_value
        if pair.low >= 0:
            low = rng.uniform(
                shape.lower[pair.low], min(shape.upper[pair.low], shape.upper[pair.high] - pair.margin)
            )
            point[pair.low] = low
        point[pair.high] = rng.uniform(max(shape.lower[pair.high], low + pair.margin), shape.upper[pair.high])
    assert shape.contains(point)
    return point


@given(SEEDS)
@settings(max_examples=200, deadline=None)
def test_the_result_is_admissible_and_nothing_admissible_gets_farther(seed):
    shape, rng = polytope(seed)
    value = rng.uniform(-6.0, 6.0, 6)
    result = shape.project(value)
    assert shape.contains(result)
    true = admissible(shape, rng)
    before = np.sum((value - true) ** 2 / shape.gain)
    after = np.sum((result - true) ** 2 / shape.gain)
    assert after <= before * (1 + 1e-12)
    # Variational inequality of a projection: the angle at the result is never acute.
    assert np.sum((value - result) * (true - result) / shape.gain) <= 1e-9 * (1 + before)


@pytest.mark.parametrize("seed", range(8))
def test_it_is_the_nearest_point_in_the_metric_of_the_gains(seed):
    shape, rng = polytope(seed)
    value = rng.uniform(-3.0, 3.0, 6)
    result = shape.project(value)
    scale = np.sqrt(shape.gain)
    constraints = [
        {"type": "ineq", "fun": lambda z, p=p: (z * scale)[p.high] - (z * scale)[p.low] - p.margin}
        for p in shape.pairs[:2]
    ]
    p = shape.pairs[2]
    constraints.append({"type": "ineq", "fun": lambda z: (z * scale)[4] - p.low_value - p.margin})
    found = minimize(
        lambda z: np.sum((z - value / scale) ** 2),
        admissible(shape, rng) / scale,
        bounds=list(zip(shape.lower / scale, shape.upper / scale, strict=True)),
        constraints=constraints,
        method="SLSQP",
        options={"ftol": 1e-15, "maxiter": 500},
    )
    mine = np.sum(((result - value) / scale) ** 2)
    assert mine <= found.fun * (1 + 1e-5) + 1e-9


def test_a_point_inside_is_left_alone():
    shape, rng = polytope(5)
    inside = admissible(shape, rng)
    assert shape.project(inside).tolist() == inside.tolist()


def test_the_constant_half_of_a_pair_stays_constant():
    shape = Polytope(np.array([0.0]), np.array([10.0]), np.array([1.0]), (Pair(0, -1, 0.5, low_value=2.0),))
    assert shape.project(np.array([1.0])).tolist() == [2.5]
    shape = Polytope(np.array([0.0]), np.array([10.0]), np.array([1.0]), (Pair(-1, 0, 0.5, high_value=2.0),))
    assert shape.project(np.array([3.0])).tolist() == [1.5]


def test_a_parameter_without_gain_does_not_move():
    shape = Polytope(np.array([0.0, 0.0]), np.array([9.0, 9.0]), np.array([1.0, 0.0]), (Pair(0, 1, 1.0),))
    assert shape.project(np.array([1.0, 2.0])).tolist() == [3.0, 2.0]
