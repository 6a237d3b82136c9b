"""Rods with chambers: volumes of the mesh, faces of chambers, poses of sections and strains between them."""

import numpy as np
import pytest
from scipy.linalg import expm

from soro_core.errors import ModelError
from soro_core.rotation import rotation_exp, skew
from soro_design.fem import SolverSettings, solve
from soro_design.fem.backbone import section_poses, section_strains
from soro_design.fem.elements.fibres import fibres
from soro_design.fem.elements.material import material_from_dict
from soro_design.fem.loads import no_loads
from soro_design.fem.meshes.rod import RodCounts, RodShape, rod_mesh
from soro_design.fem.part import make_part
from tests.refused import fails

SHAPE = RodShape(0.06, 0.012, 3, 0.004, 0.007, 0.003)
COARSE = RodCounts(around=2, across=1, along=9)
SOFT = material_from_dict({"kind": "hyperelastic", "source": "a test", "c1_pa": 36e3, "poisson_ratio": 0.45})
ROD = rod_mesh(SHAPE, COARSE)


def enclosed(points, faces):
    """Volume inside faces that are turned inwards, by the divergence theorem."""
    corners = points[faces]
    split = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    return -np.linalg.det(split).sum() / 6.0


def scaled_length(low, high, taper):
    """Integral of the square of the size of the section along the rod."""
    rise = (taper - 1.0) / SHAPE.length_m
    return np.diff(np.polyval(np.polyint([rise**2, 2.0 * rise, 1.0]), [low, high]))[0]


@pytest.mark.parametrize(("chambers", "taper"), [(3, 1.0), (4, 0.6), (2, 1.0)])
def test_volumes_are_those_of_round_chambers(chambers, taper):
    shape = RodShape(0.06, 0.012, chambers, 0.003, 0.007, 0.003, taper)
    rod = rod_mesh(shape, COARSE)
    hole = np.pi * 0.003**2 * scaled_length(0.003, 0.057, taper)
    solid = np.pi * 0.012**2 * scaled_length(0.0, 0.06, taper) - chambers * hole
    assert make_part(rod.mesh, SOFT, no_loads(rod.mesh)).volume.sum() == pytest.approx(solid, rel=1e-9)
    for faces in rod.chambers:
        assert enclosed(rod.mesh.points, faces) == pytest.approx(hole, rel=1e-9)
    assert rod.share.sum() == pytest.approx(np.pi * (0.012**2 - chambers * 0.003**2), rel=1e-12)


def test_hoops_are_closed_rings_around_chambers():
    lengths = np.linalg.norm(np.diff(ROD.mesh.points[ROD.hoops], axis=1)[:, 0], axis=1)
    assert len(lengths) == 3 * (COARSE.along + 1) * 4 * COARSE.around
    assert np.ptp(lengths) < 1e-12
    assert (np.bincount(ROD.hoops.ravel())[np.unique(ROD.hoops)] == 2).all()
    assert ROD.hoop_spacing_m[:: 4 * COARSE.around].sum() == pytest.approx(3 * 0.054)


def bent(points, strain):
    """Places of a rod of constant strain (6,): sections moved by the exponential of its twist."""
    hat = np.zeros((4, 4))
    hat[:3, :3], hat[:3, 3] = skew(strain[:3]), strain[3:]
    poses = {s: expm(s * hat) for s in np.unique(points[:, 2])}
    return np.array([(poses[s] @ [X, Y, 0.0, 1.0])[:3] for X, Y, s in points])


def test_poses_and_strains_of_a_known_field():
    nodes = ROD.sections
    points = ROD.mesh.points
    # 60 degrees of bending, 8 % longer, a little torsion.
    expected = np.array([0.0, 17.0, 2.0, 0.0, 0.0, 1.08])
    x = bent(points, expected)
    poses = section_poses(points, x - points, nodes, ROD.share)
    z = points[nodes[:, 0], 2]
    strains = section_strains(poses, z)
    np.testing.assert_allclose(strains, np.broadcast_to(expected, strains.shape), atol=1e-10)


# Beyond a right angle the decomposition alone gives mirrors.
@pytest.mark.parametrize("turn", [(0.1, -0.4, 0.2), (0.0, 2.0, 0.0), (1.0, 2.0, 0.5)])
def test_poses_of_a_rigid_motion(turn):
    points, R = ROD.mesh.points, rotation_exp(np.array(turn))
    z = points[ROD.sections[:, 0], 2]
    moved = points @ R.T + [0.01, 0.02, 0.03]
    exact = np.tile(np.eye(4), (len(z), 1, 1))
    exact[:, :3, :3] = R
    exact[:, :3, 3] = np.array([0.01, 0.02, 0.03]) + z[:, None] * R[:, 2]
    found = section_poses(points, moved - points, ROD.sections, ROD.share)
    np.testing.assert_allclose(found, exact, atol=1e-14)


def test_a_chamber_bends_the_rod_away_from_it():
    """Chamber 0 lies towards x: under pressure the tip goes to -x; hoops keep the area of the chamber."""
    held = no_loads(ROD.mesh)
    for k in range(3):
        held = held.hold(ROD.base, k)
    growth = []
    for stiffness in (0.0, 20.0):
        hoops = fibres(ROD.hoops, stiffness * ROD.hoop_spacing_m / 3e-3)
        loads = held.reinforce(hoops).press(ROD.chambers[0], 15e3)
        done = solve(make_part(ROD.mesh, SOFT, loads), (0.5, 1.0), SolverSettings(first_step=0.5))
        assert done.status == "solved"
        pose = section_poses(ROD.mesh.points, done.last.u, ROD.sections, ROD.share)[-1]
        assert pose[0, 3] < -1e-3
        assert abs(pose[1, 3]) < 1e-9
        assert pose[2, 3] > 0.06
        before, after = (
            enclosed(ROD.mesh.points + u, ROD.chambers[0]) for u in (0.0 * done.last.u, done.last.u)
        )
        growth.append(after / before)
    assert growth[1] - 1.0 < 0.7 * (growth[0] - 1.0)


@pytest.mark.parametrize(
    ("key", "value"),
    [("chamber_radius_m", 0.0055), ("plug_m", 0.04), ("taper", 0.0), ("length_m", np.nan), ("chambers", 1)],
)
def test_impossible_rods_are_refused(key, value):
    with fails(ModelError, key):
        RodShape(**{**vars(SHAPE), key: value})


def test_counts_are_checked():
    with fails(ModelError, "around"):
        RodCounts(around=1)
