"""Singular systems are refused by a measure: what LAPACK, or a pivot of exactly 0, decides is round-off.

These run under several kernels of OpenBLAS, which round in their own ways.
"""

import contextlib
from dataclasses import replace

import numba
import numpy as np
import pytest
from scipy.sparse import csc_array

from soro_core import SoftArm, linear, load_robot
from soro_core.adaptation import Learner
from soro_core.adaptation.config import LearnerConfig
from soro_core.config import find_config, parse
from soro_core.control import Controller, ControllerConfig, Point
from soro_core.control.nonuniform_strain import NonuniformStrain
from soro_core.errors import ModelError
from soro_core.model.links.articulated import cholesky
from soro_core.model.links.linear import cholesky_solve, lu_factor
from soro_core.robot import Discretisation
from soro_design.fem.solve.linear import regular_factors
from soro_lab.analysis.stiffness import tip_stiffness

pytestmark = pytest.mark.numerics

ROBOT = load_robot(find_config("tue_three_bellow", "robots"))
ARM = SoftArm(ROBOT)
# Sides of matrices, and how many decades the units of their rows and columns span.
SIZES, DECADES = (2, 3, 6, 12), (0, 3, 6)


@numba.njit
def factors(A):
    return lu_factor(A, np.empty(A.shape[0], np.int64))


@numba.njit
def has_root(A):
    return cholesky_solve(A, np.ones(A.shape[0]))


@numba.njit
def has_lower_factor(A):
    return cholesky(A.shape[0], A)


def in_units(matrix, decades, rng):
    """The same matrix with rows and columns in other units, symmetric where it is."""
    unit = 10.0 ** rng.uniform(-0.5 * decades, 0.5 * decades, len(matrix))
    return unit[:, None] * matrix * unit


def singular(count, decades, seed, symmetric=False):
    """Matrix of rank `count` - 1."""
    sizes = np.append(np.geomspace(1.0, 1e-2, count - 1), 0.0)
    return made(sizes, decades, seed, symmetric)


def regular(count, decades, seed):
    """Symmetric, positive definite matrix of condition 1e6."""
    return made(np.geomspace(1.0, 1e-6, count), decades, seed, symmetric=True)


def made(sizes, decades, seed, symmetric):
    """Matrix with these singular values, in other units."""
    rng = np.random.default_rng(seed)
    left, right = (np.linalg.qr(rng.normal(size=2 * (len(sizes),)))[0] for _ in range(2))
    return in_units(left * sizes @ (left if symmetric else right).T, decades, rng)


def test_lapack_itself_solves_singular_systems():
    """Why there is a measure."""
    found = []
    for seed in range(100):
        with contextlib.suppress(np.linalg.LinAlgError):
            found.append(np.linalg.solve(singular(3, 0, seed), np.ones(3)))
    assert len(found) > 10
    assert np.isfinite(found).all()


@pytest.mark.parametrize("decades", DECADES)
@pytest.mark.parametrize("count", SIZES)
def test_singular_matrices_are_refused_in_any_units(count, decades):
    for seed in range(20):
        matrix, even = singular(count, decades, seed), singular(count, decades, seed, symmetric=True)
        for one in (matrix, even):
            with pytest.raises(np.linalg.LinAlgError):
                linear.solve(one, np.ones(count))
            assert not factors(one.copy())
        first = regular(count - 1, decades, seed)
        mean = first.mean(axis=0)
        mass = np.block([[first, mean[:, None]], [mean, mean.mean()]])
        assert not has_root(mass.copy())
        assert not has_lower_factor(mass.copy())


@pytest.mark.parametrize("decades", DECADES)
@pytest.mark.parametrize("count", SIZES)
def test_regular_matrices_are_solved_in_any_units(count, decades):
    for seed in range(20):
        matrix = regular(count, decades, seed)
        wanted = np.ones(count) / np.sqrt(np.diag(matrix))
        np.testing.assert_allclose(linear.solve(matrix, matrix @ wanted), wanted, rtol=1e-6)
        for holds in (factors, has_root, has_lower_factor):
            assert holds(matrix.copy())


