"""Strain fields: weights, means, uniform strains and limits, whatever the shape functions."""

import numpy as np
import pytest
from numpy.polynomial import legendre

from soro_core.robot import robot_from_dict, shape_values
from soro_core.robot.coordinates import strain_fields

STRAINS = ("elongation", "bending_x", "bending_y")
AT = np.linspace(0.0, 1.0, 21)
MODES = np.stack([2.0 + AT, AT**2, np.sin(3 * AT)], axis=1)


def arm_of(field, links=1):
    link = {
        "length": 0.064,
        "radius": 0.013,
        "mass": 0.017,
        "material": {"youngs_modulus": 3e5, "shear_modulus": 1e5},
        "strains": dict.fromkeys(STRAINS, field),
    }
    return robot_from_dict({"links": [link] * links})


def polynomial(basis, order):
    return {"basis": basis, "order": order}


@pytest.mark.parametrize(
    "field", [{}, polynomial("legendre", 3), polynomial("chebyshev", 4), {"basis": "pod", "samples": MODES}]
)
def test_weights_means_and_uniform_strains(field):
    robot = arm_of(field, links=2)
    fields, n = strain_fields(robot), robot.n_q // 6
    assert fields.strains == STRAINS * 2
    assert fields.links == (0, 0, 0, 1, 1, 1)
    assert fields.index.tolist() == np.repeat(np.arange(6), n).tolist()
    assert fields.stretch.tolist() == ([True] * n + [False] * 2 * n) * 2
    x, w = legendre.leggauss(400)
    shapes = shape_values(robot.links[0], (x + 1) / 2 * 0.064)[:n]
    np.testing.assert_allclose(fields.weight[:n, :n], (shapes * w / 2) @ shapes.T, atol=1e-6)
    assert not fields.weight[:n, n:].any()
    np.testing.assert_allclose(fields.mean[:n], shapes @ w / 2, atol=1e-6)
    # No other coefficients come closer to a strain of 1.
    rest = 1.0 - fields.uniform[:n] @ shapes
    np.testing.assert_allclose((shapes * w) @ rest, 0.0, atol=1e-5)
    if field.get("basis") != "pod":
        assert fields.uniform.tolist() == ([1.0] + [0.0] * (n - 1)) * 6
    q = np.random.default_rng(1).normal(size=robot.n_q)
    fine = shape_values(robot.links[0], np.linspace(0.0, 0.064, 2001))[n : 2 * n]
    assert fields.peaks(q)[n] == pytest.approx(np.abs(q[n : 2 * n] @ fine).max(), rel=2e-2)
    assert fields.of("bending_x", 1).nonzero()[0].tolist() == list(range(4 * n, 5 * n))


def test_a_field_beyond_its_limit_is_scaled_as_a_whole():
    fields = strain_fields(arm_of(polynomial("legendre", 1)))
    limit = np.array([0.5, 0.5, 20.0, 20.0, 20.0, 20.0])
    q = np.array([0.3, 0.3, 10.0, -5.0, 1e300, -1e300])
    found = fields.within(q, limit)
    np.testing.assert_allclose(found[:4], [0.25, 0.25, 10.0, -5.0])
    np.testing.assert_allclose(found[4:], [10.0, -10.0])
    constant = strain_fields(arm_of({}))
    q, limit = np.array([0.7, -30.0, 19.0]), np.array([0.6, 20.1, 20.1])
    assert constant.within(q, limit).tolist() == np.clip(q, -limit, limit).tolist()
