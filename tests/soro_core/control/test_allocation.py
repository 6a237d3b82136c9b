"""Bounded allocation: against scipy, its optimality conditions, and inputs that are not numbers."""

import itertools
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from soro_core import SoftArm, load_robot
from soro_core.config import find_config
from soro_core.control.pressures.allocation import allocate
from soro_core.control.pressures.allocation import balanced_weight as weight_of_fields
from soro_core.robot import robot_from_dict
from soro_core.robot.coordinates import strain_fields

pytestmark = pytest.mark.numerics

MATERIAL = {"youngs_modulus": 1e6, "shear_modulus": 4e5}


def balanced_weight(actuation):
    """Of as many constant strains as there are rows: one link each."""
    link = {"length": 0.1, "radius": 0.01, "mass": 0.1, "material": MATERIAL, "strains": {"elongation": {}}}
    return weight_of_fields(actuation, strain_fields(robot_from_dict({"links": [link] * len(actuation)})))


def problem(seed, n_q, n_u):
    rng = np.random.default_rng(seed)
    scale = np.where(np.arange(n_q) % 3 == 0, 2e-6, 1.6e-8)  # metres cubed and metres to the fourth
    actuation = scale[:, None] * rng.standard_normal((n_q, n_u))
    lower = rng.uniform(-5e4, 0.0, n_u)
    upper = rng.uniform(1e4, 9e4, n_u)
    inside = rng.uniform(-0.6, 1.6, n_u)  # now and then beyond a bound
    force = actuation @ (lower + inside * (upper - lower)) + scale * rng.normal(0.0, 1e4, n_q)
    start = rng.uniform(lower - 1e4, upper + 1e4)
    return actuation, force, lower, upper, start


def quadratic(actuation, force, lower, upper, weight, rho, preferred):
    """The problem in scaled pressures as one stacked least squares."""
    span = upper - lower
    a = weight @ actuation * span
    r = np.sqrt(rho * np.trace(a.T @ a) / len(span))
    stacked = np.vstack([a, r * np.eye(len(span))])
    right = np.concatenate([weight @ (force - actuation @ lower), r * (preferred - lower) / span])
    return stacked, right


@given(st.integers(0, 2**32 - 1), st.integers(1, 6), st.integers(1, 8))
@settings(max_examples=150, deadline=None)
def test_agrees_with_lsq_linear_and_fulfils_the_kkt_conditions(seed, n_q, n_u):
    actuation, force, lower, upper, start = problem(seed, n_q, n_u)
    weight, preferred = balanced_weight(actuation), 0.5 * (lower + upper)
    found = allocate(actuation, force, lower, upper, weight, 1e-4, preferred, start)
    assert found.ok
    assert np.all(found.pressure_pa >= lower)
    assert np.all(found.pressure_pa <= upper)

    a, b = quadratic(actuation, force, lower, upper, weight, 1e-4, preferred)
    x = (found.pressure_pa - lower) / (upper - lower)
    expected = lsq_linear(a, b, (0.0, 1.0), method="bvls", tol=1e-14).x
    cost, best = np.sum((a @ x - b) ** 2), np.sum((a @ expected - b) ** 2)
    assert cost <= best * (1 + 1e-9) + 1e-12 * np.sum(b * b)

    slope = a.T @ (a @ x - b)
    size = 1e-7 * (np.abs(a.T @ b).max() + np.abs(a.T @ a).max())
    inside = ~found.saturated
    assert np.all(np.abs(slope[inside]) < size)
    assert np.all(slope[x <= 1e-9] > -size)
    assert np.all(slope[x >= 1 - 1e-9] < size)


@pytest.mark.parametrize("seed", range(20))
def test_three_chambers_against_brute_force_over_all_active_sets(seed):
    actuation, force, lower, upper, start = problem(seed, 3, 3)
    weight, preferred = balanced_weight(actuation), 0.5 * (lower + upper)
    a, b = quadratic(actuation, force, lower, upper, weight, 1e-6, preferred)
    best = np.inf
    for state in itertools.product((0.0, 1.0, None), repeat=3):
        x = np.array([np.nan if s is None else s for s in state])
        free = np.isnan(x)
        fixed = np.where(free, 0.0, x)
        if free.any():
            fixed[free] = np.linalg.lstsq(a[:, free], b - a @ fixed, rcond=None)[0]
        if np.all(fixed >= -1e-12) and np.all(fixed <= 1 + 1e-12):
            best = min(best, np.sum((a @ fixed - b) ** 2))
    found = allocate(actuation, force, lower, upper, weight, 1e-6, preferred, start)
    x = (found.pressure_pa - lower) / (upper - lower)
    assert np.sum((a @ x - b) ** 2) <= best * (1 + 1e-9) + 1e-14


