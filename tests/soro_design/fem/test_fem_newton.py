"""Newton's method: quadratic, patient, and with a cause where it stops."""

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_design.fem.elements.material import load_material, material_from_dict
from soro_design.fem.loads import no_loads, traction
from soro_design.fem.meshes.blocks import block, revolved_tube
from soro_design.fem.part import make_part
from soro_design.fem.solve.newton import solve
from soro_design.fem.solve.states import SolverSettings
from tests.refused import fails

pytestmark = pytest.mark.numerics

SOFT = material_from_dict({"kind": "hyperelastic", "source": "a test", "c1_pa": 1e4, "poisson_ratio": 0.49})


def cube(stretch=0.0, kind="hex8"):
    mesh = block(kind, "solid", (2, 2, 2), (1.0, 1.0, 1.0))
    loads = no_loads(mesh)
    for k in range(3):
        loads = loads.hold(mesh.points[:, k] == 0.0, k)
    return make_part(mesh, SOFT, loads.hold(mesh.points[:, 2] == 1.0, 2, stretch))


def test_a_stretched_cube_has_the_stress_of_its_material():
    """Uniaxial stress at the volume that frees the sides, by a scalar equation."""
    done = solve(cube(1.0))
    assert done.status == "solved"
    top = done.last.reaction[cube().mesh.points[:, 2] == 1.0, 2].sum()
    mu, K = SOFT.shear_modulus_pa, SOFT.bulk_modulus_pa
    across = 1.0 + done.last.u[:, 0].min()
    J = 2.0 * across**2
    common = -mu * J ** (-2 / 3) * (4 + 2 * across**2) / 3 + K * (J - 1) * J
    assert mu * J ** (-2 / 3) * across**2 + common == pytest.approx(0.0, abs=1e-6 * mu)
    assert top == pytest.approx((mu * J ** (-2 / 3) * 4 + common) / 2.0)
    # Every element has that state, and the supports carry no force sideways.
    assert np.abs(done.last.reaction[:, :2]).max() < 1e-6 * top
    # The energy is the work of the support.
    by_load = [solve(cube(1.0), [load]).last for load in (0.999, 0.9995, 1.0)]
    work = (by_load[2].energy - by_load[0].energy) / 1e-3
    middle = by_load[1].reaction[cube().mesh.points[:, 2] == 1.0, 2].sum()
    assert work == pytest.approx(middle, rel=1e-6)


def test_convergence_is_quadratic():
    """Six digits to twelve takes one iteration more."""
    few, many = (
        solve(cube(0.3), settings=SolverSettings(first_step=1.0, tolerance=one)).iterations
        for one in (1e-6, 1e-11)
    )
    assert many - few <= 1


def test_a_long_step_is_cut_and_the_end_is_the_same():
    whole = solve(cube(2.0), settings=SolverSettings(first_step=1.0, iterations=4))
    small = solve(cube(2.0), settings=SolverSettings(first_step=0.05))
    assert whole.status == small.status == "solved"
    assert whole.steps > 1
    np.testing.assert_allclose(whole.last.u, small.last.u, atol=1e-7)


def test_the_last_state_is_kept_where_no_equilibrium_follows():
    """A balloon of Neo-Hooke bears less pressure than this: beyond its limit point there is nothing."""
    mesh = revolved_tube("quad4", (2, 1), (1.0, 1.2), 0.2)
    loads = no_loads(mesh).hold(mesh.points[:, 1] == 0.0, 1).hold(mesh.points[:, 1] == 0.2, 1)
    inside = mesh.faces_at(mesh.points[:, 0] == 1.0)
    seen = []
    part = make_part(mesh, SOFT, loads.press(inside, 2e4))
    done = solve(part, [0.1, 1.0], SolverSettings(least_step=1e-2), progress=seen.append)
    assert done.status == "stopped"
    assert "load factor" in done.cause
    assert "\n" not in done.cause
    assert [state.load for state in done.states] == [0.1]
    assert done.last is seen[-1]
    assert 0.1 < done.last.load < 1.0
    balance = part.balance(done.last.u, done.last.load)
    free = np.where(np.isfinite(part.loads.held), 0.0, balance.unbalanced)
    assert np.linalg.norm(free) < 1e-8 * balance.size


