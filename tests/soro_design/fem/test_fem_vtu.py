"""VTU files, read back by the rules of the format."""

import base64
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_design.fem.elements.element import SOLIDS
from soro_design.fem.meshes.blocks import block
from soro_design.fem.meshes.vtu import write_pvd, write_vtu
from tests.refused import fails

TYPES = {"Float64": "<f8", "Int64": "<i8", "UInt8": "|u1"}


def arrays(path):
    """All arrays by name: a header of eight bytes with the number of bytes, then these."""
    found = {}
    for one in ET.parse(path).getroot().iter("DataArray"):
        raw = base64.b64decode(one.text)
        assert int.from_bytes(raw[:8], "little") == len(raw) - 8
        values = np.frombuffer(raw[8:], TYPES[one.get("type")])
        found[one.get("Name")] = values.reshape(-1, int(one.get("NumberOfComponents")))
    return found


@pytest.mark.parametrize("kind", SOLIDS)
def test_a_file_holds_mesh_and_fields(kind, tmp_path):
    d = 2 if kind.startswith("quad") else 3
    mesh = block(kind, "plane_strain" if d == 2 else "solid", (2, 1, 2)[:d], (1.0, 2.0, 3.0)[:d])
    u = np.random.default_rng(1).normal(size=mesh.points.shape)
    ratio = np.arange(len(mesh.cells)) + 0.1
    file = tmp_path / "part.vtu"
    write_vtu(file, mesh, {'u < "v"': u}, {"ratio": ratio})
    found = arrays(file)
    np.testing.assert_array_equal(found["points"][:, :d], mesh.points)
    np.testing.assert_array_equal(found['u < "v"'][:, :d], u)
    assert found["points"].shape[1] == 3
    assert not found["points"][:, d:].any()
    np.testing.assert_array_equal(found["ratio"][:, 0], ratio)
    ends = found["offsets"][:, 0]
    cells = np.split(found["connectivity"][:, 0], ends[:-1])
    np.testing.assert_array_equal(cells, mesh.cells)
    assert set(found["types"][:, 0]) == {
        {"quad4": 9, "quad8": 23, "hex8": 12, "hex20": 25, "tet10": 24}[kind]
    }
    piece = ET.parse(file).getroot().find("UnstructuredGrid/Piece")
    assert int(piece.get("NumberOfPoints")) == len(mesh.points)
    assert int(piece.get("NumberOfCells")) == len(mesh.cells)


def test_edges_of_a_quadratic_hexahedron_have_their_middle_nodes():
    """The order that the format states: bottom, top, then the upright edges."""
    mesh = block("hex20", "solid", (1, 1, 1), (1.0, 1.0, 1.0))
    at = mesh.points[mesh.cells[0]]
    edges = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
    np.testing.assert_allclose(at[8:], [(at[a] + at[b]) / 2 for a, b in edges])


@pytest.mark.parametrize("kind", SOLIDS)
def test_another_program_reads_it(kind, tmp_path):
    meshio = pytest.importorskip("meshio", reason="needs the extra design: pip install 'soro[design]'")
    d = 2 if kind.startswith("quad") else 3
    mesh = block(kind, "plane_strain" if d == 2 else "solid", (2, 1, 2)[:d], (1.0, 2.0, 3.0)[:d])
    u, ratio = np.random.default_rng(1).normal(size=mesh.points.shape), np.arange(len(mesh.cells)) + 0.1
    write_vtu(tmp_path / "part.vtu", mesh, {"u": u, "height": u[:, 0]}, {"ratio": ratio})
    found = meshio.read(tmp_path / "part.vtu")
    names = {"hex8": "hexahedron", "hex20": "hexahedron20", "tet10": "tetra10", "quad4": "quad"}
    assert [block.type for block in found.cells] == [names.get(kind, kind)]
    np.testing.assert_array_equal(found.points[:, :d], mesh.points)
    np.testing.assert_array_equal(found.cells[0].data, mesh.cells)
    np.testing.assert_array_equal(found.point_data["u"][:, :d], u)
    np.testing.assert_array_equal(found.point_data["height"].ravel(), u[:, 0])
    np.testing.assert_array_equal(found.cell_data["ratio"][0].ravel(), ratio)


def test_a_series_names_its_files_by_load(tmp_path):
    write_pvd(tmp_path / "pull.pvd", {0.5: "pull_01.vtu", 1.0: 'a"b.vtu'})
    root = ET.parse(tmp_path / "pull.pvd").getroot()
    assert (root.tag, root.get("type")) == ("VTKFile", "Collection")
    rows = [(float(one.get("timestep")), one.get("file")) for one in root.find("Collection")]
    assert rows == [(0.5, "pull_01.vtu"), (1.0, 'a"b.vtu')]


def test_edges_of_a_quadratic_tetrahedron_have_their_middle_nodes():
    mesh = block("tet10", "solid", (1, 1, 1), (1.0, 1.0, 1.0))
    at = mesh.points[mesh.cells[0]]
    edges = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]
    np.testing.assert_allclose(at[4:], [(at[a] + at[b]) / 2 for a, b in edges])


def test_what_is_refused(tmp_path):
    mesh = block("quad4", "plane_strain", (1, 1), (1.0, 1.0))
    with fails(ModelError, "'u'", key="field"):
        write_vtu(tmp_path / "part.vtu", mesh, {"u": np.zeros(3)})
    with fails(ModelError, key="path"):
        write_vtu(tmp_path / "none" / "part.vtu", mesh)
    with fails(ModelError, key="path"):
        write_pvd(tmp_path / "none" / "part.pvd", {})
