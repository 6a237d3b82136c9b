"""Modes: of a cantilever, and of a beam that is pulled or pressed to its Euler load."""

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_design.fem.loads import no_loads
from soro_design.fem.meshes.blocks import block
from soro_design.fem.part import make_part
from soro_design.fem.solve.mass import mass_entries, modes
from soro_design.fem.solve.newton import solve
from tests.refused import fails
from tests.soro_design.fem.moving_parts import BEAM, DENSITY, E, cantilever_modes, pinned
from tests.soro_design.fem.test_fem_part import MESHES


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
    part, found, expected = cantilever_modes(kind, counts, slenderness)
    off = found.frequencies_hz / expected - 1.0
    figure(f"{kind} cantilever, L/h {slenderness:g}: frequencies off by {np.round(off, 5)}")
    assert np.abs(off[:2]).max() < within
    assert abs(off[2]) < 3 * within
    # Modal masses are 1, and modes do not share any.
    shapes = found.shapes.reshape(3, -1)
    M = part.pattern.matrix(mass_entries(part))
    np.testing.assert_allclose(shapes @ (M @ shapes.T), np.eye(3), atol=1e-8)


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
