"""Stress and tangent of the laws are the derivatives of their energy."""

import numpy as np
import pytest

from soro_design.fem.elements.response import response

LAWS = {
    "yeoh": [0.0, 0.11, 0.02, 0.003, 0.0, 20.0],
    "mooney_rivlin": [0.0, 0.77, 0.0, 0.0, 2.94, 300.0],
    "st_venant_kirchhoff": [1.0, 2.3, 1.4, 0.0, 0.0, 0.0],
}


@pytest.fixture
def F():
    return np.eye(3) + 0.3 * np.random.default_rng(5).uniform(-1.0, 1.0, (3, 3))


def respond(law, F):
    P, A = np.empty((3, 3)), np.empty((9, 9))
    return response(np.array(LAWS[law]), F, P, A), P, A


@pytest.mark.parametrize("law", LAWS)
def test_stress_and_tangent_are_derivatives(law, F):
    _, P, A = respond(law, F)
    step = 1e-5
    for column in range(9):
        moved = np.zeros(9)
        moved[column] = step
        more, less = respond(law, F + moved.reshape(3, 3)), respond(law, F - moved.reshape(3, 3))
        assert P.flat[column] == pytest.approx((more[0] - less[0]) / (2 * step), rel=1e-6, abs=1e-6)
        slope = (more[1] - less[1]).ravel() / (2 * step)
        assert np.abs(A[:, column] - slope).max() < 1e-6 * np.abs(A).max()


@pytest.mark.parametrize("law", LAWS)
def test_a_turn_changes_no_energy(law, F):
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    energy, P, _ = respond(law, F)
    turned, P_turned, _ = respond(law, turn @ F)
    assert turned == pytest.approx(energy, rel=1e-12)
    np.testing.assert_allclose(P_turned, turn @ P, atol=1e-12 * np.abs(P).max())


@pytest.mark.parametrize("law", LAWS)
def test_an_undeformed_body_has_no_stress(law):
    energy, P, _ = respond(law, np.eye(3))
    assert energy == 0.0
    assert np.abs(P).max() < 1e-14
