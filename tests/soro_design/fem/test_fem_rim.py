"""Pressures on cavities that are open: refused by one line, and why."""

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_design.fem.elements.material import load_material
from soro_design.fem.loads import no_loads
from soro_design.fem.meshes.blocks import block, revolved_tube, tube
from soro_design.fem.part import make_part
from soro_design.fem.rim import rim
from tests.refused import fails

SOFT = load_material("dragonskin_10")
TUBES = {
    "quad4": tube("quad4", (2, 4), (1.0, 2.0)),
    "ring8": revolved_tube("quad8", (1, 2), (1.0, 2.0), 3.0),
    "hex8": tube("hex8", (1, 3, 2), (1.0, 2.0), 3.0),
    "hex20": tube("hex20", (1, 2, 1), (1.0, 2.0), 3.0),
    "tet10": tube("tet10", (1, 2, 1), (1.0, 2.0), 3.0),
}
# Along which directions the ends of the bore lie in planes of symmetry.
ENDS = {"quad4": (0, 1), "ring8": (1,), "hex8": (0, 1, 2), "hex20": (0, 1, 2), "tet10": (0, 1, 2)}


def bore(name):
    """Nodes and faces of the inner wall."""
    mesh = TUBES[name]
    radius = mesh.points[:, 0] if name == "ring8" else np.hypot(*mesh.points.T[:2])
    inside = np.abs(radius - 1.0) < 1e-9
    return mesh, inside, mesh.faces_at(inside)


def held(mesh, directions):
    """Both ends along each direction held in it; the quarter of a bore ends at x = 0 and y = 0."""
    loads = no_loads(mesh)
    for k in directions:
        at = mesh.points[:, k]
        is_end = at < 1e-9 if mesh.space != "axisymmetric" and k < 2 else (at < 1e-9) | (at > 3.0 - 1e-9)
        loads = loads.hold(is_end, k)
    return loads


@pytest.mark.parametrize("name", TUBES)
def test_a_bore_that_ends_at_planes_of_symmetry_is_closed(name):
    mesh, _, faces = bore(name)
    make_part(mesh, SOFT, held(mesh, ENDS[name]).press(faces, 1e3))


@pytest.mark.parametrize(("name", "k"), [(name, k) for name in TUBES for k in ENDS[name]])
def test_a_bore_with_one_end_that_nothing_holds_is_open(name, k):
    mesh, inside, faces = bore(name)
    loads = held(mesh, [one for one in ENDS[name] if one != k])
    with fails(ModelError, "open", "1000 Pa", "is_patch", key="faces") as caught:
        make_part(mesh, SOFT, loads.press(faces, 1e3))
    # The place named is one of the rim.
    place = [float(x) for x in str(caught.value).split("(")[1].split(")")[0].split(",")]
    rims = rim(faces, mesh.points.shape[1])
    ends = mesh.points[rims[:, :2]].mean(axis=1)
    assert np.abs(ends - place).sum(axis=1).min() < 1e-3
    assert inside[rims].all()
    make_part(mesh, SOFT, loads.press(faces, 1e3, is_patch=True))
    make_part(mesh, SOFT, loads.press(faces, 0.0))


@pytest.mark.parametrize("name", TUBES)
def test_the_stiffness_is_symmetric_where_a_cavity_counts_as_closed_and_only_there(name):
    """Between free displacements: what the rule about the rim stands for."""
    mesh, _, faces = bore(name)
    u = 0.05 * np.random.default_rng(7).uniform(-1, 1, mesh.points.shape)
    for directions in (ENDS[name], ENDS[name][:-1]):
        loads = held(mesh, directions)
        part = make_part(mesh, SOFT, loads.press(faces, 1e3, is_patch=True))
        free = ~np.isfinite(loads.held).ravel()
        moves = np.where(np.isfinite(loads.held), 0.0, u)
        K = (part.stiffness(moves, 1.0) - part.stiffness(moves, 0.0)).toarray()[np.ix_(free, free)]
        off = np.abs(K - K.T).max() / np.abs(K).max()
        assert off < 1e-10 if directions == ENDS[name] else off > 1e-2


def test_a_rim_held_along_itself_is_open():
    """A trough along y: supports along y keep no plane, since the rim may move across in it."""
    mesh = block("hex8", "solid", (1, 1, 1), (1.0, 1.0, 1.0))
    top = mesh.faces_at(mesh.points[:, 2] == 1.0)
    ends = no_loads(mesh).hold([0], 1).hold(mesh.points[:, 1] >= 0.0, 1)
    with fails(ModelError, key="faces"):
        make_part(mesh, SOFT, ends.press(top, 1e3))
    make_part(mesh, SOFT, ends.hold(mesh.points[:, 0] >= 0.0, 0).press(top, 1e3))


def test_two_face_sets_at_one_pressure_close_each_other():
    mesh = block("quad4", "plane_strain", (2, 2), (1.0, 1.0))
    faces = mesh.boundary()
    loads = no_loads(mesh)
    make_part(mesh, SOFT, loads.press(faces[:3], 1e3).press(faces[3:], 1e3))
    with fails(ModelError, key="faces"):
        make_part(mesh, SOFT, loads.press(faces[:3], 1e3).press(faces[3:], 2e3))
