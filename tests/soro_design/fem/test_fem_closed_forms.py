"""Solutions against closed forms and published numbers: thick walls, Cook's membrane, elastica, column."""

import numpy as np
import pytest

from soro_design.fem.loads import no_loads
from soro_design.fem.meshes.blocks import revolved_tube, tube
from soro_design.fem.part import make_part
from soro_design.fem.solve.newton import solve
from soro_design.fem.solve.states import SolverSettings
from tests.soro_design.fem.closed_forms import (
    ELASTICA,
    THICK,
    cook,
    elastica,
    euler_load,
    exact,
    neo_hooke,
    thick_wall,
)


def test_a_tube_is_the_same_in_all_three_spaces():
    """A solid slice held along z is the section in plane strain; a ring has no error around it."""
    pressure = THICK["cylinder"][1]
    section, slice_ = tube("quad4", (4, 8), (1.0, 2.0)), tube("hex8", (4, 8, 1), (1.0, 2.0), 0.3)
    found = []
    for mesh in (section, slice_):
        x, y = mesh.points.T[:2]
        inside = mesh.faces_at(np.abs(np.hypot(x, y) - 1.0) < 1e-9)
        loads = no_loads(mesh).hold(y == 0.0, 1).hold(x == 0.0, 0).press(inside, pressure)
        if mesh is slice_:
            loads = loads.hold(x > -1.0, 2)
        u = solve(make_part(mesh, neo_hooke(1.0, 1e4), loads)).last.u
        found.append(u[np.lexsort((np.round(y, 9), np.round(x, 9)))])
    for face in (0, 1):
        np.testing.assert_allclose(found[1][face::2, :2], found[0], atol=1e-9)
    ring = revolved_tube("quad4", (32, 1), (1.0, 2.0), 0.1)
    r, z = ring.points.T
    loads = no_loads(ring).hold(r > 0.0, 1).press(ring.faces_at(r == 1.0), pressure)
    u = solve(make_part(ring, neo_hooke(1.0, 1e4), loads)).last.u
    assert 1.0 + u[(r == 1.0) & (z == 0.0), 0] == pytest.approx(exact("cylinder"), rel=1e-4)


@pytest.mark.parametrize("name", THICK)
def test_thick_walls(name, figure):
    closed, _, by_bulk = THICK[name]
    limit = exact(name)
    if by_bulk is not None:
        assert limit / closed - 1 == pytest.approx(by_bulk, abs=0.1e-5)
    found = {n: thick_wall(name, n) for n in (4, 8, 16)}
    orders = [np.log2((found[n] - limit) / (found[2 * n] - limit)) for n in (4, 8)]
    figure(f"{name}: inner radius off by {found[16] / closed - 1:.2e}, orders {np.round(orders, 3)}")
    assert abs(found[16] / closed - 1) < 3e-4
    assert min(orders) >= 1.9
    # Plain elements lock.
    plain = thick_wall(name, 16, is_averaged=False) / closed - 1
    figure(f"{name}: without mean dilatation {plain:+.1%}")
    assert plain == pytest.approx(-0.25, abs=0.02)


def test_cooks_membrane_and_that_plain_elements_lock(figure):
    averaged, plain = cook(32, True), cook(32, False)
    figure(f"Cook's membrane: {averaged:.4f}; without mean dilatation {plain / averaged - 1:+.1%}")
    assert averaged == pytest.approx(6.9, abs=0.05)
    assert plain < 0.8 * averaged


def test_elastica(figure):
    part, tip, found = elastica()
    off = np.abs(found - list(ELASTICA.values())).max()
    figure(f"elastica: off by {off:.1e} of the length")
    assert off < 5e-4
    # Full steps reach the last load at once; a search along them would not let the part get longer first.
    whole = solve(part, settings=SolverSettings(first_step=1.0, iterations=25))
    assert (whole.status, whole.steps) == ("solved", 1)
    assert whole.last.u[tip, 1] == pytest.approx(found[-1], abs=1e-6)


def test_eulers_column(figure):
    critical = euler_load()
    figure(f"Euler's column: {critical:.5f} of its load")
    assert critical == pytest.approx(0.9995, abs=5e-4)
