"""Steppers and simulate: energy, losses, and failure as a status (order: tests/soro_core/integrate)."""

import numpy as np
import pytest
from sample_arms import chambers, law_link

from soro_core import SoftArm, robot_from_dict, simulate
from soro_core.errors import ModelError
from soro_core.integrate import STEPPERS, State, make_stepper
from tests.refused import fails

LOSSY = {
    "creep": [{"tau": 0.03, "stiffness": [30.0, 2e-3, 2e-3]}],
    "hysteresis": [{"stiffness": [20.0, 1e-3, 1e-3], "range": [0.02, 3.0, 3.0]}],
}


def arm_of(n_links=1, method="exact", **keys):
    rng = np.random.default_rng(5)
    links = [law_link(rng, chambers=chambers(rng), **keys) for _ in range(n_links)]
    return SoftArm(robot_from_dict({"links": links, "tip_mass": 0.02}), method=method)


def start(arm):
    n = arm.n_q // 3
    return np.tile([0.05, 6.0, -3.0], n), np.tile([0.2, 10.0, 30.0], n)


@pytest.mark.parametrize(("integrator", "dt", "limit"), [("rk4", 2e-4, 1e-6), ("trapezoidal", 2e-4, 2e-4)])
def test_energy_stays_without_damping(integrator, dt, limit):
    arm = arm_of(2)
    q0, qd0 = start(arm)
    result = simulate(arm, q0, qd0, t_end=0.5, dt=dt, integrator=integrator)
    energies = [sum(arm.energy(q, qd)) for q, qd in zip(result.q[::50], result.qd[::50], strict=True)]
    kinetic = max(arm.energy(q, qd)[0] for q, qd in zip(result.q[::50], result.qd[::50], strict=True))
    assert np.ptp(energies) < limit * kinetic


@pytest.mark.parametrize("loss", ["creep", "hysteresis"])
@pytest.mark.parametrize("integrator", STEPPERS)
def test_internal_states_dissipate(loss, integrator):
    """Energy with that of the internal springs only ever falls."""
    arm = arm_of(1, **{loss: LOSSY[loss]})
    result = simulate(arm, *start(arm), t_end=0.4, dt=5e-4, integrator=integrator)
    assert result.status.ok
    springs = 0.5 * result.internal**2 @ arm.tables.internal_stiffness
    total = np.array([sum(arm.energy(q, qd)) for q, qd in zip(result.q, result.qd, strict=True)]) + springs
    lost = total[0] - total[-1]
    assert lost > 1e-4
    assert np.diff(total).max() < 2e-3 * lost


def test_stiff_creep_is_viscous_damping():
    """A branch that relaxes 1000 times faster than the step acts as the dashpot stiffness * tau, stably."""
    tau, k = 2e-6, np.array([3e4, 0.5, 0.5])
    creeping = arm_of(1, creep=[{"tau": tau, "stiffness": list(k)}])
    damped = arm_of(1, damping=list(k * tau))
    q0 = start(creeping)[0]
    got = simulate(creeping, q0, np.zeros(3), t_end=0.3, dt=2e-3)
    want = simulate(damped, q0, np.zeros(3), t_end=0.3, dt=2e-3)
    assert got.status.ok
    np.testing.assert_allclose(got.q, want.q, atol=2e-3 * np.abs(q0).max())


def test_hysteresis_closes_a_loop_of_the_right_width():
    """Force of a Dahl element on a slow large cycle saturates at stiffness * range."""
    arm = arm_of(
        1, hysteresis=[{"stiffness": [0.0, 1e-2, 0.0], "range": [1.0, 0.05, 1.0]}], damping=[0.5, 1e-5, 1e-5]
    )
    gain = arm.actuation_matrix()[1]
    result = simulate(
        arm, t_end=2.0, dt=2e-3, pressure=lambda t: 4e5 * np.sin(2 * np.pi * t) * gain / np.abs(gain).max()
    )
    z = result.internal[:, 1]
    assert result.status.ok
    assert np.abs(z).max() == pytest.approx(0.05, rel=0.02)
    assert np.abs(z).max() <= 0.05


# A run knows more than its single steps: how the steps before went (the linearly-implicit ones iterate less
# with that), or how long a step may be.
AGREEMENT = dict.fromkeys(STEPPERS, 1e-7) | {"rk4": 1e-12, "dopri5": 1e-5}
AGREEMENT |= {"midpoint_linear": 1e-3, "tr_bdf2_linear": 1e-4}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "method"), [*((name, "exact") for name in STEPPERS), ("trapezoidal", "mde"), ("rk4", "mde")]
)
def test_stepper_and_simulate_agree(name, method):
    arm = arm_of(2, method=method, **LOSSY)
    stepper = make_stepper(name, arm)
    state = stepper.initial_state(*start(arm))
    p = np.linspace(0, 3e4, arm.n_u)
    result = simulate(arm, state.q, state.qd, t_end=2e-2, dt=1e-3, integrator=name, pressure=p)
    for _ in range(20):
        state, status = stepper.step(state, p, 1e-3)
        assert status.ok
        assert str(status) == "ok"
    np.testing.assert_allclose(result.q[-1], state.q, rtol=AGREEMENT[name])
    largest = np.abs(state.internal).max()
    np.testing.assert_allclose(result.internal[-1], state.internal, rtol=0, atol=AGREEMENT[name] * largest)


