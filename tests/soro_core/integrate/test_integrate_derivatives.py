"""Derivatives of one step against extrapolated differences of the step, and steps that have none."""

import numpy as np
import pytest
from rods import bellows, bent, helix, rod

from soro_core.errors import ModelError
from soro_core.integrate import STEPPERS, State, make_stepper
from soro_core.pneumatics import ValveModel
from tests.refused import fails
from tests.soro_core.model.differences import extrapolated, worst

# Of the largest entry of each matrix.
ALLOWED = 1e-8
DERIVED = ("trapezoidal", "midpoint", "tr_bdf2", "rk4", "dopri5")
LOSSES = {
    "creep": [{"tau": 0.05, "stiffness": [40.0, 2e-3, 2e-3]}, {"tau": 5.0, "stiffness": [20.0, 1e-3, 1e-3]}],
    "hysteresis": [{"stiffness": [20.0, 1e-3, 1e-3], "range": [0.05, 1.0, 1.0]}],
}
WRENCH = np.array([1e-3, 2e-3, -1e-3, 0.02, 0.01, -0.03])


def moving(arm, seed=0):
    """State in motion, and pressures."""
    rng = np.random.default_rng(seed)
    angular = [name.split("/")[1].startswith("bending") for name in arm.robot.coordinate_names]
    scale = np.where(angular, 2.0, 0.01)
    z = rng.uniform(-0.3, 0.3, arm.n_internal) * scale[arm.tables.internal_coordinate]
    q, qd = rng.normal(size=(2, arm.n_q)) * scale
    return State(q, 10.0 * qd, z), rng.uniform(1e3, 2e4, arm.n_u), scale


def errors(stepper, state, p, dt, scale, wrench=None):
    """Error of each block of derivatives."""
    n, n_z = stepper.arm.n_q, len(state.internal)

    def after(x):
        start = State(x[:n], x[n : 2 * n], x[2 * n : 2 * n + n_z])
        end, status = stepper.step(start, x[2 * n + n_z :], dt, wrench)
        assert status.ok, status
        return np.concatenate((end.q, end.qd, end.internal))

    x = np.concatenate((state.q, state.qd, state.internal, p))
    z_scale = scale[stepper.arm.tables.internal_coordinate]
    step = np.concatenate((0.01 * scale, 0.5 * scale, 0.01 * z_scale, np.full(len(p), 300.0)))
    wanted = extrapolated(after, x, step)
    got = stepper.derivatives(state, p, dt, wrench)
    np.testing.assert_array_equal(np.concatenate((got.state.q, got.state.qd, got.state.internal)), after(x))
    assert [part.shape[1] for part in got[1:]] == [n, n, n_z, len(p)]
    found, first = {}, 0
    for name, part in zip(got._fields[1:], got[1:], strict=True):
        for rows, block in ((slice(0, n), "q"), (slice(n, 2 * n), "qd"), (slice(2 * n, None), "internal")):
            found[block, name] = worst(part[rows], wanted[rows, first : first + part.shape[1]])
        first += part.shape[1]
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", DERIVED)
def test_of_a_step_with_losses_and_chambers(name):
    arm = bellows(**LOSSES)
    state, p, scale = moving(arm)
    # The error control of dopri5 divides longer steps.
    found = errors(make_stepper(name, arm), state, p, 1e-4 if name == "dopri5" else 1e-3, scale, WRENCH)
    assert max(found.values()) < ALLOWED, found


@pytest.mark.slow
@pytest.mark.parametrize("name", ["trapezoidal", "tr_bdf2", "rk4"])
def test_of_links_that_taper_and_are_bent_at_rest(name):
    """A helix with chambers, of varying strain."""
    arm = helix()
    state, p, scale = moving(arm)
    found = errors(make_stepper(name, arm), state, p, 2e-4, scale, WRENCH)
    assert max(found.values()) < ALLOWED, found


