"""Solids extruded and revolved from sections: volume, orientation, forces against those of the section."""

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_design.fem.loads import no_loads
from soro_design.fem.meshes.bellows import bellows_mesh
from soro_design.fem.meshes.blocks import block, revolved_tube, tube
from soro_design.fem.meshes.hexahedra import extruded_mesh, revolved_mesh
from soro_design.fem.meshes.surface import is_closed, solid_surface, volume
from soro_design.fem.part import make_part
from soro_design.fem.solve.newton import solve
from tests.refused import fails
from tests.soro_design.fem.closed_forms import THICK, exact, neo_hooke
from tests.soro_design.fem.moving_parts import SOFT
from tests.soro_design.fem.three_bellow import SHAPE


def solid_volume(mesh):
    """By the points of integration of its elements."""
    return make_part(mesh, SOFT, no_loads(mesh)).volume.sum()


@pytest.mark.parametrize("kind", ["quad4", "quad8"])
def test_an_extruded_section_has_its_area_times_its_height(kind):
    section = tube(kind, (2, 6), (1.0, 2.0))
    mesh = extruded_mesh(section, 3.0, 2)
    assert mesh.kind == {"quad4": "hex8", "quad8": "hex20"}[kind]
    area = make_part(section, SOFT, no_loads(section)).volume.sum()
    assert solid_volume(mesh) == pytest.approx(3.0 * area, rel=1e-12)
    # The solid is one: its outside closes.
    assert is_closed(solid_surface(mesh)[1])


@pytest.mark.parametrize(("kind", "angle"), [("quad4", 1.0), ("quad8", 0.5), ("quad4", 0.25), ("quad8", 1.0)])
@pytest.mark.parametrize("pieces", [3, 7])
def test_a_revolved_section_has_the_volume_of_the_ring(kind, angle, pieces):
    """A part of a turn of a tube of inner radius 1, outer 2 and length 3."""
    mesh = revolved_mesh(revolved_tube(kind, (2, 3), (1.0, 2.0), 3.0), pieces, angle * 2.0 * np.pi)
    assert solid_volume(mesh) == pytest.approx(angle * 9.0 * np.pi, rel=1e-12)
    points, triangles = solid_surface(mesh)
    assert is_closed(triangles)
    if kind == "quad4":
        assert volume(points, triangles) == pytest.approx(angle * 9.0 * np.pi, rel=1e-12)
    if angle == 0.25:
        # Planes of symmetry hold nodes whose place is 0, not nearly 0.
        for direction in (0, 1):
            assert (mesh.points[:, direction] == 0.0).sum() == 3 * 4


def test_a_thick_wall_around_a_quarter_of_a_turn(figure):
    """The inner radius grows 1.5 times at 0.428228 mu."""
    mesh = revolved_mesh(revolved_tube("quad4", (8, 1), (1.0, 2.0), 0.1), 32, 0.5 * np.pi)
    x, y = mesh.points.T[:2]
    r = np.hypot(x, y)
    inside = mesh.faces_at(r < 1.0 + 1e-2)
    loads = no_loads(mesh).hold(y == 0.0, 1).hold(x == 0.0, 0).hold(x > -1.0, 2)
    done = solve(make_part(mesh, neo_hooke(1.0, 1e4), loads.press(inside, THICK["cylinder"][1])))
    assert done.status == "solved"
    now = np.hypot(*(mesh.points + done.last.u)[np.unique(inside), :2].T)
    # The radius of the circle of the same area as the polygon.
    grown = now / r[np.unique(inside)]
    figure(f"revolved thick cylinder: inner radius off by {grown.mean() / exact('cylinder') - 1:+.1e}")
    assert grown.mean() == pytest.approx(exact("cylinder"), rel=3e-4)
    assert np.ptp(grown) < 1e-6


def pulled(mesh, along, extension):
    """Force of half a lobe whose ends keep their planes, by the reaction at its upper end [N]."""
    z = mesh.points[:, along]
    end = z > z.max() - 1e-9
    loads = no_loads(mesh).hold(z < 1e-9, along).hold(end, along, extension)
    if along == 2:
        for direction in (0, 1):
            loads = loads.hold(mesh.points[:, direction] == 0.0, direction)
    done = solve(make_part(mesh, SOFT, loads, is_averaged=False))
    assert done.status == "solved"
    return done.last.reaction[end, along].sum()


def test_bellows_pull_as_hard_in_three_dimensions(figure):
    """A quarter of half a lobe of hex20 against the same section about an axis."""
    section = bellows_mesh("quad8", SHAPE, 1, (2, 2, 2, 1), 0.5)
    expected = pulled(section, 1, 1e-3)
    found = 4.0 * pulled(revolved_mesh(section, 4, 0.5 * np.pi), 2, 1e-3)
    figure(f"bellows of 4 hex20 a quarter: force {found / expected - 1:+.1e} off the section's")
    assert found == pytest.approx(expected, rel=2e-3)


def test_what_is_refused():
    section, ring = (
        block("quad4", "plane_strain", (1, 1), (1.0, 1.0)),
        revolved_tube("quad4", (1, 1), (1.0, 2.0), 1.0),
    )
    disc = block("quad4", "axisymmetric", (1, 1), (1.0, 1.0))
    for call, key in (
        (lambda: extruded_mesh(ring, 1.0, 1), "space"),
        (lambda: extruded_mesh(section, float("nan"), 1), "height_m"),
        (lambda: extruded_mesh(section, 1.0, 0), "layers"),
        (lambda: revolved_mesh(section, 8), "space"),
        (lambda: revolved_mesh(ring, 2), "pieces"),
        (lambda: revolved_mesh(ring, 8, 7.0), "angle_rad"),
        (lambda: revolved_mesh(disc, 8), "points"),
    ):
        with fails(ModelError, key=key):
            call()
