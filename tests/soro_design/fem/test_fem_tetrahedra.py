"""Tetrahedra of ten nodes: a thick sphere, Cook's membrane and a bent bar of nearly incompressible rubber."""

import numpy as np
import pytest

from soro_design.fem import part as part_module
from soro_design.fem.elements.mesh import make_mesh
from soro_design.fem.loads import no_loads, traction
from soro_design.fem.meshes.blocks import block, grid, mapped
from soro_design.fem.part import make_part
from soro_design.fem.solve.mass import mass_entries
from soro_design.fem.solve.newton import solve
from tests.soro_design.fem.closed_forms import THICK, cook, exact, neo_hooke

# Bulk over shear modulus of a Poisson ratio of .495.
BULK = 2.0 * 1.495 / (3.0 * 0.01)


def octant(n):
    """An eighth of a sphere from radius 1 to 2: three grids of n^3 cubes, one about each axis."""
    points, cells = grid("tet10", (n, n, n))
    way = np.stack([np.ones(len(points)), *np.tan(0.25 * np.pi * points.T[1:])], axis=1)
    place = (1.0 + points[:, :1]) * way / np.linalg.norm(way, axis=1, keepdims=True)
    all_places = np.concatenate([np.roll(place, k, axis=1) for k in range(3)])
    all_places[np.abs(all_places) < 1e-12] = 0.0
    _, first, number = np.unique(all_places.round(9), axis=0, return_index=True, return_inverse=True)
    all_cells = np.concatenate([cells + k * len(points) for k in range(3)])
    return make_mesh("tet10", "solid", all_places[first], number.ravel()[all_cells])


def inner_radii(n, bulk, is_averaged):
    """Stretches of the radius of the nodes of the inner wall under pressure."""
    mesh = octant(n)
    inside = np.abs(np.linalg.norm(mesh.points, axis=1) - 1.0) < 1e-6
    loads = no_loads(mesh)
    for k in range(3):
        loads = loads.hold(mesh.points[:, k] == 0.0, k)
    loads = loads.press(mesh.faces_at(inside), THICK["sphere"][1])
    done = solve(make_part(mesh, neo_hooke(1.0, bulk), loads, is_averaged))
    assert done.status == "solved", done.cause
    return np.linalg.norm(mesh.points[inside] + done.last.u[inside], axis=1)


@pytest.mark.parametrize("bulk", [BULK, 1e4])
def test_a_thick_sphere_keeps_its_closed_form(bulk, figure):
    expected = exact("sphere", bulk)
    off = {n: inner_radii(n, bulk, True) / expected - 1.0 for n in (1, 2)}
    plain = inner_radii(2, bulk, False) / expected - 1.0
    first, second, plain = (np.abs(each).max() for each in (off[1], off[2], plain))
    figure(f"thick sphere of tet10, K/mu {bulk:.0f}: off by {second:.1e}, plain {plain:.1e}")
    assert first < 1.2e-2
    assert second < 4e-3
    assert plain > 1.4 * second


def test_cooks_membrane(figure):
    """Held across, of a Poisson ratio of .495, against quadrilaterals of half the size."""

    def place(unit):
        low, high = 44.0 * unit[:, 0], 44.0 + 16.0 * unit[:, 0]
        return np.stack([48.0 * unit[:, 0], low + (high - low) * unit[:, 1], 8.0 * unit[:, 2]], axis=1)

    mesh = mapped("tet10", "solid", (6, 6, 1), place)
    x, y, _ = mesh.points.T
    loads = no_loads(mesh).hold(x == 0.0, 0).hold(x == 0.0, 1).hold(x > -1.0, 2)
    loads = loads.pull(traction(mesh, mesh.faces_at(x > 48.0 - 1e-9), [0.0, 100.0 / 16.0, 0.0]))
    rise = {}
    for is_averaged in (True, False):
        done = solve(make_part(mesh, neo_hooke(80.194, 80.194 * BULK), loads, is_averaged))
        assert done.status == "solved", done.cause
        rise[is_averaged] = done.last.u[np.argmax(x + y), 1]
    expected = cook(24, True, 80.194 * BULK)
    ours, plain = (rise[is_averaged] / expected - 1.0 for is_averaged in (True, False))
    figure(f"Cook's membrane of tet10, nu .495: {ours:+.1%}, plain {plain:+.1%}")
    assert abs(ours) < 0.03
    assert plain < 2.0 * -abs(ours)


def test_a_bar_one_cube_across_bends_as_far_as_it_should(figure, monkeypatch):
    """With the whole bulk modulus on the mean it bends too far, with none it locks."""

    def deflection(kind, counts, kept=0.0):
        monkeypatch.setattr(part_module, "KEPT", kept)
        mesh = block(kind, "solid", counts, (8.0, 1.0, 1.5))
        x, loads = mesh.points[:, 0], no_loads(mesh)
        for k in range(3):
            loads = loads.hold(x == 0.0, k)
        loads = loads.pull(traction(mesh, mesh.faces_at(x > 8.0 - 1e-9), [0.0, 1e-5, 0.0]))
        done = solve(make_part(mesh, neo_hooke(1.0, BULK), loads))
        assert done.status == "solved", done.cause
        return done.last.u[x > 8.0 - 1e-9, 1].mean()

    kept = part_module.KEPT
    expected = deflection("hex8", (32, 6, 6))
    ours, none, whole = (deflection("tet10", (8, 1, 1), each) / expected - 1.0 for each in (kept, 0.0, BULK))
    figure(f"bar of tet10 one cube across: {ours:+.1%}, mean alone {none:+.1%}, plain {whole:+.1%} of motion")
    assert abs(ours) < 0.04
    assert none > 0.3
    assert whole < -0.1


def test_a_uniform_strain_is_exact():
    """Of a mesh with its inner nodes off the grid, held at its surface alone."""
    points, cells = grid("tet10", (2, 2, 2))
    corner = np.unique(cells[:, :4])
    inner = corner[((points[corner] > 0.0) & (points[corner] < 1.0)).all(axis=1)]
    points[inner] += [0.08, -0.05, 0.06]
    for a, b, middle in ((0, 1, 4), (1, 2, 5), (0, 2, 6), (0, 3, 7), (1, 3, 8), (2, 3, 9)):
        points[cells[:, middle]] = 0.5 * (points[cells[:, a]] + points[cells[:, b]])
    mesh = make_mesh("tet10", "solid", points, cells)
    growth = np.array([[0.1, 0.05, 0.0], [0.0, -0.08, 0.02], [0.03, 0.0, 0.01]])
    loads = no_loads(mesh)
    surface = np.unique(mesh.boundary())
    for k in range(3):
        loads = loads.hold(surface, k, (mesh.points @ growth.T)[surface, k])
    done = solve(make_part(mesh, neo_hooke(1.0, BULK), loads))
    assert done.status == "solved", done.cause
    np.testing.assert_allclose(done.last.u, mesh.points @ growth.T, atol=1e-10)


def test_the_mass_is_positive():
    mesh = block("tet10", "solid", (2, 1, 1), (2.0, 1.0, 1.0))
    part = make_part(mesh, neo_hooke(1.0, BULK), no_loads(mesh))
    values = np.linalg.eigvalsh(part.pattern.matrix(mass_entries(part)).toarray())
    assert values.min() > 1e-3 * values.mean()