def test_an_element_that_turns_inside_out_is_named():
    mesh = block("quad4", "plane_strain", (1, 1), (1.0, 1.0))
    loads = no_loads(mesh).hold(mesh.points[:, 0] >= 0.0, 0).hold(mesh.points[:, 1] == 0.0, 1)
    done = solve(make_part(mesh, SOFT, loads.hold(mesh.points[:, 1] == 1.0, 1, -1.2)))
    assert done.status == "stopped"
    assert "element 0" in done.cause
    assert 0.83 < done.last.load < 1.0 / 1.2


def test_a_part_that_nothing_holds_is_named():
    mesh = block("quad4", "plane_strain", (2, 2), (1.0, 1.0))
    faces = mesh.faces_at(mesh.points[:, 1] == 1.0)
    loads = no_loads(mesh).press(faces, 1.0, is_patch=True)
    # Held in one direction it still slides in the other.
    for one in (loads, loads.hold(mesh.points[:, 1] == 0.0, 1)):
        done = solve(make_part(mesh, SOFT, one))
        assert (done.status, done.last.load, done.iterations) == ("stopped", 0.0, 0)
        assert "hold" in done.cause


def pulled(stress):
    part = cube()
    mesh = part.mesh
    loads = no_loads(mesh)
    for k in range(3):
        loads = loads.hold(mesh.points[:, k] == 0.0, k)
    return part.under(loads.pull(traction(mesh, mesh.faces_at(mesh.points[:, 2] == 1.0), [0.0, 0.0, stress])))


def test_a_step_that_overshoots_is_searched_along():
    """A pull to nine times the length in one load step, which full Newton steps do not reach."""
    done = solve(pulled(1.5e5), settings=SolverSettings(first_step=1.0, iterations=25))
    assert (done.status, done.steps) == ("solved", 1)
    assert done.last.u[:, 2].max() > 8.0


def test_a_spring_carries_what_it_is_given():
    mesh = block("quad4", "plane_strain", (1, 1), (1.0, 1.0))
    top = mesh.points[:, 1] == 1.0
    loads = no_loads(mesh).hold(mesh.points[:, 0] == 0.0, 0).hold(mesh.points[:, 0] == 1.0, 0)
    springs = np.zeros(mesh.points.shape)
    springs[top, 1] = 5e5
    force = np.zeros(mesh.points.shape)
    force[top, 1] = -1e4
    # Held at the sides alone, so that the spring carries all of the force.
    done = solve(make_part(mesh, SOFT, loads.spring(springs).pull(force)))
    assert done.status == "solved"
    # This is linear: each step takes one iteration.
    assert done.iterations == done.steps > 2
    bottom = mesh.points[:, 1] == 0.0
    np.testing.assert_allclose(done.last.u[top, 1], -0.02, rtol=1e-6)
    np.testing.assert_allclose(done.last.u[bottom, 1], -0.02, rtol=1e-6)


def test_a_part_that_moves_as_a_whole_needs_no_force():
    """All forces are rounding then: of what they are a share says nothing."""
    mesh = block("hex8", "solid", (2, 2, 10), (0.01, 0.01, 0.04))
    end = mesh.points[:, 2] == 0.04
    loads = no_loads(mesh).hold(end, 0).hold(end, 1).hold(end, 2, -2e-3)
    done = solve(make_part(mesh, SOFT, loads))
    assert done.status == "solved", done.cause
    np.testing.assert_allclose(done.last.u, np.tile([0.0, 0.0, -2e-3], (len(end), 1)), atol=1e-12)


def test_a_hanging_part_pulls_with_its_weight():
    mesh = block("hex20", "solid", (1, 1, 2), (0.1, 0.1, 0.2))
    top = mesh.points[:, 2] == 0.2
    loads = no_loads(mesh)
    for k in range(3):
        loads = loads.hold(top, k)
    material = load_material("dragonskin_10")
    part = make_part(mesh, material, loads)
    done = solve(part.under(loads.pull(part.weight([0.0, 0.0, -9.81]))))
    assert done.status == "solved"
    assert done.last.reaction[:, 2].sum() == pytest.approx(9.81 * 1000.0 * 0.002)


@pytest.mark.parametrize("loads", [(0.0, 1.0), (0.5, 0.5), (1.0, 0.5), (float("nan"),)])
def test_loads_must_rise(loads):
    with fails(ModelError, key="loads"):
        solve(cube(), loads)


@pytest.mark.parametrize(
    ("key", "value"),
    [("first_step", 0.0), ("least_step", float("nan")), ("tolerance", 0.0), ("iterations", 0)],
)
def test_settings_that_are_refused(key, value):
    with fails(ModelError, key=key):
        SolverSettings(**{key: value})