@pytest.mark.parametrize("name", ["trapezoidal", "midpoint", "tr_bdf2"])
def test_where_a_velocity_turns_within_the_step(name):
    arm = bellows(**LOSSES)
    state, p, scale = moving(arm)
    stepper = make_stepper(name, arm, guarded=False)
    after = stepper.step(State(state.q, 0.0 * state.qd, state.internal), p, 1e-3)[0]
    start = State(state.q, -0.5 * after.qd, state.internal)
    end, _ = stepper.step(start, p, 1e-3)
    assert ((start.qd * end.qd) < 0.0).all()
    found = errors(stepper, start, p, 1e-3, 0.1 * scale)
    assert max(found.values()) < ALLOWED, found


@pytest.mark.parametrize("name", ["trapezoidal", "tr_bdf2"])
def test_of_a_long_unguarded_step_of_a_stiff_arm(name):
    """Motion is much faster than the step: what the filter takes."""
    arm = rod(2, 1e6, 300.0)
    stepper = make_stepper(name, arm, guarded=False)
    scale = np.tile([0.01, 1.0, 1.0], 2)
    found = errors(stepper, State(0.3 * bent(arm), 5.0 * scale), np.zeros(0), 4e-3, scale)
    assert max(found.values()) < ALLOWED, found


def test_every_stepper_is_derived_or_refused():
    linear = {name for name in STEPPERS if name.endswith("_linear")}
    assert {*DERIVED, *linear} == set(STEPPERS)
    arm = bellows()
    state, p, _ = moving(arm)
    for name in linear:
        with fails(ModelError, name, "_linear", key="integrator"):
            make_stepper(name, arm).derivatives(state, p, 1e-3)


@pytest.mark.parametrize(("name", "dt"), [("trapezoidal", 0.02), ("tr_bdf2", 0.02), ("dopri5", 0.01)])
def test_a_damped_or_divided_step_is_refused(name, dt):
    arm = rod(2, 1e5, 30.0)
    with fails(ModelError, "damped, divided", "smaller", key="dt"):
        make_stepper(name, arm).derivatives(State(bent(arm, 0.2), np.zeros(6)), [], dt)


def test_a_step_that_loses_energy_to_the_guard_is_refused():
    arm = rod(2, 5e4, 0.0)
    guarded, rule = make_stepper("tr_bdf2", arm), make_stepper("tr_bdf2", arm, guarded=False)
    state = State(bent(arm, 0.02), np.zeros(6))
    for _ in range(25):
        state, _ = rule.step(state, [], 1e-3)
    rule.derivatives(state, [], 1e-3)
    with fails(ModelError, "corrected", key="dt"):
        guarded.derivatives(state, [], 1e-3)


def test_valves_and_a_failed_step_are_refused():
    arm = bellows()
    valves = ValveModel(fill_m3_s_pa=5e-12, vent_m3_s_pa=5e-12, supply_pa=150e3)
    stepper = make_stepper("trapezoidal", arm, valves=valves)
    with fails(ModelError, "valves", key="valves"):
        stepper.derivatives(stepper.initial_state(), np.zeros(3), 1e-3)
    stepper = make_stepper("trapezoidal", arm)
    with fails(ModelError, "failed", "not finite"):
        stepper.derivatives(stepper.initial_state(), [np.nan, 0.0, 0.0], 1e-3)
    with fails(ModelError, "allowed is a number above 0", key="dt"):
        stepper.derivatives(stepper.initial_state(), np.zeros(3), -1.0)


def test_same_bits_whatever_was_derived_before():
    arm = bellows(**LOSSES)
    state, p, _ = moving(arm)
    other, q, _ = moving(arm, seed=1)
    used, fresh = make_stepper("tr_bdf2", arm), make_stepper("tr_bdf2", bellows(**LOSSES))
    used.derivatives(other, q, 2e-3, WRENCH)
    for got, wanted in zip(
        used.derivatives(state, p, 1e-3)[1:], fresh.derivatives(state, p, 1e-3)[1:], strict=True
    ):
        np.testing.assert_array_equal(got, wanted)
