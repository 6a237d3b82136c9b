"""Profiles of toy problems whose answer is known: a parabola, a banana, a number that the data do not see."""

import numpy as np
import pytest

from soro_lab.identification.arm.search.profile import Optimum, Profile, linear, searched

WIDE = np.full(2, -1e3), np.full(2, 1e3)


def test_of_a_linear_problem_the_profile_is_the_parabola_of_the_covariance() -> None:
    # Many rows, each far below one expected error, where the soft loss is a square.
    jacobian = np.random.default_rng(1).normal(size=(20_000, 3)) @ np.array(
        [[1.0, 0.9, 0.0], [0.0, 0.5, 0.2], [0.0, 0.0, 2.0]]
    )
    low, high = np.full(3, -1e3), np.full(3, 1e3)
    optimum = Optimum(np.zeros(3), np.zeros(20_000), jacobian, low, high)
    spread = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian + np.eye(3))))
    for k in range(3):
        for points in (
            linear(optimum, k, spread[k]),
            searched(lambda x: jacobian @ x, optimum, k, spread[k]),
        ):
            assert [p.at for p in points] == [-2.0, -1.0, 1.0, 2.0]
            np.testing.assert_allclose([p.rise for p in points], [4.0, 1.0, 1.0, 4.0], rtol=1e-3)
            assert Profile("k", True, points).text == "as the parabola"


def _banana(x: np.ndarray) -> np.ndarray:
    """One curved valley: the second number follows the square of the first, and the first is nearly open."""
    return np.concatenate([np.full(400, x[1] - x[0] ** 2), np.full(100, 0.08 * x[0])])


def test_a_banana_is_flatter_than_its_linear_profile() -> None:
    # About 1, where the slope of the valley is 2; the rows are made 0 there.
    middle = np.array([1.0, 1.0])

    def rows(x: np.ndarray) -> np.ndarray:
        return _banana(x + middle) - _banana(middle)

    step = 1e-6
    jacobian = np.column_stack([(rows(step * e) - rows(np.zeros(2))) / step for e in np.eye(2)])
    optimum = Optimum(np.zeros(2), rows(np.zeros(2)), jacobian, *WIDE)
    spread = float(np.sqrt(np.linalg.inv(jacobian.T @ jacobian + np.eye(2))[0, 0]))
    exact = []
    for k in (-2.0, -1.0, 1.0, 2.0):
        second = np.linspace(-6.0, 6.0, 240_001)
        first = k * spread
        valley = (second + 1.0) - (first + 1.0) ** 2
        cost = 400 * (np.sqrt(1 + valley**2) - 1) + 100 * (np.sqrt(1 + (0.08 * first) ** 2) - 1)
        exact.append(float((cost + 0.5 * (first**2 + second**2)).min()) / 0.5)
    found = [p.rise for p in searched(rows, optimum, 0, spread, most=12)]
    np.testing.assert_allclose(found, exact, rtol=0.05)
    # Where the numbers do not follow the bend, the linear profile has the same rise on both sides.
    straight = [p.rise for p in linear(optimum, 0, spread)]
    np.testing.assert_allclose(straight, straight[::-1], rtol=1e-6)
    assert abs(found[0] - found[-1]) > 0.5


def test_a_number_that_the_data_do_not_see_is_flat() -> None:
    jacobian = np.column_stack([np.full(1000, 1.0), np.zeros(1000)])
    optimum = Optimum(np.zeros(2), np.zeros(1000), jacobian, *WIDE)
    profile = Profile("x", False, linear(optimum, 1, 1.0))
    assert (profile.below, profile.above) == ("flat", "flat")
    np.testing.assert_allclose([p.rise for p in profile.points], [4.0, 1.0, 1.0, 4.0])  # the prior alone


def test_a_number_that_shows_on_one_side_is_open_on_the_other() -> None:
    def rows(x: np.ndarray) -> np.ndarray:
        return 0.3 * np.full(1000, np.maximum(x[0], 0.0) + 0.01 * x[0])

    jacobian = np.column_stack([np.full(1000, 0.05), np.zeros(1000)])
    optimum = Optimum(np.zeros(2), rows(np.zeros(2)), jacobian, *WIDE)
    profile = Profile("x", True, searched(rows, optimum, 0, 1.0))
    assert (profile.below, profile.above) == ("flat", "steeper")


def test_beyond_a_bound_there_is_no_profile() -> None:
    jacobian = np.ones((1000, 1)) * 0.03
    optimum = Optimum(np.zeros(1), np.zeros(1000), jacobian, np.array([-0.01]), np.array([10.0]))
    points = linear(optimum, 0, 1.0)
    assert [p.at for p in points] == [1.0, 2.0]
    assert Profile("x", False, points).below == "bound"


def test_a_solution_that_is_no_minimum_is_found_out() -> None:
    jacobian = np.ones((1000, 1)) * 0.1
    optimum = Optimum(np.zeros(1), jacobian @ [3.0], jacobian, np.array([-9.0]), np.array([9.0]))
    assert Profile("x", False, linear(optimum, 0, 0.5)).below == "lower"


def test_where_no_arm_can_be_simulated_the_profile_ends() -> None:
    jacobian = np.ones((1000, 1)) * 0.03
    optimum = Optimum(np.zeros(1), np.zeros(1000), jacobian, np.array([-9.0]), np.array([9.0]))
    points = searched(lambda x: None if x[0] > 1.5 else jacobian @ x, optimum, 0, 1.0)
    assert [p.at for p in points] == [-2.0, -1.0, 1.0]
    assert points[0].rise == pytest.approx(points[0].of_data + 0.5 * 4.0 / _unit(jacobian), rel=1e-9)


def _unit(jacobian: np.ndarray) -> float:
    return 0.5 * float((jacobian.T @ jacobian)[0, 0] + 1.0)
