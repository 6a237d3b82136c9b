"""Least widths of solid and gaps against shapes whose widths are known."""

import numpy as np
import pytest

from soro_design.topology import make_domain
from soro_design.topology.shape import snapped, solid_mesh
from soro_design.topology.widths import least_widths
from tests.soro_design.topology.small import ball, bellow


def of_level(domain, level):
    return least_widths(domain, solid_mesh(domain, snapped(domain.grid, level)))


@pytest.mark.slow
def test_the_shell_of_a_ball_is_as_thick_as_its_radii_are_apart():
    domain = make_domain(ball())
    r = np.linalg.norm(domain.grid.mesh.points, axis=1)
    found = of_level(domain, np.minimum(r - 6e-3, 8.4e-3 - r))
    assert found.solid_m == pytest.approx(2.4e-3, rel=0.1)
    # Twelve millimetres of void, farther than any gap is looked for.
    assert found.gap_m == np.inf


@pytest.mark.parametrize(("neck_m", "slit_m"), [(1.0e-3, 2.0e-3), (2.5e-3, 0.9e-3)])
def test_the_neck_and_the_slit_of_a_section_are_found_where_they_are(neck_m, slit_m):
    """Two plates about a slit, beside each other joined by a neck at x = 5 mm, where the slit ends round."""
    domain = make_domain(bellow(cells=[80, 40], mirrors=[]))
    x, y = domain.grid.mesh.points.T
    neck = 0.5 * neck_m - np.abs(x - 5e-3)
    plates = np.abs(y - 5e-3) - 0.5 * slit_m
    found = of_level(domain, np.maximum(plates, neck))
    assert found.solid_m == pytest.approx(neck_m, rel=0.05)
    assert found.solid_at[0] == pytest.approx(5e-3, abs=2e-4)
    assert found.gap_m == pytest.approx(slit_m, rel=0.12)
    assert found.gap_at[1] == pytest.approx(5e-3, abs=2e-4)


def test_a_wall_at_a_mirror_counts_with_its_image():
    domain = make_domain(bellow(cells=[80, 40], mirrors=["x"]))
    x, y = domain.grid.mesh.points.T
    level = np.maximum(0.6e-3 - x, y - 5e-3)
    assert of_level(domain, level).solid_m == pytest.approx(1.2e-3, rel=0.05)
