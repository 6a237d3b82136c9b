"""Energy of an arm without damping and input: kept by the midpoint rule, never gained by the dissipative."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rods import IMPLICIT, LENGTH, bellows, bent, energies, growth, helix, rod, scale, stored

from soro_core import SoftArm, simulate
from soro_core.integrate import stepper
from soro_core.integrate.stepper import DISSIPATIVE, run_of
from soro_core.integrate.steppers.scheme import Dissipative, Scheme
from soro_core.pneumatics.chamber import ValveModel, make_gas

# Of the energy that a run is about, from any row to any later one.
ROUND_OFF = 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("dt", [2e-3, 5e-3])
def test_midpoint_keeps_energy_for_a_minute(dt, figure):
    """Bounded, and no trend: a straight line fitted to the energy explains nothing of it."""
    arm = rod(2, youngs_modulus=1e5, viscosity=0.0)
    result = simulate(arm, bent(arm), t_end=60.0, dt=dt, integrator="midpoint")
    assert result.status.ok
    y = (energies(arm, result, 3000) - sum(arm.energy(result.q[0], result.qd[0]))) / scale(arm, result)
    t = np.linspace(0.0, 60.0, len(y))
    slope = np.polyfit(t, y, 1)[0]
    figure(
        f"midpoint, 60 s, dt {dt:g} s: energy within {np.ptp(y):.1e} of the start's, "
        f"trend {slope * 60:+.1e}, scatter {y.std():.1e}"
    )
    assert np.ptp(y) < 60.0 * dt**2
    assert abs(slope) * 60.0 < 0.1 * y.std()


@pytest.mark.parametrize("name", DISSIPATIVE)
@pytest.mark.parametrize("dt", [1e-3, 5e-3, 2e-2])
@pytest.mark.parametrize("youngs_modulus", [1e4, 1e6, 1e8])
def test_dissipative_steppers_never_gain(name, youngs_modulus, dt):
    arm = rod(4, youngs_modulus, viscosity=0.0)
    result = simulate(arm, bent(arm), t_end=200 * dt, dt=dt, integrator=name)
    assert result.status.ok
    assert growth(energies(arm, result)) <= ROUND_OFF * scale(arm, result)


@pytest.mark.parametrize("name", DISSIPATIVE)
@pytest.mark.parametrize("dt", [1e-3, 5e-3, 2e-2])
@pytest.mark.parametrize(("n_links", "youngs_modulus"), [(1, 1e8), (4, 1e4), (4, 1e6), (4, 1e8)])
def test_loops_let_go_gain_no_energy(name, n_links, youngs_modulus, dt):
    """A full turn in each link: far from small motion, which is all that linear damping knows of."""
    arm = rod(n_links, youngs_modulus, viscosity=0.0, radius=0.01 / n_links)
    q0 = np.tile([0.0, 1.0, 0.2], n_links) * 2.0 * np.pi * n_links / LENGTH
    result = simulate(arm, q0, t_end=20 * dt, dt=dt, integrator=name)
    assert result.status == "ok"
    assert growth(energies(arm, result)) <= ROUND_OFF * scale(arm, result)


@pytest.mark.parametrize("name", DISSIPATIVE)
@pytest.mark.parametrize("dt", [1e-3, 5e-3, 2e-2])
@pytest.mark.parametrize(
    ("n_links", "youngs_modulus"), [(1, 1e4), (1, 1e6), (1, 1e8), (2, 1e4), (2, 1e6), (2, 1e8), (4, 1e8)]
)
def test_links_let_go_nearly_crushed_gain_no_energy(name, n_links, youngs_modulus, dt):
    """Elongation -0.9. One of several links can take energy enough from the others to crush itself."""
    arm = rod(n_links, youngs_modulus, viscosity=0.0)
    result = simulate(arm, bent(arm, -0.9), t_end=20 * dt, dt=dt, integrator=name)
    assert result.status.ok or (n_links > 1 and "compressed to nothing" in result.status)
    assert growth(energies(arm, result)) <= ROUND_OFF * scale(arm, result)


@pytest.mark.parametrize("name", DISSIPATIVE)
@given(
    log_modulus=st.floats(4.0, 8.0),
    log_step=st.floats(-3.0, np.log10(2e-2)),
    elongation=st.floats(-0.8, 0.8),
    turns=st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4),
    rate=st.floats(-1.0, 1.0),
)
@settings(max_examples=25)
def test_no_release_gains_energy(name, log_modulus, log_step, elongation, turns, rate):
    """From any shape and motion, of two links."""
    arm = rod(2, 10.0**log_modulus, viscosity=0.0)
    q0 = np.array([elongation, *turns[:2], elongation, *turns[2:]])
    q0[[1, 2, 4, 5]] *= 2.0 * np.pi / arm.length
    dt = 10.0**log_step
    result = simulate(arm, q0, rate * q0[::-1], t_end=10 * dt, dt=dt, integrator=name)
    y = energies(arm, result)
    assert growth(y) <= ROUND_OFF * (scale(arm, result) + np.abs(y).max())


@pytest.mark.parametrize("name", DISSIPATIVE)
def test_round_off_does_not_add_up_to_a_gain(name):
    """Swinging gently for 20,000 steps."""
    arm = rod(1, 1e5, viscosity=0.0)
    result = simulate(arm, [0.0, 0.4, 0.1], t_end=20.0, dt=1e-3, integrator=name)
    assert result.status.ok
    assert growth(energies(arm, result, 20_000)) <= ROUND_OFF * scale(arm, result)


@pytest.mark.slow
@pytest.mark.parametrize("name", DISSIPATIVE)
@pytest.mark.parametrize("dt", [1e-3, 5e-3])
@pytest.mark.parametrize("method", ["exact", "mde"])
def test_varying_strain_gains_no_energy(name, dt, method):
    """Along Magnus steps, and where the forces are not quite the gradient of the energy."""
    strains = {key: {"basis": "legendre", "order": 2} for key in ("elongation", "bending_x", "bending_y")}
    arm = SoftArm(rod(2, 1e5, viscosity=0.0, strains=strains).robot, method=method)
    q0 = np.tile([0.05, 0.1, 0.0, 8.0, -5.0, 3.0, 2.0, 1.0, -4.0], 2)
    result = simulate(arm, q0, t_end=50 * dt, dt=dt, integrator=name)
    assert result.status.ok
    assert growth(energies(arm, result)) <= ROUND_OFF * scale(arm, result)


@pytest.mark.parametrize("name", DISSIPATIVE)
@pytest.mark.parametrize("dt", [1e-3, 5e-3])
def test_links_that_taper_and_are_bent_at_rest_gain_no_energy(name, dt):
    """From far off their helix, under a constant pressure."""
    arm, pressure = helix(viscosity=0.0), [5e3, 0.0, 1e4]
    result = simulate(
        arm, [0.02, 0.05, 8.0, -5.0, -6.0, 4.0], t_end=50 * dt, dt=dt, integrator=name, pressure=pressure
    )
    assert result.status.ok
    y = stored(arm, result, pressure)
    assert np.ptp(y) > 0.0
    assert growth(y) <= ROUND_OFF * scale(arm, result)


def test_midpoint_keeps_the_energy_of_a_tapered_helix():
    """Of second order in the step."""
    drift = []
    for dt in (2e-4, 1e-4):
        arm = helix(viscosity=0.0, chambers=[])
        result = simulate(arm, [0.01, 0.01, 3.0, -1.0, -2.0, 1.0], t_end=0.1, dt=dt, integrator="midpoint")
        assert result.status.ok
        drift.append(np.ptp(energies(arm, result)) / scale(arm, result))
    assert drift[0] < 1e-3
    assert drift[1] < 0.4 * drift[0]


# Where the energy is stored besides, or a constant pressure does work; each swings with hardly any loss.
FALLING = {"base_quaternion": [0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)]}
FLOOR = {"point": [0.0, 0.0, -0.03], "normal": [0.0, 0.0, 1.0], "stiffness": 2e3, "friction": 0.3}
OUTSIDE = {
    "floor": {"contacts": {"planes": [FLOOR]}, **FALLING},
    "held tip": {"tip_constraint": {"point": [0.03, 0.0, -0.19], "stiffness": 50.0, "damping": 0.0}},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", DISSIPATIVE)
@pytest.mark.parametrize("dt", [1e-3, 5e-3])
@pytest.mark.parametrize("what", OUTSIDE)
def test_no_energy_is_gained_from_contact_or_a_held_tip(name, dt, what):
    free = rod(2, 1e5, viscosity=0.0)
    arm = SoftArm(free.robot.replace(**OUTSIDE[what]))
    result = simulate(arm, bent(arm), t_end=200 * dt, dt=dt, integrator=name)
    assert result.status.ok
    store = max(arm.external_forces(q).energy for q in result.q)
    assert store > 1e-2 * scale(arm, result), "nothing was stored there"
    assert growth(stored(arm, result, [])) <= ROUND_OFF * (scale(arm, result) + store)


@pytest.mark.parametrize("name", DISSIPATIVE)
@pytest.mark.parametrize("dt", [1e-3, 5e-3])
def test_no_energy_is_gained_from_creep_hysteresis_and_constant_pressures(name, dt):
    """Areas that change with the strain, pressures that jump between two runs: both do p (V1 - V0)."""
    arm = bellows(
        creep=[{"tau": 0.03, "stiffness": [100.0, 2e-3, 2e-3]}],
        hysteresis=[{"stiffness": [20.0, 1e-3, 1e-3], "range": [0.02, 3.0, 3.0]}],
        damping=[1e-6, 1e-9, 1e-9],
        chambers=[
            {"angle_rad": a, "area_m2": 2e-4, "offset_m": 0.012, "area_slope": 1.5} for a in (0.0, 2.1, 4.2)
        ],
    )
    q, qd, z = np.array([0.1, 10.0, -5.0]), np.zeros(3), None
    for pressure in ([4e3, 0.0, -2e3], [0.0, 6e3, 1e3]):
        result = simulate(arm, q, qd, t_end=100 * dt, dt=dt, integrator=name, pressure=pressure, internal0=z)
        assert result.status.ok
        q, qd, z = result.q[-1], result.qd[-1], result.internal[-1]
        y = stored(arm, result, pressure)
        assert np.ptp(y) > 0.0
        assert growth(y) <= ROUND_OFF * max(
            sum(arm.energy(*one)[::2]) for one in zip(result.q, result.qd, strict=True)
        )


@pytest.mark.parametrize("name", DISSIPATIVE)
def test_work_of_a_constant_pressure_is_not_taken_out(name, monkeypatch):
    """From rest, all that the arm has comes from the chambers."""
    arm = bellows(damping=[1e-6, 1e-9, 1e-9])
    keys = {"t_end": 0.1, "dt": 5e-4, "integrator": name, "pressure": [4e3, 0.0, 2e3]}
    guarded = simulate(arm, **keys)
    monkeypatch.setitem(stepper._SCHEMES, name, Scheme(*stepper._SCHEMES[name]))
    plain = simulate(arm, **keys)
    assert guarded.status == plain.status == "ok"
    largest = np.abs(plain.q).max(axis=0)
    assert (np.abs(guarded.q - plain.q).max(axis=0) < 0.02 * largest).all()


@pytest.mark.parametrize("name", DISSIPATIVE)
@pytest.mark.parametrize("driven", ["pressure", "wrench"])
def test_input_is_not_taken_for_a_gain(name, driven, monkeypatch):
    """Where input does work that no step knows exactly, steps are as without the guard."""
    arm = bellows(damping=[1e-6, 1e-9, 1e-9])
    keys = {
        "pressure": {"pressure": lambda t: 3e3 * np.sin(60.0 * t + np.arange(3.0))},
        "wrench": {"wrench": [0.0, 0.0, 0.0, 0.1, 0.0, 0.0]},
    }[driven]
    guarded = simulate(arm, t_end=0.2, dt=2e-3, integrator=name, **keys)
    monkeypatch.setitem(stepper._SCHEMES, name, Scheme(*stepper._SCHEMES[name]))
    plain = simulate(arm, t_end=0.2, dt=2e-3, integrator=name, **keys)
    assert guarded.status == plain.status == "ok"
    np.testing.assert_array_equal(guarded.q, plain.q)


@pytest.mark.parametrize("name", DISSIPATIVE)
def test_guard_stays_off_behind_valves_and_for_filters(name):
    """What passes a valve brings energy; what a filter linearises must be smooth."""
    gas = make_gas(ValveModel(), np.full(3, 1e-5))
    assert type(run_of(name).args[0]) is Dissipative
    assert type(run_of(name, air=gas).args[0]) is Scheme
    assert type(run_of(name, guarded=False).args[0]) is Scheme


@pytest.mark.parametrize("name", IMPLICIT)
@pytest.mark.parametrize("n_links", [1, 4, 16])
@pytest.mark.parametrize("viscosity", [0.0, 300.0])
def test_very_stiff_arms_finish_and_stay_physical(name, n_links, viscosity, figure):
    """E = 100 MPa, bent and let go: no step of 5 ms resolves it, and none may feed it."""
    arm = rod(n_links, 1e8, viscosity)
    result = simulate(arm, bent(arm), t_end=0.5, dt=5e-3, integrator=name)
    assert result.status == "ok"
    y = energies(arm, result) / scale(arm, result)
    if viscosity == 0.0 and n_links == 4:
        figure(f"{name}, E 100 MPa, 4 links, dt 5 ms: largest gain of energy {max(0.0, y.max() - y[0]):.0e}")
    assert y.max() <= y[0] + 1e-2


@pytest.mark.parametrize("name", IMPLICIT)
@pytest.mark.parametrize("dt", [1e-5, 1e-3, 2e-2])
def test_stiff_and_soft_at_any_step(name, dt):
    """From 10 us to 20 ms, where no method resolves the swing of the soft arm either."""
    for youngs_modulus in (1e4, 1e8):
        arm = rod(4, youngs_modulus, 0.0)
        result = simulate(arm, bent(arm), t_end=50 * dt, dt=dt, integrator=name)
        assert result.status == "ok"
        y = energies(arm, result) / scale(arm, result)
        assert y.max() <= y[0] + (5e-2 if dt == 2e-2 else 1e-2)
