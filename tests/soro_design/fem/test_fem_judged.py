"""Newton's method against an independent library: the same solutions, in no more iterations."""

import numpy as np
import pytest

from soro_design.fem.elements.material import material_from_dict
from soro_design.fem.loads import no_loads
from soro_design.fem.meshes.blocks import block
from soro_design.fem.part import make_part
from soro_design.fem.solve import equilibrium as one_load
from soro_design.fem.solve.equations import Equations
from soro_design.fem.solve.newton import solve
from soro_design.fem.solve.states import SolverSettings
from soro_design.fem.solve.steps import LoadSteps
from tests.soro_design.fem.judged_parts import OTHER, PARTS, values
from tests.soro_design.fem.moving_parts import SOFT

pytestmark = pytest.mark.numerics


@pytest.mark.slow
@pytest.mark.parametrize("name", PARTS)
def test_solutions_are_those_of_another_library_in_no_more_iterations(name, figure):
    if name == "ring":
        pytest.importorskip("ipctk", reason="contact needs the extra design: pip install 'soro[design]'")
    part, other = PARTS[name](), OTHER[name]
    done = solve(part)
    assert done.status == "solved", done.cause
    figure(f"{name}: {done.iterations} iterations, another library {other.iterations}")
    np.testing.assert_allclose(values(name, part, done.last), other.values, rtol=1e-8)
    assert done.iterations <= other.iterations


@pytest.mark.parametrize("kind", ["hex8", "hex20"])
def test_the_pressure_before_changes_the_stiffness_and_no_force(kind):
    mesh = block(kind, "solid", (2, 1, 1), (2.0, 1.0, 1.0))
    part = make_part(mesh, SOFT, no_loads(mesh))
    before = 0.02 * np.sin(3.0 * mesh.points)
    # The volume is linear in a stretch along one axis, and not in a turn.
    stretched = before + 0.1 * np.eye(3)[0] * mesh.points
    angle = 0.3
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0, 0, 1.0]])
    turned = (mesh.points + before) @ turn.T - mesh.points
    for u, is_straight in ((stretched, True), (turned, False)):
        exact, straight = part.balance(u, 0.0), part.balance(u, 0.0, before=before)
        np.testing.assert_array_equal(straight.unbalanced, exact.unbalanced)
        assert straight.energy == exact.energy
        off = np.abs(straight.data - exact.data).max() / np.abs(exact.data).max()
        assert off < 1e-12 if is_straight else off > 1e-2


def test_load_steps_grow_unless_they_were_halved():
    steps = LoadSteps(0.2, 0.06)
    loads = [steps.next(0.0, 1.0)]
    steps.has_succeeded(0.2)
    loads.append(steps.next(0.2, 1.0))
    assert not steps.has_failed(0.3)
    loads.append(steps.next(0.2, 1.0))
    steps.has_succeeded(0.15)
    loads.append(steps.next(0.35, 1.0))
    steps.has_succeeded(0.15)
    loads.append(steps.next(0.5, 1.0))
    np.testing.assert_allclose(loads, [0.2, 0.5, 0.35, 0.5, 0.725])
    assert steps.next(0.9, 1.0) == 1.0
    assert steps.has_failed(0.1)


def cube():
    mesh = block("hex8", "solid", (1, 1, 1), (1.0, 1.0, 1.0))
    low, force = mesh.points[:, 2] == 0.0, np.zeros(mesh.points.shape)
    force[~low, 0] = 1e2
    loads = no_loads(mesh).pull(force)
    for k in range(3):
        loads = loads.hold(low, k)
    return make_part(mesh, SOFT, loads)


def test_full_steps_stop_where_the_force_grows_on_and_on(monkeypatch):
    equations, settings = Equations(cube()), SolverSettings()

    def stretch(equations, balance_at, u, *_):
        end = 1.5 * u + [0.0, 0.0, 0.1] * equations.part.mesh.points[:, 2:]
        return end, balance_at(end, u)

    monkeypatch.setattr(one_load, "moved", stretch)
    zero = np.zeros_like(equations.target)
    found = one_load.equilibrium(equations, zero, zero, 1.0, settings, False)
    assert (found.state, found.iterations) == (None, 4)
    assert "grows" in found.cause
    assert one_load.equilibrium(equations, zero, zero, 1.0, settings, True).iterations > 4


def test_a_search_that_lost_is_not_tried_again(monkeypatch):
    import sys

    way, tried = sys.modules["soro_design.fem.solve.newton"], []

    def none(equations, guess, safe, load, settings, is_searching):
        tried.append((load, is_searching))
        return one_load.Attempt(None, "none here", 1)

    monkeypatch.setattr(way, "equilibrium", none)
    assert solve(cube(), settings=SolverSettings(first_step=0.4, least_step=0.1)).status == "stopped"
    assert tried == [(0.4, False), (0.4, True), (0.2, False), (0.1, False)]


def test_a_material_without_a_bulk_modulus_has_no_such_pressure():
    mesh = block("hex8", "solid", (1, 1, 1), (1.0, 1.0, 1.0))
    stiff = material_from_dict(
        {"kind": "st_venant_kirchhoff", "source": "a test", "youngs_modulus_pa": 1e5, "poisson_ratio": 0.3}
    )
    part = make_part(mesh, stiff, no_loads(mesh))
    u = 0.1 * np.sin(2.0 * mesh.points)
    np.testing.assert_array_equal(part.balance(u, 0.0, before=0.0 * u).data, part.balance(u, 0.0).data)
