"""Meshes of files: there and back by meshio, triangles and tetrahedra refined, STEP and STL by netgen."""

import sys
from pathlib import Path

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_core.extras import MissingPackageError
from soro_core.files.stl import write_stl
from soro_design.fem.elements.mesh import make_mesh
from soro_design.fem.loads import no_loads, traction
from soro_design.fem.meshes.blocks import block, tube
from soro_design.fem.meshes.cavities import inner_surfaces
from soro_design.fem.meshes.mesh_files import mesh_step, mesh_stl, read_mesh, refined, write_mesh
from soro_design.fem.meshes.surface import is_closed, solid_surface, volume
from soro_design.fem.part import make_part
from soro_design.fem.solve.newton import solve
from tests.refused import fails
from tests.soro_design.fem.hollow import CAVITIES, COUNTS, SIZE, without
from tests.soro_design.fem.moving_parts import SOFT

CASES = Path(__file__).parents[4] / "shared/data/outside_cases/mesh_named_wrongly"
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
@pytest.mark.parametrize("kind", ["quad4", "quad8", "hex8", "hex20", "tet10"])
def test_a_mesh_is_there_and_back(meshio, kind, ending, tmp_path):
    d = 2 if kind.startswith("quad") else 3
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


def test_tetrahedra_get_nodes_in_the_middles_of_edges(meshio, tmp_path):
    points, tetrahedra = cube_of_tetrahedra(2)
    meshio.Mesh(points, [("tetra", tetrahedra)]).write(tmp_path / "cube.vtk")
    mesh = read_mesh(tmp_path / "cube.vtk", "solid").mesh
    assert (mesh.kind, len(mesh.cells)) == ("tet10", len(tetrahedra))
    surface = solid_surface(mesh)
    assert is_closed(surface[1])
    assert volume(*surface) == pytest.approx(1.0, rel=1e-12)


def test_split_meshes_keep_a_uniform_strain_and_bend_little_stiffer(figure):
    """A beam bent by a force across its end: split triangles against a grid."""
    found = {}
    grid = block("quad4", "plane_strain", (16, 2), (8.0, 1.0))
    halves = np.concatenate([grid.cells[:, [0, 1, 2]], grid.cells[:, [0, 2, 3]]])
    points, cells, _ = refined(grid.points, halves)
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


def test_an_stl_file_is_meshed(tmp_path):
    """A block with two cavities: its surface, turned outwards and inwards, encloses the same solid."""
    pytest.importorskip("netgen.stl", reason="needs the extra mesh: pip install 'soro[mesh]'")
    solid = without("hex8", SIZE, COUNTS, CAVITIES)
    path = tmp_path / "hollow.stl"
    points, triangles = solid_surface(solid)
    write_stl(path, points, triangles)
    mesh = mesh_stl(path, 12e-3)
    assert mesh.kind == "tet10"
    assert volume(*solid_surface(mesh)) == pytest.approx(84e-6, rel=1e-6)
    assert [one.volume for one in inner_surfaces(mesh)] == pytest.approx([8e-6, 4e-6], rel=1e-6)
    for wrong, words in ((triangles[1:], "open"), (triangles[:, ::-1], "inside out")):
        write_stl(path, points, wrong)
        with fails(ModelError, words, "hollow.stl", key="path"):
            mesh_stl(path, 12e-3)


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


TETRA = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
PLAIN = """$MeshFormat
2.2 0 8
$EndMeshFormat
$Nodes
4
1 0 0 0
2 1 0 0
3 0 1 0
4 0 0 1
$EndNodes
$Elements
1
1 4 2 1 1 1 2 3 4
$EndElements
"""


