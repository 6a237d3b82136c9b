"""Rotations against scipy, and their derivatives against differences."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from soro_core.rotation import (
    left_jacobian_inverse,
    matrix_from_quaternion,
    quaternion_from_matrix,
    quaternion_log,
    rotation_exp,
    rotation_log,
)

VECTORS = st.tuples(
    st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1e-12, 1e-7, 9e-5, 2e-4, 0.3, 2.0, 3.1, 3.14159])
)


def vector(seed, length):
    v = np.random.default_rng(seed).standard_normal(3)
    return length * v / np.linalg.norm(v)


@given(VECTORS)
@settings(max_examples=150)
def test_exp_and_log_agree_with_scipy_and_invert_each_other(case):
    v = vector(*case)
    rotation = rotation_exp(v)
    assert rotation == pytest.approx(Rotation.from_rotvec(v).as_matrix(), abs=1e-12)
    assert rotation_log(rotation) == pytest.approx(v, abs=1e-8)
    quaternion = Rotation.from_rotvec(v).as_quat()
    assert quaternion_log(quaternion) == pytest.approx(v, abs=1e-8)
    assert quaternion_log(-quaternion) == pytest.approx(v, abs=1e-8)
    assert matrix_from_quaternion(3.0 * quaternion) == pytest.approx(rotation, abs=1e-12)
    assert rotation_exp(quaternion_log(quaternion_from_matrix(rotation))) == pytest.approx(
        rotation, abs=1e-12
    )


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=100)
def test_quaternion_of_a_matrix_at_every_angle(seed):
    rotation = Rotation.random(random_state=seed)
    quaternion = quaternion_from_matrix(rotation.as_matrix())
    assert abs(quaternion @ rotation.as_quat()) == pytest.approx(1.0, abs=1e-12)
    half_turn = Rotation.from_rotvec(np.pi * vector(seed, 1.0))
    assert abs(quaternion_from_matrix(half_turn.as_matrix()) @ half_turn.as_quat()) == pytest.approx(
        1.0, abs=1e-9
    )


@given(st.tuples(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 5e-5, 2e-4, 0.3, 2.0, 3.0])))
@settings(max_examples=60)
def test_the_derivative_of_the_log_against_differences(case):
    v, h = vector(*case), 1e-6
    columns = [
        (
            rotation_log(rotation_exp(h * axis) @ rotation_exp(v))
            - rotation_log(rotation_exp(-h * axis) @ rotation_exp(v))
        )
        / (2 * h)
        for axis in np.eye(3)
    ]
    assert left_jacobian_inverse(v) == pytest.approx(np.array(columns).T, abs=1e-6)