def test_a_part_is_noise_beside_a_whole_of_the_same_unit():
    whole = np.diag([1.0, 2e-12, 1e-12])
    linear.inverse(whole[1:, 1:], 1e-9)
    with pytest.raises(np.linalg.LinAlgError):
        linear.inverse(whole[1:, 1:], 1e-9, of=whole)


@pytest.mark.parametrize("value", [np.nan, np.inf, 0.0])
def test_what_is_not_finite_or_zero_is_singular(value):
    matrix = np.eye(3)
    matrix[1, 1] = value
    for of in (None, matrix):
        with pytest.raises(np.linalg.LinAlgError):
            linear.inverse(matrix, of=of)
    assert not factors(matrix.copy())


RANK_DEFICIENT = {
    "none": np.zeros((6, 6)),
    "in one direction": np.outer(np.arange(1.0, 7.0), np.arange(2.0, 8.0)),
    "in another": np.outer(*np.random.default_rng(1).normal(size=(2, 6))),
    "of round-off": 1e-13 * np.random.default_rng(3).normal(size=(6, 6)),
}


@pytest.mark.parametrize("kind", RANK_DEFICIENT)
def test_a_shape_without_stiffness_holds_the_set_points(kind):
    """At every column that the tick finds anew."""
    model = Discretisation(basis="legendre", order=1)
    controller = Controller(ROBOT, parse({"law": "composite"}, ControllerConfig, "test"), model)
    state, zero = controller.initial_state(), np.zeros(controller.arm.n_q)
    for k in range(20):
        state, command = controller.step(state, zero, zero, 0.005 * k, 0.005, np.zeros(3))
    for column in range(6):
        shape = replace(state.shape, stiffness=RANK_DEFICIENT[kind].copy(), column=column)
        limp = replace(state, shape=shape)
        after, held = controller.step(limp, zero, zero, 0.1, 0.005, np.zeros(3))
        assert not held.status.ok
        assert "balance" in held.status.message
        assert after is limp
        np.testing.assert_array_equal(held.setpoint_pa, command.setpoint_pa)


def test_non_uniform_strain_without_stiffness_has_no_equilibrium():
    nonuniform = NonuniformStrain(ARM)
    q = np.array([0.07, -6.0, 3.0])
    state, _ = nonuniform.step(nonuniform.initial_state(), Point(q, np.zeros(3), np.zeros(3)), 0.01)
    wide = len(state.slope)
    rng = np.random.default_rng(0)
    limp = replace(state, slope=rng.normal(size=(wide, 1)) @ rng.normal(size=(1, wide)))
    with pytest.raises(np.linalg.LinAlgError, match="no equilibrium"):
        nonuniform.step(limp, Point(q, np.zeros(3), np.zeros(3)), 0.01)


def test_singular_information_has_no_deviations():
    learner = Learner(ARM, parse({}, LearnerConfig, "test"))
    state = learner.initial_state()
    rows = np.random.default_rng(0).normal(size=(2, len(state.information)))
    assert np.isnan(learner.deviations(replace(state, information=rows.T @ rows))).all()


def test_a_tip_without_stiffness_has_no_compliance():
    stiffness = singular(3, 3, 0, symmetric=True)
    with pytest.raises(ModelError, match="no stiffness"):
        tip_stiffness(ARM, np.zeros(3), stiffness)


@pytest.mark.parametrize("seed", range(10))
def test_a_sparse_matrix_of_something_loose_has_no_factors(seed):
    """Springs between random nodes in space, and nothing that holds them."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(20, 30))
    rows -= rows.mean(axis=1, keepdims=True)  # no force where all nodes move alike
    stiffness = rows.T @ rows
    assert regular_factors(csc_array(stiffness)) is None
    assert regular_factors(csc_array(stiffness + 1e-6 * np.eye(30))) is not None
