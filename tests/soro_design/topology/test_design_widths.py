"""Least widths of solid and gaps against shapes whose widths are known, and robust designs."""

import numpy as np
import pytest

from soro_design.topology import make_domain
from soro_design.topology.physics.filter import density_filter, projection
from soro_design.topology.robust import least_length, worst
from soro_design.topology.shape import snapped, solid_mesh
from soro_design.topology.widths import least_widths
from tests.soro_design.topology.small import ball, bellow


def of_level(domain, level):
    return least_widths(domain, solid_mesh(domain, snapped(domain.grid, level)))


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


@pytest.mark.parametrize("erosion", [0.1, 0.2, 0.3])
def test_a_plane_wall_of_the_least_length_just_outlives_erosion(erosion):
    domain = make_domain(bellow(cells=[80, 20], filter_radius_m=2e-3, solid=[], void=[]))
    radius, x = 2e-3, domain.grid.centres[:, 0]
    weights = density_filter(domain.grid, radius)
    least = least_length(radius, erosion, 2)
    row = np.abs(domain.grid.centres[:, 1] - domain.grid.centres[:, 1].mean()) < domain.grid.edge_m[1]
    inner = row & (np.abs(x - 1e-2) < 3e-3)
    seen = []
    for half in np.arange(1, 14) * domain.grid.edge_m[0]:
        filtered = weights @ (np.abs(x - 1e-2) < half).astype(float)
        eroded = (filtered[inner] > 0.5 + erosion).any()
        width = (filtered[inner] > 0.5).sum() * domain.grid.edge_m[0] / 2
        seen.append((eroded, width))
    alive = min(width for is_left, width in seen if is_left)
    dead = max(width for is_left, width in seen if not is_left)
    edge = domain.grid.edge_m[0]
    assert dead - 2 * edge <= least <= alive + edge


def test_the_worst_goal_has_an_exact_gradient_and_follows_the_size():
    goals, step = np.array([-1.7, -1.2, -1.1]), 1e-6
    value, slope = worst(goals)
    assert goals.mean() < value < goals.max()
    by_difference = [(worst(goals + d)[0] - worst(goals - d)[0]) / (2 * step) for d in step * np.eye(3)]
    assert slope == pytest.approx(by_difference, rel=1e-6)
    assert worst(3.0 * goals)[0] == pytest.approx(3.0 * value)
    assert worst(np.full(3, -0.4))[0] == pytest.approx(-0.4)


def test_a_projection_at_a_higher_threshold_leaves_less():
    x = np.linspace(0.0, 1.0, 11)
    assert (projection(x, 8.0, 0.7)[0] <= projection(x, 8.0, 0.5)[0]).all()
