"""Closed surfaces inside a mesh: found, numbered, chosen by a point or an STL, and pressed."""

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_core.files.stl import write_stl
from soro_design.fem.elements.mesh import make_mesh
from soro_design.fem.meshes.blocks import block, sphere, tube
from soro_design.fem.meshes.cavities import inner_surfaces, surface_around, surface_of
from soro_design.fem.meshes.surface import is_closed, pieces, solid_surface, volume
from soro_design.fem.meshes.vtu import write_vtu
from soro_design.parts.file import load_part
from soro_design.parts.specimen import make_specimen
from soro_design.parts.sweeps import follow
from tests.refused import fails, refused
from tests.soro_design.fem.hollow import (
    CAVITIES,
    COUNTS,
    NET_AIR,
    NET_COUNTS,
    NET_SIZE,
    NET_SLOTS,
    SIZE,
    without,
)
from tests.soro_design.fem.small_parts import written


def boxed(mesh, box):
    """Faces of the boundary with all nodes in a box in mm."""
    low, high = np.array(box)
    return mesh.faces_at(((1e3 * mesh.points > low - 1e-6) & (1e3 * mesh.points < high + 1e-6)).all(axis=1))


def same(one, other):
    return {frozenset(face) for face in one.tolist()} == {frozenset(face) for face in other.tolist()}


@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet10"])
def test_a_hollow_block_has_two_surfaces_inside_the_greater_first(kind):
    mesh = without(kind, SIZE, COUNTS, CAVITIES)
    first, second = inner_surfaces(mesh)
    for found, expected, box in ((first, 8e-6, CAVITIES[1]), (second, 4e-6, CAVITIES[0])):
        assert found.volume == pytest.approx(expected, rel=1e-12)
        triangles = pieces(found.faces)
        assert is_closed(triangles)
        assert volume(mesh.points, triangles) == pytest.approx(-expected, rel=1e-12)
        assert same(found.faces, boxed(mesh, box))


def test_connected_chambers_are_one_surface_that_boxes_do_not_find():
    mesh = without("tet10", NET_SIZE, NET_COUNTS, (*NET_AIR, *NET_SLOTS))
    (found,) = inner_surfaces(mesh)
    # Three chambers of 10 x 10 x 30 mm, and twice 30 mm of a channel of 10 x 10 mm.
    assert found.volume == pytest.approx(1e-9 * (3 * 3000 + 2 * 3000), rel=1e-12)
    assert not same(found.faces, boxed(mesh, ((10, 10, 10), (100, 20, 40))))


def test_surfaces_of_sections():
    """A square hole in plane strain; about an axis a ball of air that the axis closes, and an open tube."""
    mesh = without("quad4", (50, 30), (5, 3), [((10, 10), (40, 20))])
    (found,) = inner_surfaces(mesh)
    assert found.volume == pytest.approx(300e-6)
    ball = sphere("quad4", (2, 64), (1.0, 2.0))
    halves = np.concatenate([ball.points, ball.points * [1.0, -1.0]])
    r, z = halves.T
    cells = np.concatenate([ball.cells, ball.cells[:, ::-1] + len(ball.points)])
    used, number = np.unique(np.round(np.stack([r, z], axis=1), 9) + 0.0, axis=0, return_inverse=True)
    shell = make_mesh("quad4", "axisymmetric", used, number.ravel()[cells])
    (found,) = inner_surfaces(shell)
    assert found.volume == pytest.approx(4.0 / 3.0 * np.pi, rel=1e-3)
    assert same(surface_around(shell, [found], (0.0, 0.5)), found.faces)
    with fails(ModelError, key="point"):
        surface_around(shell, [found], (0.0, 1.5))
    assert inner_surfaces(ball) == []
    assert inner_surfaces(tube("hex8", (1, 4, 1), (1.0, 2.0))) == []


def test_a_point_in_the_air_chooses_its_surface():
    mesh = without("tet10", SIZE, COUNTS, CAVITIES)
    found = inner_surfaces(mesh)
    assert surface_around(mesh, found, (0.015, 0.02, 0.02)) is found[1].faces
    assert surface_around(mesh, found, (0.049, 0.011, 0.029)) is found[0].faces
    for outside in ((0.025, 0.02, 0.02), (0.1, 0.0, 0.0)):
        with fails(ModelError, key="point"):
            surface_around(mesh, found, outside)


def test_of_nested_surfaces_the_inmost_is_chosen():
    """A hollow body in the air of another one."""
    slabs = [[(10, 60)] * 3 for _ in range(6)]
    for k, slab in enumerate(slabs):
        slab[k % 3] = (10, 20) if k < 3 else (50, 60)
    boxes = [tuple(zip(*slab, strict=True)) for slab in (*slabs, [(30, 40)] * 3)]
    mesh = without("hex8", (70, 70, 70), (7, 7, 7), boxes)
    found = inner_surfaces(mesh)
    assert [one.volume for one in found] == pytest.approx([1e-9 * 50**3, 1e-9 * 10**3])
    assert surface_around(mesh, found, (0.035, 0.035, 0.035)) is found[1].faces
    assert surface_around(mesh, found, (0.015, 0.035, 0.035)) is found[0].faces


