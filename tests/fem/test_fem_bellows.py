"""Bellows: their outline, and force against extension of the three-bellow part of the thesis."""

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_core.fem.bellows import Bellows, bellows_mesh
from tests.fem.three_bellow import ALONG, SHAPE, THESIS, forces
from tests.refused import fails


def test_force_of_the_three_bellow_part(figure):
    thesis = np.array(list(THESIS.values()))
    guided, clamped = forces(False, 0.5), forces(True, 4.0)
    off = guided / thesis - 1
    figure(f"three-bellow part: off by {off.min():+.1%} to {off.max():+.1%}; {guided[-1]:.2f} N at 20 mm")
    figure(f"with ends that cannot widen {(clamped / thesis - 1).max():+.1%} at most")
    assert np.abs(off).max() < 0.06
    # Clamps that keep the ends from widening are stiffer, by little.
    assert (clamped > guided).all()
    assert (clamped < 1.015 * guided).all()


def test_half_a_lobe_stands_for_all():
    np.testing.assert_allclose(forces(False, 0.5), forces(False, 2.0), rtol=1e-6)


def test_the_wall_has_its_thickness_and_its_outline():
    mesh = bellows_mesh("quad8", SHAPE, 1, ALONG)
    r, z = mesh.points.T
    assert (r.min(), r.max()) == pytest.approx((2.8e-3, 12.6e-3))
    assert (z.min(), z.max()) == pytest.approx((0.0, 8 * 6.975e-3))
    # Corners of each element lie across the wall from each other.
    corners = mesh.points[mesh.cells[:, :4]]
    for a, b in ((0, 1), (3, 2)):
        across = np.linalg.norm(corners[:, a] - corners[:, b], axis=1)
        np.testing.assert_allclose(across, 0.8e-3, rtol=1e-9)


@pytest.mark.parametrize(
    ("key", "value"), [("lobes", 0), ("lobe_width", 2e-3), ("neck_radius", 0.5e-3), ("wall", 1.2e-3)]
)
def test_what_is_refused(key, value):
    values = {name: getattr(SHAPE, name) for name in SHAPE.__dataclass_fields__}
    with fails(ModelError, key=key):
        Bellows(**{**values, key: value})


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        ({"lobes": 0.4}, "lobes"),
        ({"lobes": -1.0}, "lobes"),
        ({"lobes": 8.5}, "lobes"),
        ({"lobes": float("nan")}, "lobes"),
        ({"along": (4, 0, 3, 2)}, "along"),
        ({"across": 0}, "counts"),
    ],
)
def test_meshes_that_are_refused(arguments, key):
    with fails(ModelError, key=key):
        bellows_mesh("quad4", SHAPE, **arguments)
