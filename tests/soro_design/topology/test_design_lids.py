"""Sections with lids: volume, faces and surface of the solid, and its motion against a closed tube."""

import re

import numpy as np
import pytest
from typer.testing import CliRunner

from soro_core.errors import ConfigError, ModelError
from soro_design.fem import read_stl
from soro_design.fem.elements.solid import tables
from soro_design.fem.meshes.surface import is_closed, volume
from soro_design.topology import make_domain, section
from soro_design.topology.domain import normals
from soro_design.topology.shape import snapped, solid_mesh
from soro_design.topology.task import write_task
from soro_ros.cli import application
from tests.soro_design.topology.small import bellow

INNER, OUTER = 5e-3, 8e-3


def tube(lid_mm, height_mm, **changes):
    """A quarter of a tube with lids; its output is the whole of the edge y = 0 of its wall."""
    goal = {"output": {"kind": "box", "y_m": [0.0, 0.0]}, "direction": [1.0, 0.0], "spring_pa": 0.0}
    pressure = {"pressure_pa": [1e2, 1e2]}
    domain = make_domain(bellow(lid_mm=lid_mm, height_mm=height_mm, goal=goal, schedule=pressure, **changes))
    r = np.hypot(*domain.grid.mesh.points.T)
    return domain, np.minimum(r - INNER, OUTER - r)


def area(mesh, faces):
    return np.linalg.norm(normals(mesh.points, faces), axis=1).sum()


@pytest.mark.parametrize(("kind", "layers"), [("quad4", (1, 1)), ("quad8", (3, 2))])
def test_the_lid_closes_the_chamber_and_the_air_presses_on_its_inside(kind, layers):
    domain, level = tube(1.5, 10.0)
    cut = snapped(domain.grid, level)
    mesh, wet = section.lidded_mesh(domain, cut, section.Layers(kind, *layers))
    flat = solid_mesh(domain, cut)
    ring = tables(flat, flat.cells)[2].sum()
    # The corners of the inner contour lie on its circle, so that the chamber is a little less than it.
    chamber = 0.25 * np.pi * INNER**2
    exact = ring * 5e-3 + chamber * 1.5e-3
    assert tables(mesh, mesh.cells)[2].sum() == pytest.approx(exact, rel=5e-3)
    is_lid = np.ptp(mesh.points[wet][..., 2], axis=1) == 0.0
    assert mesh.points[wet[is_lid]][..., 2] == pytest.approx(3.5e-3)
    assert area(mesh, wet[is_lid]) == pytest.approx(chamber, rel=0.02)
    assert area(mesh, wet[~is_lid]) == pytest.approx(0.5 * np.pi * INNER * 3.5e-3, rel=0.02)
    assert np.hypot(*mesh.points[wet[~is_lid]].mean(axis=1)[:, :2].T) == pytest.approx(INNER, rel=0.03)


def test_the_printed_part_with_its_images_holds_water_and_trimesh_agrees():
    domain, level = tube(1.5, 10.0)
    points, triangles = section.lidded_surface(domain, snapped(domain.grid, level))
    assert is_closed(triangles)
    assert points[:, 2].min() == 0.0
    assert points[:, 2].max() == pytest.approx(1e-2)
    exact = np.pi * (OUTER**2 * 10e-3 - INNER**2 * 7e-3)
    assert volume(points, triangles) == pytest.approx(exact, rel=0.02)
    witness = pytest.importorskip("trimesh").Trimesh(points, triangles)
    assert witness.is_watertight
    assert witness.volume == pytest.approx(volume(points, triangles), rel=1e-9)
    # An outside, and the chamber within.
    assert len(witness.split(only_watertight=True)) == 2


