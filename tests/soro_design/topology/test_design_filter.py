"""Density filter, projection and moving asymptotes against what is known in closed form."""

import numpy as np
import pytest

from soro_design.topology.mma import mma_step, no_moves
from soro_design.topology.physics.filter import density_filter, greyness, projection
from soro_design.topology.physics.grid import make_grid


@pytest.mark.parametrize("space", ["plane_strain", "axisymmetric"])
def test_the_filter_is_a_mean_that_reaches_as_far_as_its_radius(space):
    grid = make_grid(space, (8.0, 5.0), (8, 5))
    weights = density_filter(grid, 1.5)
    assert weights @ np.ones(40) == pytest.approx(np.ones(40), abs=1e-14)
    one = np.zeros(40)
    one[22] = 1.0
    reached = np.hypot(*(grid.centres - grid.centres[22]).T) < 1.5
    assert ((weights @ one > 0.0) == reached).all()
    some, other = np.random.default_rng(1).normal(size=(2, 40))
    assert some @ (weights @ other) == pytest.approx(other @ (weights.T @ some))
    if space == "plane_strain":
        # Weights fall linearly: 1.5 at the centre, .5 at 4 neighbours, 1.5 - sqrt 2 at 4 corners.
        expected = 1.5 / (1.5 + 4 * 0.5 + 4 * (1.5 - np.sqrt(2.0)))
        assert (weights @ one)[22] == pytest.approx(expected)
    else:
        # About an axis, larger rings weigh more.
        assert (weights @ one)[17] > (weights @ one)[27]


def test_the_projection_steps_at_its_threshold():
    x = np.linspace(0.0, 1.0, 11)
    value, slope = projection(x, 8.0, 0.3)
    assert value[[0, -1]] == pytest.approx([0.0, 1.0], abs=1e-14)
    more, less = (projection(x + sign * 1e-6, 8.0, 0.3)[0] for sign in (1, -1))
    assert slope == pytest.approx((more - less) / 2e-6, rel=1e-7)
    assert (projection(x, 0.0, 0.3)[0] == x).all()
    sharp = projection(x, 200.0, 0.35)[0]
    assert sharp == pytest.approx((x > 0.35).astype(float), abs=1e-6)


def test_greyness_is_one_of_half_densities_and_zero_of_whole_ones():
    assert (greyness(np.full(3, 0.5)), greyness(np.array([0.0, 1.0]))) == (1.0, 0.0)


def test_moving_asymptotes_find_the_lightest_cantilever():
    """Svanberg's beam of five pieces: least 0.0624 sum x, sum c_i / x_i^3 <= 1, so x_i goes as c_i^(1/4)."""
    c = np.array([61.0, 37.0, 19.0, 7.0, 1.0])
    least = c**0.25 * (c**0.25).sum() ** (1.0 / 3.0)
    x, moves = np.full(5, 5.0), no_moves()
    bounds = (np.full(5, 1.0), np.full(5, 10.0))
    for _ in range(25):
        constraint, slope = (c / x**3).sum() - 1.0, -3.0 * c / x**4
        x, moves = mma_step(x, np.full(5, 0.0624), np.array([constraint]), slope[None], bounds, moves)
    assert x == pytest.approx(least, rel=1e-5)
    assert (c / x**3).sum() <= 1.0 + 1e-9
    assert 0.0624 * x.sum() == pytest.approx(1.340, abs=5e-4)


def test_moving_asymptotes_stay_within_bounds_and_recover_from_a_broken_constraint():
    x, moves = np.full(6, 0.9), no_moves()
    for _ in range(30):
        bounds = (np.maximum(x - 0.1, 0.0), np.minimum(x + 0.1, 1.0))
        x, moves = mma_step(
            x, -np.arange(1.0, 7.0), np.array([x.mean() / 0.5 - 1.0]), np.full((1, 6), 1 / 3.0), bounds, moves
        )
        assert (x >= bounds[0] - 1e-12).all()
        assert (x <= bounds[1] + 1e-12).all()
    assert x == pytest.approx([0, 0, 0, 1, 1, 1], abs=1e-3)
