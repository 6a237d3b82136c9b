"""Meshes as public examples of soft robots have them: mixed cells, old and new formats, either sense."""

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_design.fem.elements.mesh import make_mesh
from soro_design.fem.meshes.cavities import inner_surfaces
from soro_design.fem.meshes.mesh_files import in_one_sense, read_mesh, refined
from soro_design.fem.meshes.surface import solid_surface, volume
from tests.refused import fails
from tests.soro_design.fem.foreign import NET_VOLUME, gmsh_vtk, net_of_tetrahedra, sofa_vtu

pytest.importorskip("meshio", reason="needs the extra design: pip install 'soro[design]'")
POINTS, TETRAHEDRA = net_of_tetrahedra()
MIRRORED = [1, 0, 2, 3]


@pytest.mark.parametrize("version", ["0.1", "1.0", "2.0", "2.2", "2.13"])
@pytest.mark.parametrize("name", ["net.vtu", "net.vtk"])
def test_vtu_in_text_of_several_versions_is_read(tmp_path, version, name):
    (tmp_path / name).write_text(sofa_vtu(POINTS, TETRAHEDRA, version))
    mesh = read_mesh(tmp_path / name, "solid", 1e-3).mesh
    np.testing.assert_array_equal(mesh.cells[:, :4], TETRAHEDRA)
    assert [one.volume for one in inner_surfaces(mesh)] == pytest.approx([NET_VOLUME], rel=1e-6)


GMSH_1 = """$NOD
8
1 0 0 0
2 1 0 0
3 1 1 0
4 0 1 0
5 0 0 1
6 1 0 1
7 1 1 1
18 0 1 1
$ENDNOD
$ELM
2
1 3 4 1 4 1 2 3 4
2 5 9 1 8 1 2 3 4 5 6 7 18
$ENDELM
"""


@pytest.mark.parametrize("text", [GMSH_1, GMSH_1.replace("\n", "\r\n")], ids=["unix", "windows"])
def test_a_file_of_gmsh_1_is_read(tmp_path, text):
    (tmp_path / "cube.msh").write_bytes(text.encode())
    found = read_mesh(tmp_path / "cube.msh", "solid")
    assert (found.mesh.kind, len(found.mesh.cells)) == ("hex8", 1)
    assert volume(*solid_surface(found.mesh)) == pytest.approx(1.0)
    np.testing.assert_array_equal(found.groups["surface 4"], found.mesh.points[:, 2] == 0.0)
    assert found.groups["volume 9"].all()


@pytest.mark.parametrize("cut", [30, 95, -8, -20])
def test_a_file_of_gmsh_1_that_ends_early_is_damaged(tmp_path, cut):
    (tmp_path / "cube.msh").write_text(GMSH_1[:cut])
    with fails(ModelError, "gmsh, and damaged", key="path"):
        read_mesh(tmp_path / "cube.msh", "solid")


def test_tetrahedra_may_be_numbered_in_either_sense(tmp_path):
    mixed = TETRAHEDRA.copy()
    mixed[::3] = mixed[::3][:, MIRRORED]
    (tmp_path / "net.vtk").write_text(gmsh_vtk(POINTS, mixed))
    mesh = read_mesh(tmp_path / "net.vtk", "solid", 1e-3).mesh
    assert volume(*solid_surface(mesh)) == pytest.approx(1e-9 * _volumes(TETRAHEDRA).sum())
    np.testing.assert_array_equal(np.sort(mesh.cells[:, :4]), np.sort(TETRAHEDRA))


def _volumes(tetrahedra):
    return np.linalg.det(np.diff(POINTS[tetrahedra], axis=1)) / 6.0


def test_triangles_may_be_numbered_in_either_sense():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    found = in_one_sense(points, np.array([[0, 1, 2], [0, 3, 2]]))
    np.testing.assert_array_equal(found, [[0, 1, 2], [3, 0, 2]])
    assert len(make_mesh("quad4", "plane_strain", *refined(points, found)[:2]).cells) == 6


def test_folded_tetrahedra_are_refused(tmp_path):
    """A node is drawn through the elements around it: these lie on their neighbours."""
    points = POINTS.copy()
    inner = np.flatnonzero((np.abs(points - [50.0, 10.0, 10.0]) < 1e-9).all(axis=1))
    points[inner, 0] += 25.0
    (tmp_path / "net.vtk").write_text(gmsh_vtk(points, TETRAHEDRA))
    with fails(ModelError, "inverted", "angles below 180", key="cells"):
        read_mesh(tmp_path / "net.vtk", "solid")


@pytest.mark.parametrize("height", [0.0, 1e-13, -1e-13])
def test_flat_tetrahedra_are_degenerate(height):
    """What rounding makes of four points in a plane is no volume."""
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, height]])
    whole = np.array([[0.0, 0.0, 5.0], [1.0, 0.0, 5.0], [0.0, 1.0, 5.0], [0.0, 0.0, 6.0]])
    points, cells, _ = refined(np.concatenate([whole, corners]), np.arange(8).reshape(2, 4))
    with fails(ModelError, "1 wrong", "element 1 degenerate", key="cells"):
        make_mesh("tet10", "solid", points, cells)
