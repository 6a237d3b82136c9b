"""Meshes of files: there and back by meshio, triangles and tetrahedra split, STEP by netgen."""

import sys

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_core.extras import MissingPackageError
from soro_core.fem.blocks import block, tube
from soro_core.fem.loads import no_loads, traction
from soro_core.fem.mesh import make_mesh
from soro_core.fem.mesh_files import mesh_step, read_mesh, write_mesh
from soro_core.fem.newton import solve
from soro_core.fem.part import make_part
from soro_core.fem.simplices import split
from soro_core.fem.surface import is_closed, solid_surface, volume
from tests.fem.moving_parts import SOFT
from tests.refused import fails

# Two triangles of a unit square, its left edge named "held", in millimetres.
MSH = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
2
1 1 "held"
2 2 "part"
$EndPhysicalNames
$Nodes
4
1 0 0 0
2 1 0 0
3 1 1 0
4 0 1 0
$EndNodes
$Elements
3
1 1 2 1 1 4 1
2 2 2 2 1 1 2 3
3 2 2 2 1 1 3 4
$EndElements
"""


@pytest.fixture
def meshio():
    return pytest.importorskip("meshio", reason="needs the extra design: pip install 'soro[design]'")


@pytest.mark.parametrize("ending", ["msh", "vtk"])
@pytest.mark.parametrize("kind", ["quad4", "quad8", "hex8", "hex20"])
def test_a_mesh_is_there_and_back(meshio, kind, ending, tmp_path):
    d = 3 if kind.startswith("hex") else 2
    space = "solid" if d == 3 else "plane_strain"
    mesh = tube(kind, (1, 3, 2)[:d], (1.0, 2.0))
    path = tmp_path / f"part.{ending}"
    write_mesh(path, mesh, {"height": mesh.points[:, -1]})
    again = read_mesh(path, space).mesh
    np.testing.assert_allclose(again.points, mesh.points, atol=1e-12)
    np.testing.assert_array_equal(again.cells, mesh.cells)
    np.testing.assert_allclose(meshio.read(path).point_data["height"].ravel(), mesh.points[:, -1])


def test_named_groups_and_units_of_a_gmsh_file(meshio, tmp_path):
    (tmp_path / "part.msh").write_text(MSH)
    found = read_mesh(tmp_path / "part.msh", "plane_strain", unit_m=1e-3)
    mesh = found.mesh
    assert (mesh.kind, len(mesh.cells)) == ("quad4", 6)
    assert mesh.points.max() == 1e-3
    np.testing.assert_array_equal(found.groups["held"], mesh.points[:, 0] == 0.0)
    assert found.groups["part"].all()
    assert len(mesh.faces_at(found.groups["held"])) == 2


def cube_of_tetrahedra(n):
    """Six tetrahedra in each cube of a grid."""
    grid = block("hex8", "solid", (n, n, n), (1.0, 1.0, 1.0))
    paths = [(0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6)]
    return grid.points, np.concatenate([grid.cells[:, one] for one in paths])


def test_tetrahedra_become_hexahedra_of_the_same_solid(meshio, tmp_path):
    points, tetrahedra = cube_of_tetrahedra(2)
    meshio.Mesh(points, [("tetra", tetrahedra)]).write(tmp_path / "cube.vtk")
    mesh = read_mesh(tmp_path / "cube.vtk", "solid").mesh
    assert (mesh.kind, len(mesh.cells)) == ("hex8", 4 * len(tetrahedra))
    surface = solid_surface(mesh)
    assert is_closed(surface[1])
    assert volume(*surface) == pytest.approx(1.0, rel=1e-12)


def test_split_meshes_keep_a_uniform_strain_and_bend_little_stiffer(figure):
    """A beam bent by a force across its end: split triangles against a grid."""
    found = {}
    grid = block("quad4", "plane_strain", (16, 2), (8.0, 1.0))
    halves = np.concatenate([grid.cells[:, [0, 1, 2]], grid.cells[:, [0, 2, 3]]])
    points, cells, _ = split(grid.points, halves)
    for name, mesh in {
        "grid": block("quad8", "plane_strain", (32, 4), (8.0, 1.0)),
        "split": make_mesh("quad4", "plane_strain", points, cells),
    }.items():
        x = mesh.points[:, 0]
        loads = no_loads(mesh).hold(x == 0.0, 0).hold(x == 0.0, 1)
        end = mesh.faces_at(x == 8.0)
        done = solve(make_part(mesh, SOFT, loads.pull(traction(mesh, end, [0.0, 20.0]))))
        assert done.status == "solved"
        found[name] = done.last.u[:, 1].max()
    figure(f"beam of split triangles: {found['split'] / found['grid'] - 1:+.1%} of the deflection of quad8")
    assert found["split"] == pytest.approx(found["grid"], rel=0.06)


def test_a_step_file_is_meshed_and_solved(tmp_path):
    occ = pytest.importorskip("netgen.occ", reason="needs the extra mesh: pip install 'soro[mesh]'")
    occ.Box((0, 0, 0), (10, 10, 20)).WriteStep(str(tmp_path / "box.step"))
    mesh = mesh_step(tmp_path / "box.step", 6e-3)
    surface = solid_surface(mesh)
    assert is_closed(surface[1])
    assert volume(*surface) == pytest.approx(2e-6, rel=1e-9)
    z = mesh.points[:, 2]
    loads = no_loads(mesh).hold(z < 1e-9, 2).hold(np.abs(mesh.points[:, 0]) < 1e-9, 0)
    loads = loads.hold(np.abs(mesh.points[:, 1]) < 1e-9, 1).hold(z > 20e-3 - 1e-9, 2, 10e-3)
    done = solve(make_part(mesh, SOFT, loads))
    assert done.status == "solved"
    # The stress of rubber at a stretch of 1.5: mu (s - s^-2).
    force = done.last.reaction[z > 20e-3 - 1e-9, 2].sum()
    assert force == pytest.approx(4e4 * (1.5 - 1.5**-2) * 1e-4, rel=2e-2)
    (tmp_path / "bad.step").write_text("no solid")
    with fails(ModelError, "bad.step", key="path"):
        mesh_step(tmp_path / "bad.step", 6e-3)


def test_what_is_refused(meshio, tmp_path):
    with fails(ModelError, "none.msh", key="path"):
        read_mesh(tmp_path / "none.msh", "solid")
    (tmp_path / "bad.msh").write_text("no mesh\n")
    (tmp_path / "part.odd").write_text("no mesh\n")
    for name in ("bad.msh", "part.odd"):
        with fails(ModelError, name, key="path"):
            read_mesh(tmp_path / name, "solid")
    (tmp_path / "part.msh").write_text(MSH)
    with fails(ModelError, "triangle", "hexahedron", key="path"):
        read_mesh(tmp_path / "part.msh", "solid")
    with fails(ModelError, "part.odd", key="path"):
        write_mesh(tmp_path / "part.odd", block("quad4", "plane_strain", (1, 1), (1.0, 1.0)))


def test_files_without_their_packages_are_one_line(monkeypatch, tmp_path):
    for name in ("meshio", "netgen", "netgen.occ"):
        monkeypatch.setitem(sys.modules, name, None)
    mesh = block("quad4", "plane_strain", (1, 1), (1.0, 1.0))
    for extra, call in {
        "design": lambda: read_mesh(tmp_path / "a.msh", "solid"),
        "mesh": lambda: mesh_step(tmp_path / "a.step", 1.0),
    }.items():
        with fails(MissingPackageError, f"'soro[{extra}]'"):
            call()
    with fails(MissingPackageError, "'soro[design]'"):
        write_mesh(tmp_path / "a.msh", mesh)
