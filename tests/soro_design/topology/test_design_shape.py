"""The final part: its contour, what is wet, walls, and solids that hold water."""

from dataclasses import replace

import numpy as np
import pytest

from soro_design.fem import extruded, revolved
from soro_design.fem.elements.solid import tables
from soro_design.fem.meshes.surface import is_closed, volume
from soro_design.topology.check import FinalPart, reanalyse
from soro_design.topology.domain import make_domain
from soro_design.topology.flood import flood, thinnest_wall, wet_faces
from soro_design.topology.physics.filter import density_filter, projection
from soro_design.topology.section import mirrored
from soro_design.topology.shape import contour, snapped, solid_mesh
from tests.soro_design.topology.small import bellow

DOMAIN = make_domain(bellow())
GRID = DOMAIN.grid
X, Y = GRID.mesh.points.T


def area(section):
    """Of a section in plane strain, which is 1 m thick [m2]."""
    return tables(section, section.cells)[2].sum()


def dome(inner=5e-3, outer=8e-3):
    """A quarter of a tube about the inlet, as a level: the distance to its border."""
    r = np.hypot(X, Y)
    return snapped(GRID, np.minimum(r - inner, outer - r))


def nodes(*places):
    """Numbers of the nodes at these columns and rows of the grid."""
    return sorted(column * 13 + row for column, row in places)


def test_the_contour_follows_a_circle():
    """Of linear cuts: the area of a quarter ring within the square of the element, no node far off."""
    domain = replace(DOMAIN, output=np.where(np.hypot(X, Y)[:, None] < 8e-3, 1.0, 0.0) * [0.0, 1.0])
    mesh = solid_mesh(domain, dome())
    exact = 0.25 * np.pi * (8e-3**2 - 5e-3**2)
    assert area(mesh) == pytest.approx(exact, rel=0.02)
    ends = mesh.points[mesh.boundary()]
    r = np.hypot(*ends.reshape(-1, 2).T)
    on_axes = (ends.reshape(-1, 2) == 0.0).any(axis=1)
    gap = np.minimum(np.abs(r - 5e-3), np.abs(r - 8e-3))
    assert gap[~on_axes].max() < 0.1 * GRID.edge_m[0]


def test_given_solid_keeps_its_faces_beside_grey():
    """A block between a given void and elements of the density .3, which the projection makes void."""
    block, void = ({"kind": "box", "x_m": x, "y_m": [0.0, 0.01]} for x in ([0.005, 0.01], [0.0, 0.005]))
    task = bellow(solid=[block], void=[void], volume_fraction=0.3, schedule={"sharpness": [32.0]})
    domain = make_domain(task)
    filtered = np.full(len(domain.is_solid), 0.3)
    cut = contour(domain, filtered)
    ends = cut.points[cut.level > 0.0, 0]
    assert (ends.min(), ends.max()) == pytest.approx((0.005, 0.01), abs=1.01 * GRID.edge_m[0])
    mesh = solid_mesh(replace(domain, output=np.ones_like(domain.output)), cut)
    assert area(mesh) == pytest.approx(5e-5, rel=0.01)


def test_what_is_solid_everywhere_is_solid():
    domain = replace(DOMAIN, is_void=np.zeros_like(DOMAIN.is_void))
    assert (contour(domain, np.ones(len(domain.is_void))).level > 0.0).all()


@pytest.mark.parametrize("seed", range(3))
def test_the_part_has_the_volume_of_its_densities(seed):
    """Of blobs that touch the output everywhere, which are smaller than the elements show."""
    domain = make_domain(bellow(solid=[], schedule={"sharpness": [8.0]}))
    variables = np.random.default_rng(seed).uniform(0.0, 1.0, len(domain.is_solid))
    filtered = np.clip(3.0 * (density_filter(domain.grid, 2e-3) @ variables) - 1.1, 0.0, 1.0)
    density = np.where(domain.is_void, 0.0, projection(filtered, 8.0, 0.5)[0])
    mesh = solid_mesh(replace(domain, output=np.ones_like(domain.output)), contour(domain, filtered))
    assert area(mesh) == pytest.approx(domain.grid.volumes @ density, rel=0.02)


def test_exactly_the_void_inside_the_dome_is_wet():
    cut = dome()
    found = flood(DOMAIN, cut)
    assert (found.is_wet == (np.hypot(X, Y) < 5e-3) & (cut.level < 0.0)).all()
    assert not found.is_leak.any()
    assert not found.is_closed.any()


def test_exactly_the_way_through_a_hole_leaks():
    """A hole along y = 0 from the inside to x = 20 mm, and a bubble in the wall that nothing reaches."""
    level = np.ones(len(X))
    inside, hole, bubble = [(0, 0), (1, 0), (0, 1), (1, 1)], [(k, 0) for k in range(25)], [(12, 6), (13, 6)]
    for found in (inside, hole, bubble):
        level[nodes(*found)] = -1.0
    found = flood(DOMAIN, snapped(GRID, level))
    assert np.flatnonzero(found.is_wet).tolist() == sorted({*nodes(*inside), *nodes(*hole)})
    assert np.flatnonzero(found.is_leak).tolist() == nodes((24, 0))
    assert np.flatnonzero(found.is_closed).tolist() == nodes(*bubble)


