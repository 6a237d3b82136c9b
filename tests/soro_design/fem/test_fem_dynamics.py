"""Motion in time: a pendulum, a bar that rings, a block that flies."""

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_design.fem.loads import no_loads
from soro_design.fem.meshes.blocks import block
from soro_design.fem.part import make_part
from soro_design.fem.solve.dynamics import march
from soro_design.fem.solve.mass import mass_entries, modes
from tests.refused import fails
from tests.soro_design.fem.moving_parts import BEAM, DENSITY, E, pendulum


def test_a_swinging_block_has_the_period_of_a_pendulum_and_keeps_its_energy(figure):
    """The complete elliptic integral of its amplitude, 80 degrees."""
    share, drift = pendulum()
    figure(f"pendulum: period off by {share - 1:+.1e}, energy by {drift:.1e} of the swing")
    assert share == pytest.approx(1.0, abs=1e-3)
    assert drift < 5e-3


def ringing(steps_a_period, rho_inf, periods=1.0):
    """A bar in its first mode along x; displacement of its end over that at the start, and energies."""
    mesh = block("quad8", "plane_strain", (8, 1), (1.0, 0.1))
    x = mesh.points[:, 0]
    loads = no_loads(mesh).hold(x == 0.0, 0).hold(x >= 0.0, 1)
    part = make_part(mesh, BEAM, loads)
    period = 4.0 * np.sqrt(DENSITY / E)
    u = np.zeros_like(mesh.points)
    u[:, 0] = 1e-6 * np.sin(0.5 * np.pi * x)
    done = march(part, period / steps_a_period, round(periods * steps_a_period), u=u, rho_inf=rho_inf)
    assert done.status == "solved", done.cause
    end = np.array([state.u[-1, 0] for state in done.states]) / 1e-6
    return end, np.array([state.strain_energy + state.kinetic_energy for state in done.states])


def test_a_bar_rings_with_its_closed_form_to_second_order(figure):
    errors = []
    for steps in (20, 40, 80):
        end, _ = ringing(steps, 0.8)
        errors.append(np.abs(end - np.cos(2 * np.pi * np.arange(steps + 1) / steps)).max())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    figure(f"bar: off by {errors[-1]:.1e} with 80 steps a period, orders {np.round(orders, 2)}")
    assert errors[-1] < 5e-3
    assert min(orders) > 1.9


def test_rho_inf_of_1_keeps_energy_and_less_takes_it_from_what_is_quick():
    _, energy = ringing(20, 1.0, periods=3)
    assert np.ptp(energy) < 1e-6 * energy[0]
    _, energy = ringing(20, 0.5, periods=3)
    assert energy[-1] < 0.999 * energy[0]
    # Steps of 100 periods take about half of it each.
    end, _ = ringing(0.01, 0.5, periods=1600)
    assert abs(end[-1]) < 1e-2


def test_a_block_that_flies_keeps_its_momentum(figure):
    mesh = block("quad4", "plane_strain", (2, 3), (0.2, 0.3))
    part = make_part(mesh, BEAM, no_loads(mesh))
    middle = np.array([0.1, 0.15])
    arm = mesh.points - middle
    v = 5.0 * np.stack([-arm[:, 1], arm[:, 0]], axis=1) + [0.3, -0.2]
    done = march(part, 5e-3, 120, v=v, rho_inf=1.0)
    assert done.status == "solved", done.cause
    M = part.pattern.matrix(mass_entries(part))
    momentum = np.array([(M @ state.v.ravel()).reshape(v.shape).sum(axis=0) for state in done.states])
    np.testing.assert_allclose(momentum, np.tile(momentum[0], (121, 1)), rtol=1e-7)
    turning = []
    for state in done.states:
        p, x = (M @ state.v.ravel()).reshape(v.shape), mesh.points + state.u
        turning.append((x[:, 0] * p[:, 1] - x[:, 1] * p[:, 0]).sum())
    drift = np.ptp(turning) / np.abs(turning[0])
    figure(f"flying block: angular momentum off by {drift:.1e} over {5.0 * 0.6 / 2 / np.pi:.2f} turns")
    assert drift < 1e-2
    # It has turned by its angular velocity times the time.
    assert np.abs(done.states[-1].u).max() > 0.1


def test_held_nodes_move_as_prescribed():
    """A bar whose foot is shaken slowly follows it."""
    mesh = block("quad8", "plane_strain", (2, 1), (1.0, 0.1))
    x = mesh.points[:, 0]
    loads = no_loads(mesh).hold(x == 0.0, 0, 0.05).hold(x >= 0.0, 1)
    part = make_part(mesh, BEAM, loads)
    period = 2 * np.pi / np.sqrt(modes(part, count=1).squared[0])
    slow = 50.0 * period

    def load(t):
        return np.sin(2 * np.pi * t / slow) ** 2

    done = march(part, slow / 100, 50, load=load)
    assert done.status == "solved", done.cause
    for state in done.states:
        np.testing.assert_allclose(state.u[x == 0.0, 0], 0.05 * load(state.time_s), atol=1e-15)
        assert np.abs(state.u[:, 0] - 0.05 * load(state.time_s)).max() < 1e-3


def test_a_motion_that_cannot_go_on_stops_with_a_cause():
    mesh = block("quad4", "plane_strain", (1, 1), (1.0, 1.0))
    part = make_part(mesh, BEAM, no_loads(mesh).hold(mesh.points[:, 1] == 0.0, 1).hold([0], 0))
    v = np.zeros((4, 2))
    v[mesh.points[:, 1] == 1.0, 1] = -1e4
    done = march(part, 1e-3, 5, v=v)
    assert (done.status, len(done.states)) == ("stopped", 1)
    assert "time 0 s" in done.cause


def test_what_is_refused():
    mesh = block("quad4", "plane_strain", (1, 1), (1.0, 1.0))
    part = make_part(mesh, BEAM, no_loads(mesh))
    for key, arguments in {
        "step_s": {"step_s": 0.0},
        "u": {"u": np.zeros((3, 2))},
        "v": {"v": np.full((4, 2), np.nan)},
        "rho_inf": {"rho_inf": 1.1},
    }.items():
        with fails(ModelError, key=key):
            march(part, **{"step_s": 1.0, "steps": 1, **arguments})
