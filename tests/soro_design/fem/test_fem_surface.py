"""Surfaces and STL files: closed, of the right volume, there and back."""

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_core.files.stl import read_stl, write_stl
from soro_design.fem.meshes.blocks import block, revolved_tube, sphere, tube
from soro_design.fem.meshes.surface import extruded, is_closed, revolved, solid_surface, volume
from tests.refused import fails


def polygon_area(mesh):
    """Area of a section of straight edges."""
    x, y = mesh.points[mesh.cells[:, :4]].transpose(2, 1, 0)
    return 0.5 * np.abs((x * np.roll(y, -1, axis=0) - np.roll(x, -1, axis=0) * y).sum(axis=0)).sum()


@pytest.mark.parametrize("kind", ["hex8", "hex20"])
def test_the_surface_of_a_solid_closes_around_its_volume(kind):
    points, triangles = solid_surface(block(kind, "solid", (2, 3, 1), (1.0, 2.0, 0.5)))
    assert is_closed(triangles)
    assert volume(points, triangles) == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("kind", ["quad4", "quad8"])
def test_an_extruded_section_has_its_area_times_its_depth(kind):
    mesh = tube(kind, (2, 6), (1.0, 2.0))
    points, triangles = extruded(mesh, 3.0)
    assert is_closed(triangles)
    # Of quad8 the polygon through the middles too.
    area = polygon_area(mesh if kind == "quad4" else tube("quad4", (4, 12), (1.0, 2.0)))
    assert volume(points, triangles) == pytest.approx(3.0 * area, rel=1e-12)


@pytest.mark.parametrize("kind", ["quad4", "quad8"])
@pytest.mark.parametrize("around", [3, 64])
def test_a_revolved_section_has_the_volume_of_the_ring(kind, around):
    for mesh, expected in (
        (revolved_tube(kind, (1, 2), (1.0, 2.0), 3.0), 9.0 * np.pi),
        (block(kind, "axisymmetric", (2, 1), (2.0, 0.5)), 2.0 * np.pi),
    ):
        points, triangles = revolved(mesh, around)
        assert is_closed(triangles)
        assert volume(points, triangles) == pytest.approx(expected, rel=1e-12)


def test_a_displacement_moves_the_surface():
    mesh = revolved_tube("quad4", (1, 1), (1.0, 2.0), 3.0)
    assert volume(*revolved(mesh, 16, u=0.1 * mesh.points)) == pytest.approx(1.1**3 * 9.0 * np.pi)


def test_an_open_surface_is_not_closed():
    _, triangles = solid_surface(block("hex8", "solid", (1, 1, 1), (1.0, 1.0, 1.0)))
    assert not is_closed(triangles[1:])
    assert not is_closed(np.concatenate([triangles[1:], triangles[:1, ::-1]]))


def test_an_stl_file_is_there_and_back(tmp_path):
    """In millimetres and single precision; the corners of a bowl, welded again, close."""
    points, triangles = revolved(sphere("quad4", (1, 4), (1e-3, 2e-3)), 12)
    write_stl(tmp_path / "part.stl", points, triangles)
    again, same = read_stl(tmp_path / "part.stl")
    assert len(again) == len(points)
    assert is_closed(same)
    assert volume(again, same) == pytest.approx(volume(points, triangles), rel=1e-6)
    np.testing.assert_allclose(again.max(axis=0), points.max(axis=0), rtol=1e-6)
    # The same in words.
    lines = [
        " ".join(["vertex", *(repr(float(x)) for x in point)])
        for point in 1e3 * points[triangles].reshape(-1, 3)
    ]
    (tmp_path / "words.stl").write_text("solid part\n" + "\n".join(lines) + "\nendsolid\n")
    worded, third = read_stl(tmp_path / "words.stl")
    np.testing.assert_array_equal(worded, again)
    np.testing.assert_array_equal(third, same)


def test_normals_of_a_file_point_outwards(tmp_path):
    points, triangles = solid_surface(block("hex8", "solid", (1, 1, 1), (1.0, 1.0, 1.0)))
    write_stl(tmp_path / "a.stl", points, triangles, unit_m=1.0)
    raw = (tmp_path / "a.stl").read_bytes()
    records = np.frombuffer(raw, dtype=[("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")], offset=84)
    outwards = records["c"].mean(axis=1) - 0.5
    assert ((records["n"] * outwards).sum(axis=1) > 0.4).all()


def test_what_is_refused(tmp_path):
    section, ring = (
        block("quad4", "plane_strain", (1, 1), (1.0, 1.0)),
        revolved_tube("quad4", (1, 1), (1.0, 2.0), 1.0),
    )
    for surface in (solid_surface, revolved):
        with fails(ModelError, "plane_strain", key="space"):
            surface(section)
    with fails(ModelError, key="space"):
        extruded(ring, 1.0)
    with fails(ModelError, key="depth_m"):
        extruded(section, 0.0)
    with fails(ModelError, key="around"):
        revolved(ring, 2)
    with fails(ModelError, key="path"):
        write_stl(tmp_path / "no" / "a.stl", *extruded(section, 1.0))
    (tmp_path / "bad.stl").write_text("nothing of the kind\n")
    (tmp_path / "short.stl").write_bytes(b"x" * 80 + (7).to_bytes(4, "little"))
    (tmp_path / "odd.stl").write_text("vertex 1 2 3\nvertex 1 2\n")
    for name in ("bad.stl", "short.stl", "odd.stl", "none.stl"):
        with fails(ModelError, name, key="path"):
            read_stl(tmp_path / name)
