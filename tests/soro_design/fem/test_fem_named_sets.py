"""Named sets of mesh files become groups of nodes: .inp, .msh of both versions, fields of .vtu."""

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_design.fem.meshes.mesh_files import read_mesh
from soro_design.fem.meshes.named_sets import inp_parts
from tests.refused import fails

# Two bricks along x, and their nodes by number: 11 to 22, of which 11 to 14 lie at x = 0.
POINTS = [(x, y, z) for x in (0, 1, 2) for y, z in ((0, 0), (1, 0), (1, 1), (0, 1))]
NODES = "".join(f"{11 + k}, {x}, {y}, {z}\n" for k, (x, y, z) in enumerate(POINTS))
INP = f"""*Heading
 two bricks
** made by hand
*Node, nset=all
{NODES}*Element, type=C3D8
1, 11, 12, 13, 14,
 15, 16, 17, 18
*ELEMENT, TYPE=C3D8, ELSET=Far
2, 15, 16, 17, 18, 19, 20, 21, 22
*Nset, nset=base, generate
11, 14, 1
*Nset, nset=Two_Parts
11
*Nset, nset=TWO_PARTS
22,
*Nset, nset=Both
base, 22
*Elset, elset="first one"
1
*Elset, elset=whole
Far, 1
*Step
*Boundary
base, 1, 3
"""


@pytest.fixture(autouse=True)
def _meshio():
    pytest.importorskip("meshio", reason="needs the extra design: pip install 'soro[design]'")


def groups(path, space="solid"):
    """Groups of a file by name, as sets of places."""
    read = read_mesh(path, space)
    return {name: {tuple(p) for p in read.mesh.points[own].tolist()} for name, own in read.groups.items()}


def at(test):
    return {point for point in POINTS if test(*point)}


def test_sets_of_an_inp_file(tmp_path):
    path = tmp_path / "part.inp"
    path.write_text(INP)
    found = groups(path)
    assert found["all"] == set(POINTS)
    assert found["base"] == at(lambda x, y, z: x == 0)
    assert found["Two_Parts"] == {POINTS[0], POINTS[-1]}
    assert found["Both"] == at(lambda x, y, z: x == 0) | {POINTS[-1]}
    assert found["Far"] == at(lambda x, y, z: x >= 1)
    assert found["first one"] == at(lambda x, y, z: x <= 1)
    assert found["whole"] == set(POINTS)
    assert set(found) == {"all", "base", "Two_Parts", "Both", "Far", "first one", "whole"}


def test_nodes_in_two_blocks_and_in_an_included_file(tmp_path):
    """meshio alone keeps the last block of nodes."""
    head, sets = INP.split("*Nset, nset=base", 1)
    (tmp_path / "sets.txt").write_text("*Nset, nset=base" + sets)
    (tmp_path / "part.inp").write_text(head.replace("17,", "*NODE\n17,", 1) + "*INCLUDE, INPUT=sets.txt\n")
    assert groups(tmp_path / "part.inp")["base"] == at(lambda x, y, z: x == 0)
    (tmp_path / "sets.txt").unlink()
    with fails(ModelError, "includes", key="path"):
        read_mesh(tmp_path / "part.inp", "solid")


def test_an_element_over_two_lines():
    one = "".join(f"{k}, 0, 0, 0\n" for k in range(1, 21))
    text = f"*NODE\n{one}*ELEMENT, TYPE=C3D20, ELSET=a\n7, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14,\n"
    assert inp_parts(text + "15, 16, 17, 18, 19, 20\n")[1]["a"].tolist() == list(range(20))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("22,\n", "99\n", "set Two_Parts names 99"),
        ("Far, 1", "Near, 1", "damaged"),
        ("nset=base, generate\n11, 14, 1", "nset=base, generate\n11", "damaged"),
        ("*Nset, nset=Both", "*Nset", "damaged"),
    ],
)
def test_a_set_that_is_damaged_is_named(tmp_path, old, new, words):
    assert old in INP
    (tmp_path / "part.inp").write_text(INP.replace(old, new))
    with fails(ModelError, words, key="path"):
        read_mesh(tmp_path / "part.inp", "solid")


# Two triangles of a square; line and surface with the number 1; line 2 has no name.
MSH2 = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
2
1 1 "left"
2 1 "lower"
$EndPhysicalNames
$Nodes
4
1 0 0 0
2 1 0 0
3 1 1 0
4 0 1 0
$EndNodes
$Elements
4
1 2 2 1 1 1 2 3
2 1 2 1 1 4 1
3 1 2 2 2 2 3
4 2 2 5 2 1 3 4
$EndElements
"""
# The same with the surface of the second triangle in no group but 5, and the left line in 1 and 3.
MSH4 = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
3
1 1 "left"
1 3 "also left"
2 1 "lower"
$EndPhysicalNames
$Entities
0 2 2 0
1 0 0 0 0 1 0 2 1 3 0
2 1 0 0 1 1 0 1 2 0
1 0 0 0 1 1 0 1 1 0
2 0 0 0 1 1 0 1 5 0
$EndEntities
$Nodes
1 4 1 4
2 1 0 4
1
2
3
4
0 0 0
1 0 0
1 1 0
0 1 0
$EndNodes
$Elements
4 4 1 4
1 1 1 1
1 4 1
1 2 1 1
2 2 3
2 1 2 1
3 1 2 3
2 2 2 1
4 1 3 4
$EndElements
"""


@pytest.mark.parametrize("text", [MSH2, MSH4], ids=["2", "4"])
def test_physical_groups_of_both_versions_of_msh(tmp_path, text):
    (tmp_path / "part.msh").write_text(text)
    found = groups(tmp_path / "part.msh", "plane_strain")
    assert found["left"] == {(0, 0), (0, 0.5), (0, 1)}
    assert found["line 2"] == {(1, 0), (1, 0.5), (1, 1)}
    lower, upper = (1, 0), (0, 1)
    assert lower in found["lower"]
    assert upper not in found["lower"]
    assert upper in found["surface 5"]
    assert lower not in found["surface 5"]
    extra = {"also left"} if text is MSH4 else set()
    assert set(found) == {"left", "line 2", "lower", "surface 5"} | extra
    assert found.get("also left", found["left"]) == found["left"]


def test_whole_numbers_of_a_vtu_file(tmp_path):
    import meshio

    cells = np.array([[0, 1, 2, 3, 4, 5, 6, 7], [4, 5, 6, 7, 8, 9, 10, 11]])
    x = np.array(POINTS)[:, 0]
    meshio.Mesh(
        np.array(POINTS, dtype=float),
        [("hexahedron", cells)],
        point_data={"clamped": (x == 0).astype(np.int32), "height": x + 0.5, "label": np.arange(12) + 1},
        cell_data={"zone": [np.array([3, 7])], "none": [np.array([0, 0])]},
    ).write(tmp_path / "part.vtu")
    found = groups(tmp_path / "part.vtu")
    assert found["clamped"] == at(lambda x, y, z: x == 0)
    assert found["zone 3"] == at(lambda x, y, z: x <= 1)
    assert found["zone 7"] == at(lambda x, y, z: x >= 1)
    assert found["zone"] == set(POINTS)
    assert "height" not in found
    assert "none" not in found
    assert found["label 12"] == {POINTS[-1]}
