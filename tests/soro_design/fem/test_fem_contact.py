"""Contact: a block on a floor carries its load, and folds that close do not cross."""

import sys

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_core.extras import MissingPackageError
from soro_design.fem.contact import Contact, Obstacle, make_barrier
from soro_design.fem.loads import no_loads, spread_spring, traction
from soro_design.fem.meshes.blocks import block, mapped
from soro_design.fem.part import make_part
from soro_design.fem.solve.dynamics import march
from soro_design.fem.solve.mass import mass_entries
from soro_design.fem.solve.newton import solve
from tests.refused import fails
from tests.soro_design.fem.moving_parts import SOFT, folded

NEAR = 0.01
FLOORS = {
    2: Obstacle(np.array([[-5.0, 0.0], [5.0, 0.0]]), np.array([[0, 1]])),
    3: Obstacle(
        np.array([[-5.0, -5.0, 0.0], [5.0, -5.0, 0.0], [5.0, 5.0, 0.0], [-5.0, 5.0, 0.0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    ),
}


@pytest.fixture(autouse=True)
def needs_ipctk(request):
    if "without" not in request.node.name:
        pytest.importorskip("ipctk", reason="contact needs the extra design: pip install 'soro[design]'")


def above(space, kind, gap=0.02):
    """A block of edge 1 above the floor."""
    d = 3 if space == "solid" else 2
    lift = gap * (np.arange(d) == d - 1)
    return mapped(kind, space, (2, 2, 2)[:d], lambda unit: unit + lift)


@pytest.mark.parametrize(
    ("space", "kind", "area"),
    [
        ("plane_strain", "quad4", 1.0),
        ("plane_strain", "quad8", 1.0),
        ("axisymmetric", "quad4", np.pi),
        ("solid", "hex8", 1.0),
        ("solid", "tet10", 1.0),
    ],
)
def test_a_block_pressed_on_a_floor_is_carried_by_it(space, kind, area, figure):
    mesh = above(space, kind)
    d = mesh.points.shape[1]
    up = np.eye(d)[-1]
    top = mesh.faces_at(mesh.points[:, -1] > 1.0)
    loads = no_loads(mesh)
    for k in range(d - 1):
        loads = loads.hold(mesh.points[:, k] == 0.0, k)
    # A weak spring holds the block until it lands.
    loads = loads.pull(traction(mesh, top, -2e3 * up)).spring(spread_spring(mesh, top, up))
    part = make_part(mesh, SOFT, loads, contact=Contact(NEAR, obstacles=(FLOORS[d],)))
    done = solve(part)
    assert done.status == "solved", done.cause
    u = done.last.u
    by_floor = np.zeros_like(u)
    part.contact.add(u, by_floor, False)
    sprung = (loads.springs * u).sum(axis=0)[-1]
    carried = -by_floor.sum(axis=0)[-1]
    assert carried == pytest.approx(2e3 * area - abs(sprung), rel=1e-8)
    assert abs(sprung) < 1e-3 * carried
    distance = (mesh.points + u)[:, -1].min()
    figure(f"{kind} {space} on a floor: {carried:.1f} N at {distance / NEAR:.2f} of the contact distance")
    assert 0.0 < distance < NEAR
    assert part.contact.distance(u) == pytest.approx(distance, rel=1e-9)


@pytest.mark.parametrize(
    ("space", "kind"),
    [("plane_strain", "quad8"), ("axisymmetric", "quad4"), ("solid", "hex8"), ("solid", "tet10")],
)
def test_forces_and_stiffness_of_the_barrier_are_derivatives(space, kind):
    mesh = above(space, kind)
    d = mesh.points.shape[1]
    barrier = make_barrier(mesh, Contact(NEAR, 3e4, (FLOORS[d],)), 1.0)
    rng = np.random.default_rng(5)
    u = 1e-3 * rng.uniform(-1, 1, mesh.points.shape)
    u[:, -1] -= 0.015
    along, step = rng.uniform(-1, 1, u.shape), 1e-7
    force = np.zeros_like(u)
    stiffness = barrier.add(u, force, True)
    slope = (barrier.energy(u + step * along) - barrier.energy(u - step * along)) / (2 * step)
    assert abs(slope) > 1.0
    assert (force * along).sum() == pytest.approx(slope, rel=1e-6)
    forces = []
    for sign in (1, -1):
        forces.append(np.zeros_like(u))
        barrier.add(u + sign * step * along, forces[-1], False)
    change = (stiffness @ along.ravel()).reshape(u.shape)
    assert np.abs(change - (forces[0] - forces[1]) / (2 * step)).max() < 1e-5 * np.abs(change).max()


def test_a_ring_weighs_by_its_length():
    """The same step towards the floor in plane strain and about the axis: forces in the ratio of areas."""
    pushed = {}
    for space in ("plane_strain", "axisymmetric"):
        mesh = above(space, "quad4")
        u = np.zeros(mesh.points.shape) - [0.0, 0.015]
        pushed[space] = np.zeros_like(u)
        make_barrier(mesh, Contact(NEAR, 1e4, (FLOORS[2],)), 1.0).add(u, pushed[space], False)
    assert pushed["axisymmetric"].sum() / pushed["plane_strain"].sum() == pytest.approx(np.pi)


def test_a_fold_that_closes_under_vacuum_does_not_cross_and_gets_stiffer(figure):
    free, _, _ = folded(None)
    done, volume, part = folded(Contact(1e-4))
    # Without contact, its walls would go through each other.
    assert part.contact.is_crossed(free.last.u)
    distances = np.array([part.contact.distance(state.u) for state in done.states])
    assert not any(part.contact.is_crossed(state.u) for state in done.states)
    assert (distances > 0.0).all()
    meets = int(np.argmax(np.isfinite(distances)))
    assert 2 < meets < 8
    # Volume lost by pressure, before and after the walls meet.
    before, after = volume[meets - 2] - volume[meets - 1], volume[-2] - volume[-1]
    figure(
        f"fold under vacuum: walls meet at {80 * (meets + 1)} Pa, {1e6 * distances.min():.0f} um apart;"
        f" then {before / after:.1f} times stiffer"
    )
    assert before > 3.0 * after > 0.0


def test_a_block_thrown_on_a_floor_bounces():
    mesh = above("plane_strain", "quad4")
    part = make_part(mesh, SOFT, no_loads(mesh), contact=Contact(NEAR, obstacles=(FLOORS[2],)))
    v = np.zeros_like(mesh.points) - [0.0, 1.0]
    done = march(part, 2.5e-3, 200, v=v, rho_inf=0.9)
    assert done.status == "solved", done.cause
    height = np.array([(mesh.points + state.u)[:, 1].min() for state in done.states])
    assert 0.0 < height.min() < NEAR
    assert height[-1] > 0.02
    weights = (part.pattern.matrix(mass_entries(part)) @ np.ones(v.size)).reshape(v.shape)[:, 1]
    speed = [(weights * state.v[:, 1]).sum() / weights.sum() for state in (done.states[0], done.states[-1])]
    assert speed[0] == pytest.approx(-1.0)
    # What does not come back rings on in the block.
    assert 0.5 < speed[1] < 1.0


def test_what_is_refused():
    for key, arguments in (("distance_m", (0.0,)), ("stiffness_pa", (1.0, float("nan")))):
        with fails(ModelError, key=key):
            Contact(*arguments)
    mesh = above("plane_strain", "quad4", gap=0.005)
    loads = no_loads(mesh)
    with fails(ModelError, "0.005", key="distance_m"):
        make_part(mesh, SOFT, loads, contact=Contact(NEAR, obstacles=(FLOORS[2],)))
    with fails(ModelError, key="distance_m"):
        across = Obstacle(np.array([[-1.0, 0.4], [2.0, 0.4]]), np.array([[0, 1]]))
        make_part(mesh, SOFT, loads, contact=Contact(NEAR, obstacles=(across,)))
    with fails(ModelError, key="obstacles"):
        make_part(mesh, SOFT, loads, contact=Contact(NEAR, obstacles=(FLOORS[3],)))


def test_contact_without_its_package_is_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "ipctk", None)
    mesh = block("quad4", "plane_strain", (1, 1), (1.0, 1.0))
    with fails(MissingPackageError, "ipctk", "'soro[design]'"):
        make_part(mesh, SOFT, no_loads(mesh), contact=Contact(NEAR))
