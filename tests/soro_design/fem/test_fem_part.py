"""Forces and stiffness of parts against differences of energy and of forces."""

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_design.fem.elements.material import load_material, material_from_dict
from soro_design.fem.elements.mesh import make_mesh
from soro_design.fem.loads import no_loads, spread_spring, traction
from soro_design.fem.meshes.blocks import block, grid, mapped, revolved_tube, tube
from soro_design.fem.part import make_part
from tests.refused import fails

YEOH = {"kind": "hyperelastic", "source": "a test", "c1_pa": 3.0, "c2_pa": 0.4, "c01_pa": 0.7}
MATERIALS = {
    "hyperelastic": material_from_dict({**YEOH, "poisson_ratio": 0.45}),
    "svk": material_from_dict(
        {"kind": "st_venant_kirchhoff", "source": "a test", "youngs_modulus_pa": 9.0, "poisson_ratio": 0.3}
    ),
}
MESHES = {
    "quad4": block("quad4", "plane_strain", (2, 2), (1.0, 1.5)),
    "quad8": block("quad8", "plane_strain", (2, 1), (1.0, 1.5)),
    "ring4": revolved_tube("quad4", (2, 2), (0.5, 1.5), 1.0),
    "disc8": block("quad8", "axisymmetric", (2, 1), (1.0, 1.0)),
    "hex8": block("hex8", "solid", (2, 1, 1), (1.0, 1.0, 1.2)),
    "hex20": block("hex20", "solid", (1, 1, 1), (1.0, 1.0, 1.2)),
    "tet10": block("tet10", "solid", (1, 1, 1), (1.0, 1.0, 1.2)),
}


def moved(mesh, size=0.04):
    u = size * np.random.default_rng(4).uniform(-1, 1, mesh.points.shape)
    if mesh.space == "axisymmetric":
        u[mesh.points[:, 0] == 0.0, 0] = 0.0
    return u


def loaded(mesh):
    """Every kind of load at once."""
    faces = mesh.boundary()
    along = np.arange(1.0, mesh.points.shape[1] + 1)
    return (
        no_loads(mesh)
        .press(faces, 0.8)
        .pull(traction(mesh, faces[:1], along))
        .spring(spread_spring(mesh, faces[1:2], along))
    )


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("name", MESHES)
def test_forces_and_stiffness_are_derivatives(name, material):
    mesh = MESHES[name]
    part = make_part(mesh, MATERIALS[material], no_loads(mesh))
    full = part.under(loaded(mesh))
    u, step = moved(mesh), 1e-6
    along = np.random.default_rng(6).uniform(-1, 1, u.shape)
    if mesh.space == "axisymmetric":
        along[mesh.points[:, 0] == 0.0, 0] = 0.0
    more, less = (part.balance(u + sign * step * along, 0.0, False) for sign in (1, -1))
    slope = (more.energy - less.energy) / (2 * step)
    assert (part.balance(u, 0.0).unbalanced * along).sum() == pytest.approx(slope, rel=1e-6)
    more, less = (full.balance(u + sign * step * along, 0.7, False).unbalanced for sign in (1, -1))
    change = (full.stiffness(u, 0.7) @ along.ravel()).reshape(u.shape)
    assert np.abs(change - (more - less) / (2 * step)).max() < 1e-6 * np.abs(change).max()


@pytest.mark.parametrize("name", MESHES)
def test_a_pressure_on_a_closed_surface_has_a_symmetric_stiffness(name):
    mesh = MESHES[name]
    part = make_part(mesh, MATERIALS["svk"], no_loads(mesh))
    u = moved(mesh)
    outer = part.under(no_loads(mesh).press(mesh.boundary(), 1.0))
    by_pressure = (outer.stiffness(u, 1.0) - part.stiffness(u, 1.0)).toarray()
    size = np.abs(by_pressure).max()
    if mesh.space == "axisymmetric":
        # Nodes on the axis do not leave it.
        free = np.ones_like(u, dtype=bool)
        free[mesh.points[:, 0] == 0.0, 0] = False
        by_pressure = by_pressure[np.ix_(free.ravel(), free.ravel())]
    assert size > 0.1
    assert np.abs(by_pressure - by_pressure.T).max() < 1e-12 * size
    # On a part of the surface it is not: the work depends on the way.
    some = part.under(no_loads(mesh).press(mesh.boundary()[-1:], 1.0, is_patch=True))
    open_ = (some.stiffness(u, 1.0) - part.stiffness(u, 1.0)).toarray()
    assert np.abs(open_ - open_.T).max() > 1e-3 * size