@pytest.mark.slow
def test_the_middle_of_a_long_part_is_a_tube_with_closed_ends(monkeypatch):
    """Lame's tube, whose lids stretch it along its axis; the section in plane strain opens farther."""
    domain, level = tube(3.0, 120.0)
    monkeypatch.setattr(section, "CELLS", (288,))
    monkeypatch.setattr(section, "contour_level", lambda domain, filtered: filtered)
    found = section.reanalyse_with_lids(domain, level, np.nan)
    assert found.moved.cause == ""
    mu, nu, p = 72e3, 0.45, 1e2
    # Means over the wall of p a^2 / (2 mu (b^2 - a^2)) (c r + b^2 / r), c of either state.
    scale = p * INNER**2 / (2 * mu * (OUTER**2 - INNER**2)) / (OUTER - INNER)
    exact = [
        scale * (0.5 * c * (OUTER**2 - INNER**2) + OUTER**2 * np.log(OUTER / INNER))
        for c in ((1 - 2 * nu) / (1 + nu), 1 - 2 * nu)
    ]
    print(f"{found.middle_m / exact[0] - 1.0:+.1%} {found.section_m / exact[1] - 1.0:+.1%}")
    assert found.middle_m == pytest.approx(exact[0], rel=0.01)
    # On 48 x 24 elements it is 0.1 % off, of chords and not of arcs.
    assert found.section_m == pytest.approx(exact[1], rel=0.02)
    assert found.moved.motion_m < found.middle_m


@pytest.mark.slow
def test_a_grid_too_coarse_for_the_walls_is_told(monkeypatch):
    domain, _ = tube(1.0, 10.0)
    monkeypatch.setattr(section, "contour_level", lambda domain, filtered: filtered)
    r = np.hypot(*domain.grid.mesh.points.T)
    thin = np.minimum(r - 7.6e-3, 8.6e-3 - r)
    monkeypatch.setattr(section, "CELLS", (18,))
    with pytest.raises(ModelError, match="with lids, on a grid of 18 elements"):
        section.reanalyse_with_lids(domain, thin, 0.0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"lid_mm": 0.0}, "greater than 0"),
        ({"lid_mm": 10.0}, "lid_mm 10 below half the height of the part, 10 mm"),
        ({"lid_mm": 3.0, "height_mm": 5.0}, "lid_mm 3 below half the height of the part, 2.5 mm"),
        ({"height_mm": 20.0}, "height_mm with lid_mm alone"),
        ({"lid_mm": 1.0, "space": "axisymmetric"}, "lid_mm in space plane_strain"),
        ({"lid_mm": "1 kPa"}, "mm"),
    ],
)
def test_lids_that_fit_no_part_are_refused(changes, words):
    with pytest.raises(ConfigError, match=words):
        bellow(**changes)


def test_lengths_of_lids_take_units_and_the_height_is_by_default_the_least_side():
    task = bellow(lid_mm="0.15 cm")
    assert task.lid_m == pytest.approx(1.5e-3)
    # 20 x 10 mm with its images on both sides.
    assert task.height_m == pytest.approx(20e-3)
    assert bellow(lid_mm=1.0, height_mm="2cm", mirrors=[]).height_m == pytest.approx(20e-3)


@pytest.mark.slow
def test_a_run_tells_what_lids_take_and_its_export_has_them(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_task(bellow(lid_mm=1.0, height_mm=12.0), tmp_path / "small.yaml")

    def soro(*arguments):
        return CliRunner().invoke(application(), ["design", *arguments])

    done = soro("run", "small.yaml")
    assert done.exit_code == 0, done.output
    told = re.search(r"with lids: ([\d.]+) mm, in the middle of the height ([\d.]+) mm", done.output)
    mean, middle = (float(number) for number in told.groups())
    flat = float(re.search(r"as coarse: ([\d.]+) mm", done.output)[1])
    assert 0.0 < mean < middle < flat
    refused = soro("export", "small_design", "--stl", "part.stl", "--extrude", "4mm").exception
    assert isinstance(refused, ConfigError)
    assert refused.key == "--extrude"
    written = soro("export", "small_design", "--stl", "part.stl")
    assert written.exit_code == 0, written.output
    points, triangles = read_stl(tmp_path / "part.stl")
    assert is_closed(triangles)
    assert np.ptp(points[:, 2]) == pytest.approx(12e-3)