@pytest.mark.parametrize("name", STEPPERS)
def test_a_failed_step_returns_the_old_state_and_says_why(name):
    arm = arm_of(1)
    stepper = make_stepper(name, arm)
    good = stepper.initial_state(*start(arm))
    cases = [
        (good, [0, np.nan, 0], 1e-3, "a pressure or wrench is not finite"),
        (State(np.array([np.nan, 0, 0]), np.zeros(3)), np.zeros(3), 1e-3, "the state is not finite"),
        (State(np.array([-1.2, 0, 0]), np.zeros(3)), np.zeros(3), 1e-3, "compressed to nothing"),
        (State(np.array([-0.9, 0, 0]), np.array([-1e4, 0, 0])), np.zeros(3), 1e-3, "compressed to nothing"),
    ]
    for state, pressures, dt, words in cases:
        after, status = stepper.step(state, pressures, dt)
        assert not status.ok
        assert words in status.message
        assert ";" in status, "what to do is missing"
        assert after is state
    with fails(ModelError, "0.0", key="dt"):
        stepper.step(good, np.zeros(3), 0.0)


@pytest.mark.parametrize("integrator", STEPPERS)
def test_nan_pressure_ends_a_run_early_and_cleanly(integrator):
    arm = arm_of(1)
    result = simulate(
        arm,
        t_end=1.0,
        dt=1e-2,
        integrator=integrator,
        pressure=lambda t: [0, np.nan if t > 0.303 else 1e3, 0],
    )
    assert not result.status.ok
    assert "t = 0.3 s" in result.status
    assert "pressure" in result.status
    assert result.t[-1] == pytest.approx(0.3)
    assert len(result.t) == len(result.q) == len(result.qd) == 31
    assert np.isfinite(result.q).all()
    assert np.isfinite(result.qd).all()


def test_explicit_run_that_diverges_says_so():
    arm = arm_of(1, creep=[{"tau": 1e-5, "stiffness": [1e3, 1.0, 1.0]}])
    result = simulate(arm, *start(arm), t_end=1.0, dt=1e-2, integrator="rk4")
    assert not result.status.ok
    assert "smaller dt" in result.status
    assert np.isfinite(result.q).all()
    assert simulate(arm, *start(arm), t_end=1.0, dt=1e-2).status == "ok"


def test_last_step_is_shortened_and_start_is_included():
    arm = arm_of(1)
    result = simulate(arm, *start(arm), t_end=0.0105, dt=2e-3)
    np.testing.assert_allclose(result.t, [0, 0.002, 0.004, 0.006, 0.008, 0.010, 0.0105])
    np.testing.assert_array_equal(result.q[0], start(arm)[0])
    assert len(simulate(arm, *start(arm), t_end=1.0, dt=2e-3).t) == 501


def test_rest_is_an_equilibrium_that_a_run_finds():
    """Damped and hanging, the run ends where gravity, elasticity and pressure balance."""
    arm = arm_of(1, damping=[0.3, 2e-5, 2e-5])
    arm = SoftArm(arm.robot.replace(base_quaternion=[1.0, 0.0, 0.0, 0.0]))
    p = np.array([5e3, 0.0, 1e4])
    q = simulate(arm, t_end=4.0, dt=2e-3, pressure=p).q[-1]
    balance = arm.gravity_force(q) + arm.elastic_force(q) - arm.actuation_matrix(q) @ p
    assert np.abs(balance).max() < 1e-6 * np.abs(arm.gravity_force(q)).max()


@pytest.mark.parametrize(
    ("keys", "key", "names"),
    [
        ({"integrator": "euler"}, "integrator", ("trapezoidal",)),
        ({"dt": 0.0}, "dt", ("0",)),
        ({"t_end": float("nan")}, "t_end", ("nan",)),
        ({"q0": [0, 0]}, "q0", ("(2,)",)),
        ({"q0": [0, np.nan, 0]}, "q0", ("nan",)),
        ({"q0": [-2.0, 0, 0]}, "elongation", ("-1",)),
        ({"pressure": [0.0]}, "pressure", ("(1,)",)),
        ({"pressure": lambda t: 0.0}, "pressure(t)", ("()",)),
        ({"q0": "abc"}, "q0", ("'abc'", "3")),
        ({"dt": "1"}, "dt", ("'1'",)),
        ({"dt": 1e-12}, "dt", ("1e-12",)),
        ({"integrator": ["rk4"]}, "integrator", ("['rk4']",)),
        ({"valves": {"fill_m3_s_pa": 1e-9}}, "valves", ("ValveModel",)),
    ],
)
def test_wrong_use_of_simulate_is_refused(keys, key, names):
    with fails(ModelError, *names, key=key):
        simulate(arm_of(1), **keys)
