"""Pressure of the air in densities, and the derivatives of both goals against differences."""

import numpy as np
import pytest

from soro_core.config import with_changes
from soro_design.topology.domain import analysis, make_domain
from soro_design.topology.optimise import densities
from soro_design.topology.physics import stroke
from soro_design.topology.physics.darcy import Flow, pressures
from soro_design.topology.physics.energy import ElementScales
from soro_design.topology.physics.filter import density_filter, projection
from soro_design.topology.physics.grid import make_grid
from soro_design.topology.task import load_task
from tests.soro_design.topology.small import bellow, box

FLOW = Flow(0.3, 6.0, 1e-4, 1e-3)


def held(grid, left, right):
    x = grid.mesh.points[:, 0]
    return np.where(x < 1e-9, left, np.where(x > x.max() - 1e-9, right, np.nan))


def test_pressure_falls_linearly_through_void():
    grid = make_grid("plane_strain", (0.02, 0.01), (8, 4))
    found = pressures(grid, FLOW, np.zeros(32), held(grid, 5e3, 0.0)).at_nodes
    assert found == pytest.approx(5e3 * (1.0 - grid.mesh.points[:, 0] / 0.02), abs=1e-8)


def test_pressure_falls_by_the_logarithm_of_the_radius_through_rings():
    """The flux 2 pi r dp/dr of a thick ring is the same at all radii."""
    grid = make_grid("axisymmetric", (0.02, 0.001), (200, 1))
    r = grid.mesh.points[:, 0]
    given = np.where(r <= 0.005 + 1e-9, 1e3, np.where(r > 0.02 - 1e-9, 0.0, np.nan))
    found = pressures(grid, FLOW, np.zeros(200), given).at_nodes
    inner = r >= 0.005
    assert found[inner] == pytest.approx(1e3 * np.log(0.02 / r[inner]) / np.log(4.0), abs=0.1)


def test_pressure_falls_to_the_rest_within_the_depth_of_a_wall():
    """p'' = (log(rest) / depth)^2 p of solid, whatever its conductivity."""
    grid = make_grid("plane_strain", (0.01, 0.001), (200, 2))
    found = pressures(grid, FLOW, np.ones(400), held(grid, 1.0, 0.0)).at_nodes
    at = grid.mesh.points[:, 0]
    rate = np.log(10.0) / 1e-3
    assert found == pytest.approx(np.sinh(rate * (0.01 - at)) / np.sinh(rate * 0.01), abs=3e-4)
    assert found[np.abs(at - 1e-3) < 1e-9] == pytest.approx(0.1, abs=1e-3)


def slope_of(evaluate, density, along, step):
    """Derivative by differences of fourth order."""
    near, far = (
        evaluate(density + k * step * along) - evaluate(density - k * step * along) for k in (1.0, 2.0)
    )
    return (8.0 * near - far) / (12.0 * step)


@pytest.mark.slow
@pytest.mark.parametrize(
    "task",
    [
        bellow(cells=[20, 10]),
        bellow(cells=[20, 10], space="axisymmetric"),
        box(),
        bellow(cells=[20, 10], goal={"stiff": {"times": 4.0, "volume_fraction": 0.1}}),
    ],
    ids=["section", "ring", "solid", "two materials"],
)
def test_the_adjoint_is_exact(task, monkeypatch):
    """Energy, spring, air and its flow, void and grey elements at once, for a motion of large strain."""
    monkeypatch.setattr(stroke, "TOLERANCE", 1e-11)
    domain = make_domain(task)
    found = analysis(domain)
    rng = np.random.default_rng(2)
    density = rng.uniform(0.15, 0.9, domain.fields * len(domain.is_solid))
    start = np.zeros_like(domain.output)
    at = found.evaluate(density, 2.5, 8e3, start)
    assert np.abs(at.u).max() > 1e-4
    # Uphill everywhere, so that the slope is no small difference of large ones.
    along = rng.uniform(0.2, 1.0, len(density)) * np.sign(at.gradient)
    slope = slope_of(lambda x: found.evaluate(x, 2.5, 8e3, at.u).objective, density, along, 4e-4)
    print(f"{task.space}: {abs(at.gradient @ along / slope - 1.0):.1e}")
    assert at.gradient @ along == pytest.approx(slope, rel=1e-9)