@pytest.mark.parametrize("ending", ["vtu", "vtk", "msh", "inp", "mesh", "su2", "bdf"])
@pytest.mark.parametrize("name", ["part.vtk", "part.msh", "part.obj", "PART.MSH", "part"])
def test_a_mesh_under_another_name_is_read(meshio, tmp_path, ending, name):
    right = tmp_path / f"right.{ending}"
    form = "gmsh" if ending == "msh" else None
    meshio.Mesh(np.array(TETRA), [("tetra", np.array([[0, 1, 2, 3]]))]).write(right, form)
    expected = read_mesh(right, "solid").mesh
    right.rename(tmp_path / name)
    found = read_mesh(tmp_path / name, "solid").mesh
    np.testing.assert_array_equal(found.points, expected.points)
    np.testing.assert_array_equal(found.cells, expected.cells)
    assert volume(*solid_surface(found)) == pytest.approx(1.0 / 6.0)


COMMENTED = {
    "between": PLAIN.replace("$Nodes", "//+\n$Nodes"),
    "before": "// of a program\n  # and another\n" + PLAIN,
    "within": PLAIN.replace("2 1 0 0", "// second\n2 1 0 0"),
    "windows": PLAIN.replace("$Nodes", "//+\n$Nodes").replace("\n", "\r\n"),
    "mark": "\N{BYTE ORDER MARK}" + PLAIN,
    "empty lines": PLAIN.replace("$Nodes", "\n\n$Nodes"),
    "no last end": PLAIN[:-1],
}


@pytest.mark.parametrize("name", COMMENTED)
def test_comments_in_a_file_of_gmsh_are_skipped(meshio, tmp_path, name):
    (tmp_path / "part.msh").write_bytes(COMMENTED[name].encode())
    mesh = read_mesh(tmp_path / "part.msh", "solid").mesh
    assert volume(*solid_surface(mesh)) == pytest.approx(1.0 / 6.0)