def test_an_stl_of_other_triangles_chooses_its_surface(tmp_path):
    mesh = without("tet10", SIZE, COUNTS, CAVITIES)
    cavity = block("hex8", "solid", (3, 5, 7), (0.02, 0.02, 0.02))
    points, triangles = solid_surface(cavity)
    found = inner_surfaces(mesh)
    shifted = points + np.array([0.03, 0.01, 0.01])
    assert same(surface_of(mesh, found, shifted, triangles), found[0].faces)
    assert same(surface_of(mesh, found, shifted, triangles[:, ::-1]), found[0].faces)
    # With an inlet through the wall no surface closes; what faces the air of the STL is found all the same.
    inlet = without("tet10", SIZE, COUNTS, (CAVITIES[1], ((50, 10, 10), (60, 20, 20))))
    assert inner_surfaces(inlet) == []
    faces = surface_of(inlet, [], shifted, triangles)
    area = np.linalg.norm(np.cross(*np.diff(inlet.points[pieces(faces)], axis=1).transpose(1, 0, 2)), axis=1)
    assert 0.5e6 * area.sum() == pytest.approx(6 * 400 - 100)
    with fails(ModelError, key="stl"):
        surface_of(mesh, found, points + 1.0, triangles)


HOLLOW = {
    "kind": "mesh",
    "file": "hollow.vtu",
    "regions": {"base": {"x_m": [0.0, 0.0]}, "cavity": {"inner_surface": 1}},
    "held": [{"region": "base", "directions": "xyz"}],
    "pressed": [{"region": "cavity"}],
}
PART = {
    "geometry": HOLLOW,
    "material": "dragonskin_10",
    "sweeps": [{"name": "blown", "pressures_pa": [2e3], "states": 1}],
}
CORNERS, TRIANGLES = solid_surface(block("hex8", "solid", (2, 2, 2), (0.02, 0.02, 0.02)))
BOX = {"x_m": [0.03, 0.05], "y_m": [0.01, 0.03], "z_m": [0.01, 0.03]}


def specimen(tmp_path, cavity, mesh=None):
    pytest.importorskip("meshio", reason="needs the extra design: pip install 'soro[design]'")
    write_vtu(tmp_path / "hollow.vtu", mesh or without("hex8", SIZE, COUNTS, CAVITIES))
    write_stl(tmp_path / "cavity.stl", CORNERS + np.array([0.03, 0.01, 0.01]), TRIANGLES, unit_m=1.0)
    geometry = {**HOLLOW, "regions": {**HOLLOW["regions"], "cavity": cavity}}
    return load_part(written(tmp_path, PART, geometry=geometry))


@pytest.mark.parametrize(
    "cavity", [{"inner_surface": 1}, {"around_m": [0.04, 0.02, 0.02]}, {"stl": "cavity.stl"}]
)
def test_a_part_moves_as_with_a_box(tmp_path, cavity):
    moved = []
    for region in (cavity, BOX):
        file = specimen(tmp_path, region)
        done = follow(make_specimen(file), file.sweeps[0], lambda state: None)
        assert done.status == "solved", done.cause
        moved.append(done.last.u)
    np.testing.assert_allclose(moved[0], moved[1], atol=1e-12)
    assert np.abs(moved[0]).max() > 1e-5


def test_a_region_may_cut_a_surface(tmp_path):
    """The far half of one, and what two ways of choosing have in common."""
    file = specimen(tmp_path, {"inner_surface": 1, "around_m": [0.04, 0.02, 0.02], "stl": "cavity.stl"})
    faces, _ = make_specimen(file).pressed[0]
    assert len(faces) == 6 * 4
    with refused("geometry.pressed[0]"):
        make_specimen(specimen(tmp_path, {"inner_surface": 1, "x_m": [0.04, 0.05]}))


@pytest.mark.parametrize(
    ("cavity", "key", "names"),
    [
        ({"inner_surface": 0}, "inner_surface", ()),
        ({"inner_surface": 3}, "inner_surface", ("1 (8000 mm3, (0.03, 0.01, 0.01) to", "2 (4000 mm3, ")),
        ({"around_m": [0.025, 0.02, 0.02]}, "around_m", ("air", "1 (8000 mm3, ", "2 (4000 mm3, ")),
        ({"around_m": [0.04, 0.02]}, "around_m", ("3 numbers",)),
        ({"stl": "none.stl"}, "stl", ("beside the part file",)),
        ({"stl": "part.yaml"}, "stl", ("STL",)),
        ({"inner_surface": 2, "stl": "cavity.stl"}, "", ("nodes",)),
    ],
)
def test_what_is_refused(tmp_path, cavity, key, names):
    with refused(f"geometry.regions.cavity{key and '.' + key}", names=names):
        make_specimen(specimen(tmp_path, cavity))


@pytest.mark.parametrize("cavity", [{"inner_surface": 1}, {"around_m": [0.04, 0.02, 0.02]}])
def test_a_mesh_without_closed_surfaces_says_so(tmp_path, cavity):
    (key,) = cavity
    with refused(f"geometry.regions.cavity.{key}", names=("no surface closes", "bounds")):
        make_specimen(specimen(tmp_path, cavity, block("hex8", "solid", COUNTS, (0.06, 0.04, 0.04))))
