"""The measured frame: rotation and offset come back, outliers do not rule, errors mean what they say."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.segment_runs import fit_frame
from soro_lab.identification import MeasurementFrame, curvature_errors

ANGLES = st.floats(-3.1, 3.1)
OFFSETS = st.floats(-2, 2)


def spiral(n: int = 200) -> np.ndarray:
    turn = np.linspace(0, 9, n)
    return np.column_stack([turn * np.cos(turn), turn * np.sin(turn)])


@given(rotation=ANGLES, x=OFFSETS, y=OFFSETS)
def test_fit_frame_recovers_rotation_and_offset(rotation: float, x: float, y: float) -> None:
    found = fit_frame(MeasurementFrame(rotation, (x, y)).apply(spiral()), spiral())
    assert found.rotation == pytest.approx(rotation, abs=1e-9)
    assert found.offset == pytest.approx((x, y), abs=1e-9)


@given(rotation=ANGLES, x=OFFSETS, y=OFFSETS)
def test_no_other_frame_is_closer(rotation: float, x: float, y: float) -> None:
    measured = spiral() + np.random.default_rng(0).normal(size=(200, 2))
    best = fit_frame(measured, spiral())
    error = curvature_errors(measured, spiral(), best.rotation, best.offset).vector
    assert error <= curvature_errors(measured, spiral(), rotation, (x, y)).vector + 1e-12


def test_rotation_is_counter_clockwise() -> None:
    np.testing.assert_allclose(
        MeasurementFrame(np.pi / 2, (0.5, 0.0)).apply([[1.0, 0.0]]), [[0.5, 1.0]], atol=1e-15
    )


def test_one_outlier_moves_the_robust_frame_hardly() -> None:
    measured = MeasurementFrame(-0.5, (0.4, 0.1)).apply(spiral())
    measured[50:55] += [0.0, 40.0]
    plain, robust = fit_frame(measured, spiral()), fit_frame(measured, spiral(), outlier_scale=0.05)
    assert abs(plain.offset[1] - 0.1) > 0.5
    assert robust.offset == pytest.approx((0.4, 0.1), abs=0.01)
    assert robust.rotation == pytest.approx(-0.5, abs=1e-3)


def test_errors_of_vector_and_magnitude() -> None:
    measured = np.array([[3.0, 4.0], [0.0, 2.0]])
    simulated = np.array([[4.0, 3.0], [0.0, 1.0]])
    found = curvature_errors(measured, simulated)
    assert found.vector == pytest.approx(np.sqrt((2.0 + 1.0) / 2))
    assert found.magnitude == pytest.approx(np.sqrt((0.0 + 1.0) / 2))
    # Offsets and rotation act on the simulated side.
    assert curvature_errors([[0.5, 1.0]], [[1.0, 0.0]], np.pi / 2, (0.5, 0.0)).vector == pytest.approx(
        0.0, abs=1e-12
    )


@pytest.mark.parametrize(
    "bad", [np.zeros((3, 3)), np.zeros((4, 2)), np.full((3, 2), np.nan), np.zeros((0, 2))]
)
def test_wrong_curvatures_are_refused(bad: np.ndarray) -> None:
    with pytest.raises(ValueError, match="curvatures"):
        fit_frame(np.zeros((3, 2)), bad)
