"""Parts of meshes as public examples of soft robots have them: their cavities, and pieces that are loose."""

import numpy as np
import pytest

from soro_core.files.stl import write_stl
from soro_design.fem.meshes.blocks import block
from soro_design.fem.meshes.cavities import inner_surfaces
from soro_design.fem.meshes.mesh_files import read_mesh
from soro_design.fem.meshes.surface import solid_surface
from soro_design.parts.file import load_part
from soro_design.parts.specimen import make_specimen
from soro_design.parts.sweeps import follow
from tests.refused import refused
from tests.soro_design.fem.foreign import NET_VOLUME, gmsh_vtk, net_of_tetrahedra
from tests.soro_design.fem.small_parts import written

pytest.importorskip("meshio", reason="needs the extra design: pip install 'soro[design]'")
POINTS, TETRAHEDRA = net_of_tetrahedra()
NET = {
    "kind": "mesh",
    "file": "net.vtk",
    "unit_m": 1e-3,
    "regions": {"base": {"x_m": [0.0, 0.0]}, "cavity": {"inner_surface": 1}, "tip": {"x_m": [0.11, 0.11]}},
    "held": [{"region": "base", "directions": "xyz"}],
    "pressed": [{"region": "cavity"}],
    "forced": "tip",
}
PART = {
    "geometry": NET,
    "material": "dragonskin_10",
    "sweeps": [{"name": "blown", "pressures_pa": [1e3], "states": 1}],
}


def specimen(tmp_path, points=POINTS, tetrahedra=TETRAHEDRA, **regions):
    (tmp_path / "net.vtk").write_text(gmsh_vtk(points, tetrahedra))
    geometry = {**NET, "regions": {**NET["regions"], **regions}}
    return make_specimen(load_part(written(tmp_path, PART, geometry=geometry)))


def test_a_pneunet_of_gmsh_is_blown(tmp_path):
    """Its chambers are above the channel: it bends down. Points, lines and triangles do not disturb."""
    made = specimen(tmp_path)
    assert made.part.mesh.kind == "tet10"
    assert len(made.part.mesh.cells) == len(TETRAHEDRA)
    (found,) = inner_surfaces(made.part.mesh)
    assert found.volume == pytest.approx(NET_VOLUME, rel=1e-9)
    sweep = load_part(tmp_path / "part.yaml").sweeps[0]
    done = follow(made, sweep, lambda state: None)
    assert done.status == "solved", done.cause
    assert made.measured(done.last)["mean_z_m"] < -1e-4


def test_its_cavity_is_chosen_by_a_point_or_an_stl(tmp_path):
    expected = {frozenset(face) for face in specimen(tmp_path).pressed[0][0].tolist()}
    (found,) = inner_surfaces(read_mesh(tmp_path / "net.vtk", "solid").mesh)
    mesh = read_mesh(tmp_path / "net.vtk", "solid").mesh
    write_stl(tmp_path / "air.stl", mesh.points, found.faces[:, [2, 1, 0]], unit_m=1.0)
    for cavity in ({"around_m": [0.055, 0.015, 0.015]}, {"stl": "air.stl"}):
        faces = specimen(tmp_path, cavity=cavity).pressed[0][0]
        assert {frozenset(face) for face in faces.tolist()} == expected


def test_an_stl_that_leaves_the_part_chooses_the_cavity_alone(tmp_path):
    """A box around the three chambers has the air of the slots between them too."""
    whole = specimen(tmp_path).pressed[0][0]
    points, triangles = solid_surface(block("hex8", "solid", (1, 1, 1), (0.09, 0.01, 0.03)))
    write_stl(tmp_path / "air.stl", 1e3 * (points + 0.01), triangles, unit_m=1.0)
    assert len(specimen(tmp_path, cavity={"stl": "air.stl"}).pressed[0][0]) == len(whole)


def test_an_stl_whose_triangles_differ_in_sense_is_refused(tmp_path):
    points, triangles = solid_surface(block("hex8", "solid", (2, 2, 2), (0.01, 0.01, 0.01)))
    triangles[::2] = triangles[::2, ::-1]
    write_stl(tmp_path / "air.stl", points + np.array([0.01, 0.01, 0.02]), triangles)
    with refused("geometry.regions.cavity.stl", names=("outwards",)):
        specimen(tmp_path, cavity={"stl": "air.stl"})


def test_a_point_that_misses_reads_where_the_air_is(tmp_path):
    place = "1 (1.5e+04 mm3, (0.01, 0.01, 0.01) to (0.1, 0.02, 0.04) m)"
    for key, value in (("around_m", [55.0, 15.0, 15.0]), ("inner_surface", 2)):
        with refused(f"geometry.regions.cavity.{key}", value, names=(place,)):
            specimen(tmp_path, cavity={key: value})


def parted():
    """The net, cut at x = 60 mm: nodes there are twice."""
    far = POINTS[TETRAHEDRA].mean(axis=1)[:, 0] > 60.0
    return np.concatenate([POINTS, POINTS]), TETRAHEDRA + len(POINTS) * far[:, None]


def test_a_piece_that_nothing_holds_is_named(tmp_path):
    with refused("geometry.held", ["base"], names=("2 pieces", "nodes lie where others are")):
        specimen(tmp_path, *parted())


def test_a_cavity_in_two_pieces_does_not_close(tmp_path):
    """Both are held, so that only its surface is wrong."""
    both = {"y_m": [0.0, 0.0]}
    with refused("geometry.regions.cavity.inner_surface", names=("nodes lie where others are", "closes")):
        specimen(tmp_path, *parted(), base=both)