@pytest.mark.parametrize(("rest", "joined"), [(0.4, True), (2.5, False)])
def test_air_passes_a_corner_only_where_solid_does_not_join_across_it(rest, joined):
    """Two void nodes across a cell: open where the mean of its corners is void, else solid bridges them."""
    level = np.full(len(X), rest)
    inside = [(k, row) for k in range(6) for row in range(6)]
    outside = [(k, row) for k in range(6, 25) for row in range(6, 13)]
    level[nodes(*inside, *outside)] = -1.0
    found = flood(DOMAIN, snapped(GRID, level))
    expected = {*nodes(*inside), *nodes(*outside)} if joined else set(nodes(*inside))
    assert set(np.flatnonzero(found.is_wet)) == expected


def test_wet_faces_and_wall_of_a_dome():
    cut = dome()
    domain = replace(DOMAIN, output=np.where(np.hypot(X, Y)[:, None] < 8e-3, 1.0, 0.0) * [0.0, 1.0])
    mesh = solid_mesh(domain, cut)
    wet, outer = wet_faces(DOMAIN, cut, flood(DOMAIN, cut), mesh)
    radius = [np.hypot(*mesh.points[faces].mean(axis=1).T) for faces in (wet, outer)]
    assert radius[0] == pytest.approx(5e-3, abs=1e-4)
    assert radius[1] == pytest.approx(8e-3, abs=1e-4)
    assert len(wet) + len(outer) == (np.abs(mesh.points[mesh.boundary()]) > 0.0).any(axis=1).all(axis=1).sum()
    wall, _ = thinnest_wall(mesh, wet, outer)
    assert wall == pytest.approx(3e-3, rel=0.05)


EDGE = {"kind": "box", "x_m": [0.0, 0.02], "y_m": [0.0, 0.0]}


def test_the_part_on_its_own_mesh_is_a_thick_tube():
    """A quarter ring under pressure inside, held on both axes: the small strains of Lame's tube."""
    task = bellow(
        cells=[80, 40],
        schedule={"pressure_pa": [1e2, 1e2]},
        goal={
            "output": EDGE,
            "direction": [1.0, 0.0],
            "spring_pa": 0.0,
        },
        inlet={"kind": "disc", "centre_m": [0.0, 0.0], "radius_m": 0.004},
    )
    domain = make_domain(task)
    r = np.hypot(*domain.grid.mesh.points.T)
    cut = snapped(domain.grid, np.minimum(r - 5e-3, 8e-3 - r))
    mesh, air = solid_mesh(domain, cut), flood(domain, cut)
    faces = wet_faces(domain, cut, air, mesh)
    found = reanalyse(domain, FinalPart(cut, mesh, air, *faces, 0.0, np.zeros(2)))
    mu, nu, p, a, b = 72e3, 0.45, 1e2, 5e-3, 8e-3
    # Mean over the edge a < x < b of u = p a^2 / (2 mu (b^2 - a^2)) ((1 - 2 nu) r + b^2 / r).
    mean = (0.5 * (1 - 2 * nu) * (b**2 - a**2) + b**2 * np.log(b / a)) / (b - a)
    exact = p * a**2 / (2 * mu * (b**2 - a**2)) * mean
    assert found.cause == ""
    assert found.motion_m == found.free_m == pytest.approx(exact, rel=0.01)


@pytest.mark.parametrize("axes", [(), ("x",), ("x", "y")])
def test_extruded_parts_are_watertight_and_have_their_volume(axes):
    domain = replace(DOMAIN, output=np.where(np.hypot(X, Y)[:, None] < 8e-3, 1.0, 0.0) * [0.0, 1.0])
    mesh = solid_mesh(domain, dome())
    section = mirrored(mesh, axes)
    assert area(section) == pytest.approx(2.0 ** len(axes) * area(mesh), rel=1e-12)
    points, triangles = extruded(section, 5e-3)
    assert is_closed(triangles)
    assert volume(points, triangles) == pytest.approx(5e-3 * area(section), rel=1e-12)
    assert not is_closed(triangles[1:])


@pytest.mark.parametrize("pieces", [3, 40])
def test_revolved_parts_are_watertight_and_have_their_volume(pieces):
    domain = replace(DOMAIN, output=np.where(np.hypot(X, Y)[:, None] < 8e-3, 1.0, 0.0) * [0.0, 1.0])
    section = mirrored(solid_mesh(domain, dome()), ("y",), "axisymmetric")
    points, triangles = revolved(section, pieces)
    assert is_closed(triangles)
    assert volume(points, triangles) == pytest.approx(4.0 / 3.0 * np.pi * (8e-3**3 - 5e-3**3), rel=0.02)
