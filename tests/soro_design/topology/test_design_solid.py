"""A design in space: its tetrahedra, what is wet, its own mesh against a thick sphere, its surface."""

import numpy as np
import pytest

from soro_core.config import with_changes
from soro_core.errors import ConfigError
from soro_design.fem.elements.solid import tables
from soro_design.fem.meshes.surface import is_closed, volume
from soro_design.topology import load_task, make_domain, optimise, reanalyse, shape, task_from_dict
from soro_design.topology.check import FinalPart
from soro_design.topology.flood import flood, wet_faces
from soro_design.topology.physics.tetrahedra import cut_tetrahedra, tetrahedra, turned
from soro_design.topology.section import final_surface
from soro_design.topology.shape import snapped, solid_mesh
from tests.soro_design.topology.small import ball, box


def shell(domain, inner=5e-3, outer=8e-3):
    r = np.linalg.norm(domain.grid.mesh.points, axis=1)
    return snapped(domain.grid, np.minimum(r - inner, outer - r))


SHELL = ((8.9e-3, 0.9), (5e-3, 0.05))


def test_the_tetrahedra_fill_the_grid_and_meet_face_to_face():
    grid = make_domain(box()).grid
    cells = tetrahedra(grid)
    at = grid.mesh.points[cells]
    volumes = np.abs(np.linalg.det(at[:, 1:] - at[:, :1])) / 6.0
    assert volumes.sum() == pytest.approx(grid.volumes.sum(), rel=1e-12)
    faces = np.sort(cells[:, [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]].reshape(-1, 3), axis=1)
    _, count = np.unique(faces, axis=0, return_counts=True)
    outside = 4 * sum(a * b for a, b in ((6, 5), (5, 6), (6, 6)))
    assert ((count == 1).sum(), count.max()) == (outside, 2)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_cut_away_and_what_stays_are_the_whole(seed):
    grid = make_domain(box()).grid
    level = np.random.default_rng(seed).uniform(-1.0, 1.0, len(grid.mesh.points))
    cut = snapped(grid, level)
    total = 0.0
    for sign in (1.0, -1.0):
        points, cells = cut_tetrahedra(tetrahedra(grid), grid.mesh.points, sign * level)
        at = points[turned(points, cells)]
        own = np.linalg.det(at[:, 1:] - at[:, :1]) / 6.0
        assert own.min() > 0.0
        total += own.sum()
    assert total == pytest.approx(grid.volumes.sum(), rel=1e-12)
    # With nodes moved onto the contour no tetrahedron is turned over.
    ends = cut.points[tetrahedra(grid)]
    before = grid.mesh.points[tetrahedra(grid)]
    after, old = (np.linalg.det(one[:, 1:] - one[:, :1]) for one in (ends, before))
    assert (after * old > 0.0).all()


def test_the_shell_of_a_ball_holds_air_and_a_hole_leaks():
    domain = make_domain(ball())
    cut = shell(domain)
    found = flood(domain, cut)
    assert found.is_wet.any()
    assert not found.is_leak.any()
    mesh = solid_mesh(domain, cut)
    eighth = np.pi / 6.0 * (8e-3**3 - 5e-3**3)
    assert tables(mesh, mesh.cells)[2].sum() == pytest.approx(eighth, rel=0.03)
    wet, outer = wet_faces(domain, cut, found, mesh)
    radius = np.linalg.norm(mesh.points, axis=1)
    assert radius[wet[:, :3]] == pytest.approx(5e-3, abs=2e-4)
    assert radius[outer[:, :3]] == pytest.approx(8e-3, abs=2e-4)
    x, y, z = domain.grid.mesh.points.T
    holed = np.where((x < 1.5e-3) & (y < 1.5e-3) & (z > 4e-3), -1.0, cut.level)
    assert flood(domain, snapped(domain.grid, holed)).is_leak.any()


@pytest.mark.slow
def test_the_part_on_its_own_mesh_is_a_thick_sphere():
    """An eighth of a ball under pressure inside, held on its planes: the small strains of Lame's sphere."""
    task = ball()
    task = with_changes(task, schedule=with_changes(task.schedule, pressure_pa=(1e2, 1e2)))
    domain = make_domain(task)
    cut = shell(domain)
    mesh, air = solid_mesh(domain, cut), flood(domain, cut)
    found = reanalyse(domain, FinalPart(cut, mesh, air, *wet_faces(domain, cut, air, mesh), 0.0, np.zeros(3)))
    mu, nu, p, a, b = 72e3, 0.45, 1e2, 5e-3, 8e-3
    # u = p a^3 / (b^3 - a^3) ((1 - 2 nu) r / (2 mu (1 + nu)) + b^3 / (4 mu r^2)), its mean along x over a
    # quarter of a ring.
    by_radius = (1 - 2 * nu) / (2 * mu * (1 + nu)) * (b**3 - a**3) / 3 + b**3 / (4 * mu) * np.log(b / a)
    exact = p * a**3 / (b**3 - a**3) * by_radius / (0.5 * (b**2 - a**2)) * 2 / np.pi
    assert found.cause == ""
    assert found.motion_m == pytest.approx(exact, rel=0.03)


def test_the_surface_with_its_images_is_watertight_and_has_eight_times_the_volume():
    domain = make_domain(ball())
    mesh = solid_mesh(domain, shell(domain))
    points, triangles = final_surface(domain.task, mesh, 0.0, 0)
    assert is_closed(triangles)
    assert volume(points, triangles) == pytest.approx(8.0 * tables(mesh, mesh.cells)[2].sum(), rel=1e-9)
    witness = pytest.importorskip("trimesh").Trimesh(points, triangles)
    assert witness.is_watertight
    assert witness.is_winding_consistent
    assert witness.volume == pytest.approx(volume(points, triangles), rel=1e-9)
    # An outside, and the chamber within.
    assert len(witness.split(only_watertight=True)) == 2


@pytest.mark.slow
def test_a_run_from_a_closed_shell_gets_better_and_stays_sealed():
    """Under a schedule that does not change, so that the iterations compare."""
    start = [
        {"where": {"kind": "disc", "centre_m": [0, 0, 0], "radius_m": r}, "density": d} for r, d in SHELL
    ]
    same = {"pressure_pa": [5e2, 5e2], "penalty": [3.0, 3.0], "sharpness": [], "iterations": 5, "ramp": 0}
    task = box(cells=[8, 8, 6], start=start, volume_fraction=0.4, schedule=same)
    domain = make_domain(task)
    state = optimise(task)
    assert state.rows[-1].objective < 1.2 * state.rows[0].objective < 0.0
    assert state.rows[-1].volume < 0.41
    found = shape(domain, state)
    assert not found.leak
    assert is_closed(final_surface(task, found.mesh, 0.0, 0)[1])


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"cells": [4, 4]}, "cells of 3 numbers in space solid"),
        ({"space": "plane_strain"}, "size_m of 2 numbers in space plane_strain"),
        ({"inlet": {"kind": "disc", "centre_m": [0.0, 0.0], "radius_m": 0.004}}, "centre_m of 3 numbers"),
    ],
)
def test_numbers_of_the_wrong_space_are_refused(changes, says):
    with pytest.raises(ConfigError, match=says):
        box(**changes)


def test_z_belongs_to_a_solid():
    data = load_task("bellow").model_dump(mode="json", exclude_unset=True)
    with pytest.raises(ConfigError, match="z in space solid alone"):
        task_from_dict({**data, "mirrors": ["z"]})