def bellows():
    angles = np.array([0.0, 2.0, 4.0]) * np.pi / 3
    return np.vstack([np.full(3, 2e-6), -1.61e-8 * np.cos(angles), -1.61e-8 * np.sin(angles)])


def solve(force, start=None, preferred=45e3):
    h = bellows()
    low, high = np.zeros(3), np.full(3, 90e3)
    start = low if start is None else start
    return h, allocate(h, force, low, high, balanced_weight(h), 1e-9, np.full(3, preferred), start)


def test_a_reachable_force_is_made_exactly():
    desired = np.array([10e3, 40e3, 70e3])
    h, found = solve(bellows() @ desired)
    assert found.pressure_pa == pytest.approx(desired, rel=1e-5)
    assert found.force == pytest.approx(h @ desired, rel=1e-5)
    assert not found.saturated.any()


def test_an_unreachable_force_saturates_and_is_flagged():
    _, found = solve(bellows() @ np.array([-40e3, 40e3, 120e3]))
    assert found.saturated.tolist() == [True, False, True]
    assert found.pressure_pa[0] == 0.0
    assert found.pressure_pa[2] == 90e3


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_input_that_is_no_number_returns_the_start_within_the_bounds(bad):
    _, found = solve(np.array([bad, 0.0, 0.0]), start=np.array([1e3, -1e3, 200e3]))
    assert not found.ok
    assert found.pressure_pa.tolist() == [1e3, 0.0, 90e3]
    assert np.all(np.isfinite(found.force))


def test_without_actuation_the_preferred_pressure_is_kept():
    low, high = np.zeros(2), np.full(2, 90e3)
    found = allocate(np.zeros((3, 2)), np.ones(3), low, high, np.eye(3), 1e-6, np.full(2, 30e3), low)
    assert found.ok
    assert found.pressure_pa == pytest.approx([30e3, 30e3])


def test_the_round_off_of_an_angle_takes_nothing_from_a_bending_that_chambers_make():
    """A chamber at angle pi leaves 1e-22 in the row of the other bending, which no chamber makes."""
    arm = SoftArm(load_robot(find_config("asu_two_segment", "robots")))
    actuation, fields = arm.actuation_matrix(np.zeros(6)), strain_fields(arm.robot)
    assert 0.0 < np.abs(actuation[2]).max() < 1e-12 * np.abs(actuation[1]).max()
    weight = weight_of_fields(actuation, fields)
    assert not weight[[2, 5]].any()
    # The moment of 50 kPa, and one about the other axis that cannot be made.
    desired = actuation @ np.array([0.0, 50e3, 20e3, 30e3, 0.0, 10e3])
    desired[[2, 5]] = desired[1]
    low, high = np.zeros(6), np.full(6, 110e3)
    found = allocate(actuation, desired, low, high, weight, 1e-8, np.full(6, 55e3), low)
    assert found.force[[0, 1, 3, 4]] == pytest.approx(desired[[0, 1, 3, 4]], rel=1e-4)


def test_a_weak_chamber_is_used_for_what_it_alone_makes():
    """Chambers of a thousandth of the strongest force and of the strongest moment."""
    fields = strain_fields(load_robot(find_config("asu_two_segment", "robots")))
    actuation = np.diag([2e-6, 1.6e-8, 1.6e-11, 2e-9, 1.6e-8, 1.6e-11])
    wanted = np.array([20e3, 60e3, 70e3, 40e3, 30e3, 10e3])
    low, high = np.zeros(6), np.full(6, 90e3)
    weight = weight_of_fields(actuation, fields)
    found = allocate(actuation, actuation @ wanted, low, high, weight, 1e-8, np.full(6, 45e3), low)
    assert found.pressure_pa == pytest.approx(wanted, rel=1e-4)


def test_it_is_quick_from_the_last_answer():
    # A generous bound on counts rather than on time keeps this deterministic; the time is printed.
    rng = np.random.default_rng(3)
    start, iterations = np.full(3, 45e3), []
    began = time.perf_counter()
    for _ in range(300):
        desired = np.clip(start + rng.normal(0.0, 4e3, 3), -10e3, 100e3)
        _, found = solve(bellows() @ desired, start=start)
        start = found.pressure_pa
        iterations.append(found.iterations)
    print(f"allocation of 3 chambers: {(time.perf_counter() - began) / 300 * 1e6:.0f} us")
    assert np.mean(iterations) < 2.5
    assert max(iterations) <= 8