OBJ = "# of a program\no part\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
STRANGE = {
    "empty": ("part.msh", b"", "an empty file"),
    "spaces": ("part.vtk", b"  \n\n", "an empty file"),
    "garbage": ("part.msh", bytes(range(256)) * 8, "by its ending .msh, and damaged"),
    "garbage in vtk": ("part.vtk", bytes(range(255, 0, -1)) * 8, "by its ending .vtk, and damaged"),
    "garbage in vtu": ("part.vtu", bytes(range(255, 0, -1)) * 8, "by its ending .vtu, and damaged"),
    "zeros": ("part.stl", bytes(500), "part.stl"),
    "cut": ("part.msh", PLAIN[:90].encode(), "by its content gmsh, and damaged"),
    "cut xml": ("part.vtu", b"<VTKFile type='UnstructuredGrid'><Unst", "by its content vtu, and damaged"),
    "surface of xml": ("part.vtu", b"<?xml?><VTKFile type='PolyData'>", "another kind than UnstructuredGrid"),
    "step": ("part.msh", b"ISO-10303-21;\nHEADER;", "a STEP file"),
    "archive": ("part.msh", b"PK\x03\x04" + bytes(99), "an archive"),
    "pointer": ("part.msh", b"version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
    "gid": (
        "part.msh",
        b"MESH dimension 3 ElemType Tetrahedra Nnode 4\nCoordinates\n 1 0 0 0\nEnd Coordinates\n",
        "a mesh of GiD",
    ),
    "page": ("part.msh", b"<!DOCTYPE html><html>404", "a web page"),
    "unknown": ("part.odd", b"no mesh\n", "nor by the ending '.odd'"),
    "surface": ("part.obj", OBJ.encode(), "or this surface as .stl"),
    "surface under another name": ("part.msh", OBJ.encode(), "elements triangle"),
    "cut in its elements": ("part.msh", PLAIN.replace("$EndElements", "")[:-4].encode(), "and damaged"),
    "no elements": ("part.msh", PLAIN.replace("1\n1 4 2 1 1 1 2 3 4\n", "0\n").encode(), "part.msh"),
    "point that is none": ("part.msh", PLAIN.replace("1 2 3 4\n", "1 2 3 9\n").encode(), "part.msh"),
    "not finite": ("part.msh", PLAIN.replace("2 1 0 0", "2 nan 0 0").encode(), "points that are not finite"),
    "too many": ("part.msh", PLAIN.replace("$Nodes\n4", "$Nodes\n4000000000000").encode(), "damaged"),
}


@pytest.mark.parametrize("name", STRANGE)
def test_a_file_that_is_no_solid_mesh_says_what_it_is(meshio, tmp_path, capfd, name):
    file, content, words = STRANGE[name]
    (tmp_path / file).write_bytes(content)
    with pytest.raises(ModelError) as caught:
        read_mesh(tmp_path / file, "solid")
    assert caught.value.key == "path"
    assert words in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
    assert str(tmp_path) not in str(caught.value).replace(f"path {tmp_path / file}", "")
    assert capfd.readouterr() == ("", "")


def test_a_surface_with_textures_is_read(meshio, tmp_path):
    text = OBJ.replace("f 1 2 3", "vt 0 0\nvn 0 0 1\nvn 1 0 0\nf 1/1/1 2/1/2 3//1")
    (tmp_path / "part.obj").write_text(text)
    assert read_mesh(tmp_path / "part.obj", "plane_strain").mesh.kind == "quad4"


SQUARE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n"
SQUARES = {
    "counted from the last": "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 1 1 0\nf -3 -1 -2\n",
    "with textures": "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf -3/-1 -2/-1 -1/-1\nv 1 1 0\nf -3//1 4/1/1 -2/1\n",
    "with colours": SQUARE.replace(" 0\nv", " 0 0.5 0.5 0.5\nv"),
    "in groups": SQUARE.replace("f 2", "g second\nusemtl red\nf 2"),
    "over two lines": SQUARE.replace("f 2 4", "f 2 \\\n4"),
    "small numbers": SQUARE.replace("v 0 0 0", "v 0e-5 0E+0 0"),
    "a mark": "\N{BYTE ORDER MARK}" + SQUARE,
    "windows": SQUARE.replace("\n", "\r\n"),
}


@pytest.mark.parametrize("name", SQUARES)
def test_faces_of_obj_are_those_that_are_meant(meshio, tmp_path, name):
    (tmp_path / "right.obj").write_text(SQUARE)
    (tmp_path / "part.obj").write_bytes(SQUARES[name].encode())
    right = read_mesh(tmp_path / "right.obj", "plane_strain").mesh
    found = read_mesh(tmp_path / "part.obj", "plane_strain").mesh
    assert len(right.cells) == 6
    np.testing.assert_array_equal(found.points, right.points)
    np.testing.assert_array_equal(found.cells, right.cells)


def stl(*facets):
    """A surface in text whose facets have these points."""
    loops = ["".join(f"vertex {x} {y} 0\n" for x, y in facet) for facet in facets]
    inner = "".join(f"facet normal 0 0 1\nouter loop\n{loop}endloop\nendfacet\n" for loop in loops)
    return f"solid part\n{inner}endsolid part\n"


LEFT, RIGHT, WHOLE = ((0, 0), (1, 0), (0, 1)), ((1, 0), (1, 1), (0, 1)), ((0, 0), (1, 0), (1, 1), (0, 1))
MIXED = {
    "no point 0": (
        "part.obj",
        SQUARE.replace("f 1 2", "f 0 1"),
        "face 'f 0 1 3' names a point that is not among the 4",
    ),
    "before the first": (
        "part.obj",
        SQUARE.replace("f 1", "f -5"),
        "face 'f -5 2 3' names a point that is not among the 4",
    ),
    "beyond the last": ("part.obj", SQUARE.replace("f 2 4", "f 2 9"), "a face of point 9 of 4"),
    "no number": ("part.obj", SQUARE.replace("f 1", "f x"), "damaged: face 'f x 2 3'"),
    "quads and triangles": (
        "part.obj",
        SQUARE + "f 1 2 4 3\n",
        "elements quad and triangle; allowed: one kind",
    ),
    "a pentagon": ("part.obj", SQUARE + "v 2 2 0\nf 1 2 5 4 3\n", "elements triangle and polygon; allowed"),
    "a line as a face": ("part.obj", SQUARE + "f 1 2\n", "elements triangle and polygon; allowed"),
    "facets of four": ("part.stl", stl(*[WHOLE] * 4), "facet 0 of 4 points"),
    "a facet of four": ("part.stl", stl(LEFT, WHOLE), "facet 1 of 4 points"),
    "a facet of two": ("part.stl", stl(LEFT, RIGHT[:2], RIGHT), "facet 1 of 2 points"),
    "a quad in off": ("part.off", "OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n", "triangular"),
}


@pytest.mark.parametrize("name", MIXED)
def test_a_surface_that_is_not_read_says_what_it_has(meshio, tmp_path, name):
    file, content, words = MIXED[name]
    (tmp_path / file).write_text(content)
    with fails(ModelError, words, key="path") as caught:
        read_mesh(tmp_path / file, "plane_strain")
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("form", ["text", "bytes"])
def test_triangles_of_stl_are_read(meshio, tmp_path, form):
    path = tmp_path / "part.stl"
    path.write_text(stl(LEFT, RIGHT))
    if form == "bytes":  # with a head as that of text
        points = np.array([(*point, 0.0) for point in WHOLE])
        meshio.Mesh(points, [("triangle", np.array([[0, 1, 3], [1, 2, 3]]))]).write(path, binary=True)
        path.write_bytes(b"solid of bytes".ljust(80) + path.read_bytes()[80:])
    assert len(read_mesh(path, "plane_strain").mesh.cells) == 6


def test_nothing_of_a_mesh_is_dropped(meshio, tmp_path):
    """Elements of a second kind, and heights of a mesh that is read as flat."""
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [2.0, 0.5, 0.0]])
    mixed = [("quad", np.array([[0, 1, 2, 3]])), ("triangle", np.array([[1, 4, 2]]))]
    meshio.Mesh(points, mixed).write(tmp_path / "mixed.vtu")
    with fails(ModelError, "quad and triangle", key="path"):
        read_mesh(tmp_path / "mixed.vtu", "plane_strain")
    solid = [("tetra", np.array([[0, 1, 2, 3]])), ("pyramid", np.array([[0, 1, 2, 3, 4]]))]
    meshio.Mesh(np.array([*TETRA, [1.0, 1.0, 1.0]]), solid).write(tmp_path / "solid.vtu")
    with fails(ModelError, "tetra and pyramid", key="path"):
        read_mesh(tmp_path / "solid.vtu", "solid")
    meshio.Mesh(points + np.array([0.0, 0.0, 2.0]), mixed[:1]).write(tmp_path / "flat.vtu")
    assert read_mesh(tmp_path / "flat.vtu", "plane_strain").mesh.kind == "quad4"
    points[3, 2] = 0.1
    meshio.Mesh(points, mixed[:1]).write(tmp_path / "bent.vtu")
    with fails(ModelError, "off a plane", key="path"):
        read_mesh(tmp_path / "bent.vtu", "plane_strain")


@pytest.mark.skipif(not CASES.is_dir(), reason="the shared outside cases are not here")
@pytest.mark.parametrize("name", ["mesh.vtk", "bad.msh"])
def test_outside_cases(meshio, name):
    assert volume(*solid_surface(read_mesh(CASES / name, "solid").mesh)) == pytest.approx(1.0 / 6.0)


def test_files_without_their_packages_are_one_line(monkeypatch, tmp_path):
    for name in ("meshio", "netgen", "netgen.occ", "netgen.stl"):
        monkeypatch.setitem(sys.modules, name, None)
    mesh = block("quad4", "plane_strain", (1, 1), (1.0, 1.0))
    for extra, call in (
        ("design", lambda: read_mesh(tmp_path / "a.msh", "solid")),
        ("mesh", lambda: mesh_step(tmp_path / "a.step", 1.0)),
        ("mesh", lambda: mesh_stl(tmp_path / "a.stl", 1.0)),
    ):
        with fails(MissingPackageError, f"'soro[{extra}]'"):
            call()
    with fails(MissingPackageError, "'soro[design]'"):
        write_mesh(tmp_path / "a.msh", mesh)