def test_the_gradient_of_the_compliance_is_exact():
    task = with_changes(load_task("arch"), cells=(10, 5))
    found = analysis(make_domain(task))
    rng = np.random.default_rng(2)
    density, along = rng.uniform(0.1, 0.9, 50), rng.uniform(-1.0, 1.0, 50)
    at = found.evaluate(density, 3.0, 1.0)
    slope = slope_of(lambda x: found.evaluate(x, 3.0, 1.0).objective, density, along, 1e-4)
    assert at.gradient @ along == pytest.approx(slope, rel=2e-9)


def test_air_in_void_alone_loads_no_node_inside():
    """-int p J dV with one p everywhere depends on the border alone."""
    task = bellow()
    domain = make_domain(task)
    found = analysis(domain)
    grid = domain.grid
    rng = np.random.default_rng(3)
    u = 1e-4 * rng.uniform(-1.0, 1.0, grid.mesh.points.shape)
    n = len(grid.kind)
    p = np.full(len(u), 5e3)
    void = ElementScales(np.full(n, 1e-6), np.zeros(n), np.ones(n))
    with_air, without = (found.balance(void, q, u).unbalanced for q in (p, 0.0 * p))
    size = grid.mesh.points.max(axis=0)
    is_inside = ((grid.mesh.points > 0.0) & (grid.mesh.points < size)).all(axis=1)
    load = with_air - without
    assert np.abs(load[is_inside]).max() < 1e-11 * np.abs(load).max()


def test_air_pushes_at_the_face_of_a_wall():
    """The right half of a grid is solid: the pressure falls within some elements of it, the force at once."""
    domain = make_domain(bellow())
    found, grid = analysis(domain), domain.grid
    x = grid.mesh.points[:, 0]
    is_wall = grid.centres[:, 0] > 0.01
    pressure = np.where(x < 0.01 + 1e-9, 5e3, 5e3 * np.exp(-(x - 0.01) / 1e-3))
    kappa = np.where(is_wall, 1.0, 1e-6)
    load = -found.balance(
        ElementScales(kappa, 0.0 * kappa, 0.0 * kappa + 1.0), pressure, np.zeros_like(grid.mesh.points)
    ).unbalanced[:, 0]
    at_face = np.abs(x - 0.01) < 1e-9
    assert load[at_face].sum() == pytest.approx(5e3 * 0.01, rel=1e-5)
    assert np.abs(load[x > 0.01 + 1e-9]).max() < 1e-9 * load[at_face].sum()


@pytest.mark.parametrize("sharpness", [1.0, 8.0, 16.0])
def test_the_gradient_passes_filter_and_projection(sharpness):
    """By the variables. SoRoTop takes the slope of the projection where it ends, not where it begins."""
    task = with_changes(load_task("arch"), cells=(20, 10), filter_radius_m=12.0)
    domain = make_domain(task)
    found, weights = analysis(domain), density_filter(domain.grid, task.filter_radius_m)
    rng = np.random.default_rng(4)
    x = rng.uniform(0.0, 1.0, 200)
    _, density, slope = densities(domain, weights, x, sharpness)
    by_density = found.evaluate(density, 3.0, 1.0).gradient
    gradient = weights.T @ (by_density * slope)
    along = rng.uniform(0.2, 1.0, 200) * np.sign(gradient)

    def work(x):
        return found.evaluate(densities(domain, weights, x, sharpness)[1], 3.0, 1.0).objective

    exact = slope_of(work, x, along, 1e-4)
    other = weights.T @ (by_density * projection(density, sharpness, 0.5)[1])
    print(f"sharpness {sharpness:g}: {gradient @ along / exact - 1.0:.1e}; other {other @ along / exact:.2f}")
    assert gradient @ along == pytest.approx(exact, rel=2e-9)
