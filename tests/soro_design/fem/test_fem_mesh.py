"""Elements and meshes: volumes, faces, and what is refused."""

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_design.fem.elements.element import SOLIDS, element, shapes
from soro_design.fem.elements.mesh import make_mesh, volume_scale
from soro_design.fem.meshes.blocks import block, grid, revolved_tube, sphere, tube
from tests.refused import fails

KINDS = [*SOLIDS, "line2", "line3", "tri6"]


def volume(mesh):
    one = mesh.element
    scale = volume_scale(mesh.kind, mesh.points, mesh.cells)[:, : len(one.weight)]
    if mesh.space == "axisymmetric":
        scale = scale * 2 * np.pi * (mesh.points[mesh.cells][:, :, 0] @ one.shape.T)
    return float((scale * one.weight).sum())


def flux(mesh):
    """Integral of X . N over the boundary: the dimension times the volume."""
    face = element(mesh.element.face)
    x = np.einsum("fad,ga->fgd", mesh.points[mesh.boundary()], face.shape)
    t = np.einsum("fad,gak->fgdk", mesh.points[mesh.boundary()], face.slope)
    if t.shape[2] == 2:
        normal = np.stack([t[..., 1, 0], -t[..., 0, 0]], axis=-1)
    else:
        normal = np.cross(t[..., 0], t[..., 1])
    return float(np.einsum("fgd,fgd,g->", x, normal, face.weight))


@pytest.mark.parametrize("kind", KINDS)
def test_shape_functions_are_one_at_their_node_and_sum_to_one(kind):
    nodes = element(kind).nodes
    np.testing.assert_allclose(shapes(nodes, nodes)[0], np.eye(len(nodes)), atol=1e-15)
    np.testing.assert_allclose(element(kind).shape.sum(axis=1), 1.0, atol=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_slopes_are_derivatives(kind):
    nodes = element(kind).nodes
    at = np.random.default_rng(2).uniform(-1, 1, (3, nodes.shape[1]))
    _, slope = shapes(nodes, at)
    for k in range(nodes.shape[1]):
        step = 1e-6 * (np.arange(nodes.shape[1]) == k)
        differences = (shapes(nodes, at + step)[0] - shapes(nodes, at - step)[0]) / 2e-6
        np.testing.assert_allclose(slope[..., k], differences, atol=1e-8)


@pytest.mark.parametrize("kind", SOLIDS)
def test_a_block_has_its_volume_inside_and_around(kind):
    d = element(kind).nodes.shape[1]
    size, counts = (2.0, 0.5, 3.0)[:d], (3, 2, 2)[:d]
    mesh = block(kind, "solid" if d == 3 else "plane_strain", counts, size)
    assert volume(mesh) == pytest.approx(np.prod(size))
    assert flux(mesh) == pytest.approx(d * np.prod(size))
    n_faces = 2 * sum(int(np.prod(counts)) // count for count in counts)
    assert len(mesh.boundary()) == n_faces * (2 if kind == "tet10" else 1)


def test_volumes_of_round_parts():
    assert volume(tube("quad8", (2, 12), (1.0, 2.0))) == pytest.approx(0.25 * np.pi * 3.0, rel=1e-5)
    assert volume(tube("hex20", (1, 6, 1), (1.0, 2.0), 4.0)) == pytest.approx(np.pi * 3.0, rel=1e-4)
    assert volume(revolved_tube("quad4", (2, 3), (1.0, 2.0), 4.0)) == pytest.approx(np.pi * 12.0)
    assert volume(sphere("quad8", (4, 16), (1.0, 2.0))) == pytest.approx(2 / 3 * np.pi * 7.0, rel=1e-5)


@pytest.mark.parametrize("kind", SOLIDS)
def test_a_mesh_numbered_clockwise_is_the_same_part(kind):
    d = element(kind).nodes.shape[1]
    points, cells = grid(kind, (2, 2, 1)[:d])
    space = "solid" if d == 3 else "plane_strain"
    mirrored = make_mesh(kind, space, points * np.array([-1.0, 1.0, 1.0][:d]), cells)
    assert volume(mirrored) == pytest.approx(1.0)
    assert flux(mirrored) == pytest.approx(d)


def test_faces_at_some_nodes():
    mesh = block("quad8", "plane_strain", (3, 2), (1.0, 1.0))
    faces = mesh.faces_at(mesh.points[:, 1] == 0.0)
    assert len(faces) == 3
    assert (mesh.points[faces][:, :, 1] == 0.0).all()
    with fails(ModelError, key="faces"):
        mesh.faces_at(mesh.points[:, 1] == 0.3)


def test_an_inverted_element_is_named():
    points, cells = grid("quad4", (3, 1))
    points[cells[2, 1]] = [0.5, 1.2]
    with fails(ModelError, "element 2", "inverted", key="cells"):
        make_mesh("quad4", "plane_strain", points, cells)
    points, cells = grid("hex8", (2, 1, 1))
    cells[1] = cells[1][[1, 0, 2, 3, 4, 5, 6, 7]]
    with fails(ModelError, "element 1", key="cells"):
        make_mesh("hex8", "solid", points, cells)


def test_a_flat_element_is_named():
    points, cells = grid("quad4", (2, 1))
    points[cells[1, 2]] = points[cells[1, 1]]
    with fails(ModelError, "element 1", "degenerate", key="cells"):
        make_mesh("quad4", "plane_strain", points, cells)


POINTS, CELLS = grid("quad4", (2, 2))


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (("tet4", "solid", POINTS, CELLS), "kind"),
        (("quad4", "solid", POINTS, CELLS), "space"),
        (("quad4", "plane_strain", POINTS * np.nan, CELLS), "points"),
        (("quad4", "plane_strain", POINTS[:, :1], CELLS), "points"),
        (("quad4", "plane_strain", POINTS, CELLS[:, :3]), "cells"),
        (("quad4", "plane_strain", POINTS, CELLS + 1), "cells"),
        (("quad4", "plane_strain", POINTS, CELLS + 0.5), "cells"),
        (("quad4", "plane_strain", POINTS, CELLS[:1]), "points"),
        (("quad4", "plane_strain", POINTS, [*CELLS, np.roll(CELLS[1], 1)]), "cells"),
        (("quad4", "axisymmetric", POINTS - [1.0, 0.0], CELLS), "points"),
    ],
)
def test_what_is_refused(arguments, key):
    with fails(ModelError, key=key):
        make_mesh(*arguments)


def test_a_tetrahedron_of_four_nodes_says_why():
    with fails(ModelError, "locks", "tet10", key="kind"):
        make_mesh("tet4", "solid", POINTS, CELLS)


def test_a_mesh_is_frozen():
    mesh = block("quad4", "plane_strain", (1, 1), (1.0, 1.0))
    with pytest.raises(ValueError, match="read-only"):
        mesh.points[0, 0] = 1.0
