"""Stress and stretch of elements: a bar, a rotation, and the balance with the forces of the nodes."""

import numpy as np
import pytest

from soro_design.fem.elements.material import load_material, material_from_dict, nominal_stress
from soro_design.fem.loads import no_loads
from soro_design.fem.meshes.blocks import block
from soro_design.fem.part import make_part
from soro_design.fem.stress import strained

SOFT = load_material("dragonskin_10")
STIFF = material_from_dict(
    {"kind": "st_venant_kirchhoff", "source": "a test", "youngs_modulus_pa": 1e6, "poisson_ratio": 0.3}
)
KINDS = (
    ("hex8", "solid", SOFT),
    ("hex20", "solid", STIFF),
    ("tet10", "solid", SOFT),
    ("quad4", "axisymmetric", SOFT),
    ("quad8", "axisymmetric", STIFF),
    ("quad4", "plane_strain", SOFT),
)


def made(kind, space, material):
    d = 3 if space == "solid" else 2
    mesh = block(kind, space, (2, 3, 2)[:d], (2.0, 3.0, 1.0)[:d])
    return make_part(mesh, material, no_loads(mesh))


@pytest.mark.parametrize(("kind", "space"), [("hex8", "solid"), ("axi", "axisymmetric")])
def test_a_bar_has_the_stress_of_its_law(kind, space):
    part = made("quad4" if kind == "axi" else kind, space, SOFT)
    along, across = 1.7, 1.7**-0.5
    # About an axis the bar stands upright, its radius and its rings shrink alike.
    scale = [across, along, across][: part.mesh.points.shape[1]]
    found = strained(part, part.mesh.points * (np.array(scale) - 1.0))
    assert found.von_mises_pa == pytest.approx(along * nominal_stress(SOFT, along), rel=1e-9)
    assert found.stretch == pytest.approx(along, rel=1e-12)
    assert found.volume.sum() == pytest.approx(part.volume.sum(), rel=1e-12)


def test_a_rotation_turns_the_stress_and_changes_neither_its_size_nor_the_stretch():
    part = made("hex8", "solid", SOFT)
    rng = np.random.default_rng(1)
    u = 0.05 * rng.standard_normal(part.mesh.points.shape)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    turn *= np.linalg.det(turn)
    before = strained(part, u)
    after = strained(part, (part.mesh.points + u) @ turn.T - part.mesh.points)
    assert np.ptp(before.von_mises_pa) > 0.1 * before.von_mises_pa.max()
    assert after.von_mises_pa == pytest.approx(before.von_mises_pa, rel=1e-9)
    assert after.stretch == pytest.approx(before.stretch, rel=1e-12)
    assert after.stress == pytest.approx(turn @ before.stress @ turn.T, rel=1e-7, abs=1e-3)


@pytest.mark.parametrize(("kind", "space", "material"), KINDS)
def test_stresses_have_the_virial_of_the_forces_of_the_nodes(kind, space, material):
    """int sigma dv = sum of f x^T, whatever the displacements; about an axis of its trace alone."""
    part = made(kind, space, material)
    size = 0.01 if kind == "tet10" else 0.05  # by which no element is turned inside out
    u = size * np.random.default_rng(2).standard_normal(part.mesh.points.shape)
    if space == "axisymmetric":
        u[part.mesh.points[:, 0] == 0.0, 0] = 0.0
    found, forces = strained(part, u), part.balance(u, 0.0, with_stiffness=False).unbalanced
    virial = forces.T @ (part.mesh.points + u)
    whole = np.einsum("eij,e->ij", found.stress, found.volume)
    d = len(virial)
    if space == "axisymmetric":
        assert np.trace(whole) == pytest.approx(np.trace(virial), rel=1e-9)
    else:
        assert whole[:d, :d] == pytest.approx(virial, rel=1e-9, abs=1e-9 * np.abs(virial).max())


@pytest.mark.parametrize("material", [SOFT, STIFF], ids=["soft", "stiff"])
def test_an_element_that_is_turned_inside_out_has_no_stress(material):
    part = made("hex8", "solid", material)
    u = np.zeros_like(part.mesh.points)
    u[part.mesh.cells[0, 6]] = -5.0
    found = strained(part, u)
    assert np.isnan(found.von_mises_pa[0])
