"""The limit on stretch: its mean and slope, steps under two constraints, and a part that keeps it."""

import numpy as np
import pytest

from soro_core.config import with_changes
from soro_core.errors import ConfigError
from soro_design.topology import load_task, make_domain, optimise, reanalyse, shape
from soro_design.topology.domain import analysis
from soro_design.topology.mma import mma_step, no_moves
from soro_design.topology.physics import stroke
from soro_design.topology.stretch import slope_of_mean, stretched
from tests.soro_design.topology.small import bellow, box
from tests.soro_design.topology.test_design_air import slope_of


def test_the_mean_of_one_stretch_everywhere_is_its_elongation():
    domain = make_domain(bellow())
    points = domain.grid.mesh.points
    solid = np.ones(len(domain.is_solid))
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    found = stretched(domain.grid, solid, points @ (turn @ np.diag([1.3, 0.9])).T - points)
    assert found.greatest == pytest.approx(1.3)
    assert found.mean == pytest.approx(0.3)
    # Grey elements count by their density, void not at all.
    assert stretched(domain.grid, 0.4 * solid, 0.3 * points).mean == pytest.approx(0.4 * 0.3 * 2**0.1)
    assert stretched(domain.grid, 0.4 * solid, 0.3 * points).greatest == 1.0
    assert stretched(domain.grid, 0.0 * solid, 0.3 * points).mean == 0.0
    # About the axis the ring is stretched too.
    ring = make_domain(bellow(space="axisymmetric"))
    assert stretched(ring.grid, solid, 0.2 * ring.grid.mesh.points * [1.0, 0.0]).mean == pytest.approx(
        0.2 * 2**0.1
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "task",
    [bellow(cells=[20, 10]), bellow(cells=[20, 10], space="axisymmetric"), box()],
    ids=lambda task: task.space,
)
def test_the_slope_of_the_mean_is_exact(task, monkeypatch):
    monkeypatch.setattr(stroke, "TOLERANCE", 1e-11)
    domain = make_domain(task)
    found = analysis(domain)
    rng = np.random.default_rng(2)
    density = rng.uniform(0.15, 0.9, len(domain.is_solid))
    at = found.evaluate(density, 2.5, 8e3, np.zeros_like(domain.output))
    gradient = slope_of_mean(found, 2.5, 8e3, density, at)
    # Uphill everywhere, so that the slope is no small difference of large ones.
    along = rng.uniform(0.2, 1.0, len(density)) * np.sign(gradient)

    def mean(x):
        return stretched(domain.grid, x, found.evaluate(x, 2.5, 8e3, at.u).u).mean

    assert mean(density) > 0.02
    slope = slope_of(mean, density, along, 5e-5)
    print(f"{task.space}: {abs(gradient @ along / slope - 1.0):.1e}")
    assert gradient @ along == pytest.approx(slope, rel=1e-8)


@pytest.mark.parametrize(("most", "best"), [(0.5, (0.5, 1.5)), (3.0, (1.0, 1.0))])
def test_the_steps_find_the_best_point_under_two_constraints(most, best):
    """The nearest point to (2, 2) with x + y <= 2 and x <= most."""
    x, moves = np.array([0.2, 0.3]), no_moves()
    for _ in range(30):
        bounds = np.maximum(x - 0.3, 0.0), np.minimum(x + 0.3, 4.0)
        constraints = np.array([x.sum() / 2.0 - 1.0, x[0] / most - 1.0])
        slopes = np.array([[0.5, 0.5], [1.0 / most, 0.0]])
        x, moves = mma_step(x, 2.0 * (x - 2.0), constraints, slopes, bounds, moves)
    assert x == pytest.approx(best, abs=2e-3)


def test_where_no_step_keeps_a_constraint_the_variables_go_towards_it():
    bounds = np.zeros(2), np.ones(2)
    constraints, slopes = np.array([-0.5, 5.0]), np.array([[0.5, 0.5], [1.0, 0.0]])
    x, _ = mma_step(np.full(2, 0.5), np.array([-1.0, -1.0]), constraints, slopes, bounds, no_moves())
    assert x[0] < 0.15
    assert x[1] > 0.5


@pytest.mark.slow
def test_a_part_keeps_its_limit_on_the_grid_and_on_its_own_mesh():
    schedule = {"iterations": 30, "ramp": 12, "pressure_pa": [2e3, 8e3]}
    free = bellow(cells=[40, 20], schedule=schedule, stretch_limit=5.0)
    loose = optimise(free)
    before = loose.rows[-1].stretch
    limit = 1.0 + 0.5 * (before - 1.0)
    done = optimise(with_changes(free, stretch_limit=limit))
    row = done.rows[-1]
    domain = make_domain(free)
    own, other = (reanalyse(domain, shape(domain, state)).stretch for state in (done, loose))
    print(f"{before:.3f} -> limit {limit:.3f}, grid {row.stretch:.3f}, own mesh {other:.3f} -> {own:.3f}")
    print(f"motion {1e3 * loose.rows[-1].motion_m:.3f} -> {1e3 * row.motion_m:.3f} mm")
    assert row.stretch <= 1.05 * limit < before
    assert own <= 1.05 * limit < other
    # Less stretch is not always less motion: the best designs are those of their places.
    assert row.motion_m == pytest.approx(loose.rows[-1].motion_m, rel=0.3)


def test_the_limit_is_that_of_the_task_else_that_of_the_material():
    assert make_domain(bellow()).stretch_limit == 11.0  # Dragon Skin 10 breaks there
    assert make_domain(bellow(stretch_limit=1.4)).stretch_limit == 1.4
    assert make_domain(bellow(goal={"material": "tpu_90"})).stretch_limit is None
    with pytest.raises(ConfigError, match="stretch_limit"):
        bellow(stretch_limit=1.0)
    with pytest.raises(ConfigError, match="stretch_limit with goal farthest alone"):
        with_changes(load_task("arch"), stretch_limit=2.0)
