"""Fibres of tension alone, and tendons: derivatives, closed forms, refusals."""

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_design.fem import solve
from soro_design.fem.elements.fibres import fibres, pieces_of
from soro_design.fem.elements.material import material_from_dict
from soro_design.fem.loads import no_loads
from soro_design.fem.meshes.blocks import block
from soro_design.fem.part import make_part
from tests.refused import fails

# Without a Poisson effect a bar of St. Venant-Kirchhoff has the nominal stress E/2 (stretch^3 - stretch).
E, EA = 9.0, 2.0
VENANT = material_from_dict(
    {"kind": "st_venant_kirchhoff", "source": "a test", "youngs_modulus_pa": E, "poisson_ratio": 0.0}
)
CUBE = block("hex8", "solid", (1, 1, 1), (1.0, 1.0, 1.0))
Z = CUBE.points[:, 2]


def along_edges(mesh):
    """Pieces of the four upright edges."""
    return pieces_of([mesh.cells[0][[k, k + 4]] for k in range(4)])


def standing(load):
    """A cube on a plane, free to move sideways but for the rest of a rigid motion."""
    corner = (CUBE.points == 0.0).all(axis=1)
    edge = (Z == 0.0) & (CUBE.points[:, 1] == 0.0)
    return load.hold(Z == 0.0, 2).hold(corner, 0).hold(edge, 1)


@pytest.mark.parametrize("data", ["stiff", "slack", "tendon"])
def test_forces_and_stiffness_are_derivatives(data):
    mesh = block("hex8", "solid", (2, 1, 1), (1.0, 1.0, 1.2))
    pieces = np.concatenate([mesh.cells[:, [0, 6]], mesh.cells[:, [1, 3]]])
    size = {"stiff": (3.0, 0.0), "slack": (3.0, 0.0), "tendon": (0.0, 1.5)}[data]
    part = make_part(mesh, VENANT, no_loads(mesh).reinforce(fibres(pieces, *size)))
    bare = part.under(no_loads(mesh))
    rng = np.random.default_rng(3)
    u = 0.03 * rng.uniform(-1, 1, mesh.points.shape) + (0.1 if data != "slack" else -0.1) * mesh.points
    along, step = rng.uniform(-1, 1, u.shape), 1e-6

    def added(u, load=0.7):
        return part.balance(u, load, False).unbalanced - bare.balance(u, load, False).unbalanced

    change = (added(u + step * along) - added(u - step * along)) / (2 * step)
    stiffness = part.stiffness(u, 0.7) - bare.stiffness(u, 0.7)
    assert np.abs(stiffness @ along.ravel() - change.ravel()).max() < 1e-8
    assert np.abs(stiffness - stiffness.T).max() < 1e-12
    energy = [part.balance(u + sign * step * along, 0.0, False).energy for sign in (1, -1)]
    work = (part.balance(u, 0.0, False).unbalanced * along).sum()
    assert (energy[0] - energy[1]) / (2 * step) == pytest.approx(work, rel=1e-7)
    assert (np.abs(added(u)).max() == 0.0) == (data == "slack")


@pytest.mark.parametrize("stretch", [1.3, 0.8])
def test_fibres_add_to_the_force_of_a_bar_in_tension_alone(stretch):
    loads = standing(no_loads(CUBE)).hold(Z == 1.0, 2, stretch - 1.0)
    done = solve(make_part(CUBE, VENANT, loads.reinforce(fibres(along_edges(CUBE), EA))))
    force = done.last.reaction[Z == 1.0, 2].sum()
    expected = 0.5 * E * (stretch**3 - stretch) + 4.0 * EA * max(stretch - 1.0, 0.0)
    assert force == pytest.approx(expected, rel=1e-9)


def test_tendons_press_a_bar_together_by_their_tension():
    loads = standing(no_loads(CUBE)).reinforce(fibres(along_edges(CUBE), tension_n=0.2))
    done = solve(make_part(CUBE, VENANT, loads), (0.5, 1.0))
    for state in done.states:
        stretch = 1.0 + state.u[Z == 1.0, 2].mean()
        assert 0.5 * E * (stretch**3 - stretch) == pytest.approx(-4.0 * 0.2 * state.load, rel=1e-8)


def test_what_is_refused():
    for name, values in (("stiffness_n", -1.0), ("tension_n", np.nan)):
        with fails(ModelError, name):
            fibres(along_edges(CUBE), **{name: values})
    with fails(ModelError, "pieces"):
        fibres(np.array([[1, 1]]))
    far = block("hex8", "solid", (2, 1, 1), (1.0, 1.0, 1.0))
    ends = [int(np.argmin(far.points.sum(axis=1))), int(np.argmax(far.points.sum(axis=1)))]
    with fails(ModelError, "fibres"):
        make_part(far, VENANT, no_loads(far).reinforce(fibres(pieces_of([ends]), 1.0)))
