"""Modes: of a cantilever, and of a beam that is pulled or pressed to its Euler load."""

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_core.fem.blocks import block
from soro_core.fem.loads import no_loads, traction
from soro_core.fem.mass import mass_entries, modes
from soro_core.fem.material import material_from_dict
from soro_core.fem.newton import solve
from soro_core.fem.part import make_part
from tests.fem.test_fem_part import MESHES
from tests.refused import fails

E, DENSITY = 1e6, 1000.0
BEAM = material_from_dict(
    {
        "kind": "st_venant_kirchhoff",
        "source": "a test",
        "youngs_modulus_pa": E,
        "poisson_ratio": 0.0,
        "density_kg_per_m3": DENSITY,
    }
)
# Roots of cos x cosh x = -1: lengths of a cantilever over its wave numbers.
ROOTS = np.array([1.87510407, 4.69409113, 7.85475744])


@pytest.mark.parametrize("name", MESHES)
def test_the_mass_is_that_of_the_material(name):
    """All nodes with one acceleration; about an axis the radial ones stand for a ring that grows."""
    mesh = MESHES[name]
    part = make_part(mesh, BEAM, no_loads(mesh))
    M = part.pattern.matrix(mass_entries(part))
    along = np.zeros(mesh.points.shape)
    along[:, -1] = 1.0
    total = DENSITY * part.volume.sum()
    assert along.ravel() @ (M @ along.ravel()) == pytest.approx(total)
    # Linear fields are exact: the second moment about y = 0.
    along[:, -1] = mesh.points[:, 0]
    at = np.einsum("ea,ga->eg", mesh.points[mesh.cells][:, :, 0], mesh.element.shape)
    assert along.ravel() @ (M @ along.ravel()) == pytest.approx(DENSITY * (part.volume * at**2).sum())


@pytest.mark.parametrize(
    ("kind", "counts", "slenderness", "within"),
    [("quad8", (30, 1), 100.0, 1e-3), ("hex20", (16, 1, 1), 40.0, 3e-3)],
)
def test_a_cantilever_has_the_frequencies_of_euler_and_bernoulli(kind, counts, slenderness, within, figure):
    d = len(counts)
    height = 1.0 / slenderness
    mesh = block(kind, "solid" if d == 3 else "plane_strain", counts, (1.0, height, 2 * height)[:d])
    loads = no_loads(mesh)
    for k in range(d):
        loads = loads.hold(mesh.points[:, 0] == 0.0, k)
    if d == 3:
        loads = loads.hold(mesh.points[:, 0] >= 0.0, 2)
    found = modes(make_part(mesh, BEAM, loads), count=3)
    expected = ROOTS**2 * np.sqrt(E * height**2 / 12.0 / DENSITY) / (2 * np.pi)
    off = found.frequencies_hz / expected - 1.0
    figure(f"{kind} cantilever, L/h {slenderness:g}: frequencies off by {np.round(off, 5)}")
    assert np.abs(off[:2]).max() < within
    assert abs(off[2]) < 3 * within
    # Modal masses are 1, and modes do not share any.
    part = make_part(mesh, BEAM, loads)
    shapes = found.shapes.reshape(3, -1)
    M = part.pattern.matrix(mass_entries(part))
    np.testing.assert_allclose(shapes @ (M @ shapes.T), np.eye(3), atol=1e-8)


def pinned(load):
    """Half of a pinned beam of length 1 and thickness .01 under its Euler load times `load`, compressed."""
    height = 0.01
    mesh = block("quad8", "plane_strain", (16, 1), (0.5, height))
    x = mesh.points[:, 0]
    loads = no_loads(mesh).hold(x == 0.0, 0).hold(x > 0.5 - 1e-9, 1)
    euler = np.pi**2 * E * height**3 / 12.0
    end = mesh.faces_at(x > 0.5 - 1e-9)
    part = make_part(mesh, BEAM, loads.pull(traction(mesh, end, [-euler / height, 0.0])))
    pulled = part.under(loads.pull(np.sign(load) * part.loads.force))
    return pulled, solve(pulled, [abs(load)]).last if load else None


def test_the_square_of_a_frequency_falls_to_0_at_eulers_load_and_rises_under_tension(figure):
    """Of a pinned beam it is w^2 = w0^2 (1 - P / P_E), like that of a string far in tension."""
    loads = np.array([-8.0, -1.0, 0.0, 0.5, 0.9, 1.01])
    squared = np.array([modes(*pinned(load), count=1).squared[0] for load in loads])
    expected = np.pi**4 * E * 1e-4 / 12.0 / DENSITY * (1.0 - loads)
    off = (squared - expected) / expected[2]
    figure(f"beam under load: squares of its frequency off by {np.abs(off).max():.1e} of that without load")
    assert np.abs(off[1:]).max() < 2e-3
    assert abs(off[0]) < 2e-2
    assert squared[-1] < 0.0
    assert np.isnan(modes(*pinned(1.01), count=1).frequencies_hz[0])


def test_a_free_part_has_modes_without_a_frequency():
    mesh = block("quad4", "plane_strain", (3, 3), (1.0, 1.0))
    found = modes(make_part(mesh, BEAM, no_loads(mesh)), count=5).squared
    assert np.abs(found[:3]).max() < 1e-6 * found[3]
    assert found[3] > 1.0


def test_what_is_refused():
    mesh = block("quad4", "plane_strain", (1, 1), (1.0, 1.0))
    part = make_part(mesh, BEAM, no_loads(mesh).hold(mesh.points[:, 1] == 0.0, 1))
    for count in (0, 6):
        with fails(ModelError, key="count"):
            modes(part, count=count)
    top = mesh.faces_at(mesh.points[:, 1] == 1.0)
    pressed = part.under(part.loads.hold([0], 0).press(top, 1e4, is_patch=True))
    with fails(ModelError, "open", key="state"):
        modes(pressed, solve(pressed).last, count=1)
