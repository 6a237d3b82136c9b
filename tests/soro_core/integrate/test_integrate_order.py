"""Order of convergence of every stepper, with internal states and pressures too."""

import numpy as np
import pytest
from rods import IMPLICIT, LENGTH, bellows, bent, rod

from soro_core import simulate
from soro_core.errors import ModelError
from soro_core.integrate import STEPPERS, stepper
from soro_core.integrate.stepper import DISSIPATIVE, run_of, stepping
from soro_core.integrate.steppers.scheme import Scheme
from tests.refused import fails

T_END = 0.2
# Where each is in its asymptotic range: for rk4 and dopri5 before round-off, for dopri5 one step of its own
# for each of the grid.
STEPS = dict.fromkeys(IMPLICIT, (200, 400, 800)) | {"rk4": (100, 200, 400), "dopri5": (100, 200, 400)}
CREEPING = dict.fromkeys(IMPLICIT, (400, 800, 1600)) | {"rk4": (100, 200, 400)}
ORDER = dict.fromkeys(IMPLICIT, 2) | {"rk4": 4, "dopri5": 5}


def end(result):
    """State at the end, strains in rad or 1, velocities over 20 1/s, which is what they are here."""
    assert result.status.ok, result.status
    weight = np.tile([1.0, LENGTH / 2, LENGTH / 2], result.q.shape[1] // 3)
    return np.concatenate([weight * result.q[-1], weight * result.qd[-1] / 20.0])


def orders(run, steps, reference):
    errors = [np.abs(end(run(n)) - reference).max() for n in steps]
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:])), errors


@pytest.fixture(scope="module")
def release():
    """A soft rod, bent and let go, and where it is after 0.2 s."""
    arm = rod(2, youngs_modulus=5e4, viscosity=30.0)
    start = bent(arm, 0.02)
    fine = simulate(arm, start, t_end=T_END, dt=T_END / 6400, integrator="rk4")
    return arm, start, end(fine)


def test_every_stepper_has_its_order_here():
    assert set(STEPPERS) == set(ORDER)


@pytest.mark.parametrize("name", STEPPERS)
def test_order_on_a_bent_release(name, release, figure):
    arm, start, reference = release
    observed, errors = orders(
        lambda n: simulate(arm, start, t_end=T_END, dt=T_END / n, integrator=name), STEPS[name], reference
    )
    figure(f"order of {name}: {', '.join(f'{x:.2f}' for x in observed)} (theory {ORDER[name]})")
    assert observed == pytest.approx(ORDER[name], abs=0.1), errors


@pytest.mark.parametrize("name", DISSIPATIVE)
def test_order_where_energy_is_taken_out(name, monkeypatch, figure):
    """Without losses the guard of the energy acts in many steps, from the first one, at rest, on."""
    arm = rod(2, youngs_modulus=5e4, viscosity=0.0)
    start = bent(arm, 0.02)
    reference = end(simulate(arm, start, t_end=T_END, dt=T_END / 6400, integrator="rk4"))

    def run(n):
        return simulate(arm, start, t_end=T_END, dt=T_END / n, integrator=name)

    observed, errors = orders(run, STEPS[name], reference)
    figure(f"order of {name} without losses: {', '.join(f'{x:.2f}' for x in observed)} (theory 2)")
    assert observed == pytest.approx(2, abs=0.1), errors
    guarded = end(run(200))
    monkeypatch.setitem(stepper._SCHEMES, name, Scheme(*stepper._SCHEMES[name]))
    assert np.abs(guarded - end(run(200))).max() > 1e-6, "the guard did nothing"


@pytest.mark.parametrize("name", [*IMPLICIT, "rk4"])
def test_order_with_creep_and_pressures(name):
    """Internal states and pressures that change within the step keep the order."""
    arm = bellows(creep=[{"tau": 0.03, "stiffness": [100.0, 2e-3, 2e-3]}], damping=[0.05, 1e-6, 1e-6])
    t_end = 0.04

    def run(n, integrator=name):
        return simulate(
            arm,
            [0.02, 6.0, -3.0],
            [0.2, 10.0, 30.0],
            t_end=t_end,
            dt=t_end / n,
            integrator=integrator,
            pressure=lambda t: 3e3 * np.sin(60.0 * t + np.arange(3.0)),
        )

    def state(n, integrator=name):
        result = run(n, integrator)
        assert result.status.ok
        return np.concatenate([result.q[-1] * [50, 1, 1], result.internal[-1] * [50, 1, 1]])

    fine = state(3200, "rk4")
    errors = np.array([np.abs(state(n) - fine).max() for n in CREEPING[name]])
    assert np.log2(errors[:-1] / errors[1:]) == pytest.approx(ORDER[name], abs=0.1), errors


@pytest.mark.parametrize("name", ["trapezoidal", "tr_bdf2", "rk4", "dopri5"])
def test_nothing_is_carried_over_a_jump_of_the_pressure(name):
    """What one step leaves to the next does not hold where the pressure jumps between the two."""
    arm = bellows()
    before, after = np.array([0.0, 0.0, 2e3]), np.array([8e3, 0.0, 0.0])
    times = np.linspace(0.0, 0.04, 41)
    table = np.empty((41, 3, 3))
    table[:20], table[20:] = before, after
    q, v, z = np.zeros((41, 3)), np.zeros((41, 3)), np.zeros((41, 0))
    assert run_of(name)(stepping(arm), (times, table, np.zeros(6)), (q, v, z)) == (40, 0)
    first = simulate(arm, t_end=0.02, dt=1e-3, integrator=name, pressure=before)
    second = simulate(arm, first.q[-1], first.qd[-1], t_end=0.02, dt=1e-3, integrator=name, pressure=after)
    # dopri5 begins the second run with a step size of its own.
    rtol = 1e-5 if name == "dopri5" else 1e-8
    np.testing.assert_allclose(q[-1], second.q[-1], rtol=rtol)


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-9])
def test_error_control_keeps_its_tolerance_on_any_grid(rtol, release):
    arm, start, reference = release
    for n in (2, 20):
        result = simulate(arm, start, t_end=T_END, dt=T_END / n, integrator="dopri5", rtol=rtol)
        # Tens of steps, each with an error of rtol of the state, in an arm that damps.
        assert np.abs(end(result) - reference).max() < 20.0 * rtol


def test_error_control_saves_steps_where_they_are_not_needed(release):
    arm, start, reference = release
    loose = simulate(arm, start, t_end=T_END, dt=T_END / 2, integrator="dopri5", rtol=1e-3)
    assert np.abs(end(loose) - reference).max() > 1e-8, "as exact as the tightest tolerance"


@pytest.mark.parametrize(
    ("keys", "names"),
    [
        ({"integrator": "rk4", "rtol": 1e-6}, ("1e-06", "rk4")),
        ({"integrator": "trapezoidal", "rtol": 1e-6}, ("trapezoidal",)),
        ({"integrator": "dopri5", "rtol": 0.0}, ("1e-14", "0.1")),
        ({"integrator": "dopri5", "rtol": float("nan")}, ("1e-14", "0.1")),
    ],
)
def test_a_tolerance_that_means_nothing_is_refused(keys, names):
    with fails(ModelError, *names, key="rtol"):
        simulate(bellows(), t_end=0.01, **keys)