@pytest.mark.parametrize("name", MESHES)
def test_a_pressure_all_around_pushes_inwards_and_is_balanced(name):
    mesh = MESHES[name]
    part = make_part(mesh, MATERIALS["svk"], no_loads(mesh).press(mesh.boundary(), 2.0))
    zero = np.zeros_like(mesh.points)
    pushed = -part.balance(zero, 1.0).unbalanced
    # Work of a uniform growth: -p times the growth of the volume.
    dimension = 3 if mesh.space != "plane_strain" else 2
    assert (pushed * mesh.points).sum() == pytest.approx(-2.0 * dimension * part.volume.sum())
    along = slice(1, None) if mesh.space == "axisymmetric" else slice(None)
    assert np.abs(pushed.sum(axis=0)[along]).max() < 1e-13


@pytest.mark.parametrize("kind", ["quad4", "hex20"])
def test_a_pressure_acts_the_same_on_a_mesh_numbered_the_other_way(kind):
    d = 2 if kind == "quad4" else 3
    points, cells = grid(kind, (2, 1, 1)[:d])
    space = "plane_strain" if d == 2 else "solid"
    mirror = np.array([-1.0, 1.0, 1.0][:d])
    pushed = []
    for sign in (np.ones(d), mirror):
        mesh = make_mesh(kind, space, points * sign, cells)
        faces = mesh.faces_at(mesh.points[:, 1] == 1.0)
        part = make_part(mesh, MATERIALS["svk"], no_loads(mesh).press(faces, 3.0, is_patch=True))
        pushed.append(-part.balance(np.zeros_like(points), 1.0).unbalanced)
    assert pushed[0][:, 1].sum() == pytest.approx(-3.0)
    np.testing.assert_allclose(pushed[1], pushed[0] * mirror, atol=1e-15)


def test_weight_traction_and_springs_have_their_sums():
    mesh = tube("hex20", (1, 4, 1), (1.0, 2.0), 4.0)
    part = make_part(mesh, load_material("dragonskin_10"), no_loads(mesh))
    weight = 1000.0 * part.volume.sum()
    np.testing.assert_allclose(part.weight([0.0, 0.0, -9.81]).sum(axis=0), [0, 0, -9.81 * weight], atol=1e-9)
    ring = revolved_tube("quad8", (2, 2), (1.0, 2.0), 1.0)
    top = ring.faces_at(ring.points[:, 1] == 1.0)
    assert traction(ring, top, [0.0, 5.0])[:, 1].sum() == pytest.approx(5.0 * np.pi * 3.0)
    springs = spread_spring(ring, top, [0.0, 5.0])
    assert springs[:, 1].sum() == pytest.approx(5.0 * np.pi * 3.0)
    assert (springs >= 0).all()


def test_an_inverted_element_is_a_value():
    mesh = MESHES["quad4"]
    u = np.zeros_like(mesh.points)
    u[0] = [2.0, 2.0]
    assert make_part(mesh, MATERIALS["svk"], no_loads(mesh)).balance(u, 1.0).inverted == 0
    assert make_part(mesh, MATERIALS["svk"], no_loads(mesh)).balance(0 * u, 1.0).inverted == -1


def test_what_is_refused():
    mesh = MESHES["quad4"]
    with fails(ModelError, key="is_averaged"):
        make_part(mesh, MATERIALS["svk"], no_loads(mesh), is_averaged=True)
    free, like = no_loads(mesh), np.ones(mesh.points.shape)
    with fails(ModelError, key="pressure_pa"):
        free.press(mesh.boundary(), float("nan"))
    with fails(ModelError, key="faces"):
        make_part(mesh, MATERIALS["svk"], free.press(np.array([[0, 8]]), 1.0))
    with fails(ModelError, key="displacement_m"):
        free.hold([0], 1, float("nan"))
    with fails(ModelError, key="direction"):
        free.hold([0], 2)
    for wrong in (np.nan * like, like[1:]):
        with fails(ModelError, key="force"):
            free.pull(wrong)
    for wrong in (-like, np.inf * like, like[1:]):
        with fails(ModelError, key="stiffness"):
            free.spring(wrong)


def test_a_sheared_mesh_keeps_a_uniform_strain():
    """Forces of a uniform stress cancel at inner nodes, whatever the shape of the elements."""
    bent = mapped("quad8", "plane_strain", (3, 3), lambda p: p + 0.05 * np.sin(3 * p[:, ::-1]) * p * (1 - p))
    part = make_part(bent, MATERIALS["hyperelastic"], no_loads(bent))
    inner = part.balance(bent.points @ np.array([[0.1, 0.2], [-0.05, 0.3]]), 0.0).unbalanced
    is_inside = np.isin(np.arange(len(inner)), bent.boundary(), invert=True)
    assert np.abs(inner[is_inside]).max() < 1e-13 * np.abs(inner).max()
