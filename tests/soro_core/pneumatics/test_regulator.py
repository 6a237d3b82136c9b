"""The regulator model: exact in time, and each of its imperfections where it should be."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soro_core.pneumatics import (
    RegulatorModel,
    RegulatorState,
    initial_state,
    reading,
    step,
    targets,
    vent_time,
)

IDEAL = RegulatorModel(
    delay_s=0.0, hysteresis_pa=0.0, command_resolution_pa=0.0, reading_resolution_pa=0.0, reading_noise_pa=0.0
)


def after(model, setpoint, seconds, steps=1, state=None):
    state = state or initial_state(model, 1)
    for _ in range(steps):
        state = step(model, state, np.array([setpoint]), seconds / steps)
    return state


def test_first_order_step_reaches_63_percent_after_tau():
    state = after(IDEAL, 50e3, IDEAL.tau_s)
    assert state.pressure_pa[0] == pytest.approx(50e3 * (1 - math.exp(-1)), rel=1e-12)


def test_the_delay_shifts_the_step():
    delayed = IDEAL.model_copy(update={"delay_s": 0.02})
    assert after(delayed, 50e3, 0.019).pressure_pa[0] == 0.0
    expected = after(IDEAL, 50e3, 0.05).pressure_pa[0]
    assert after(delayed, 50e3, 0.07).pressure_pa[0] == pytest.approx(expected, rel=1e-12)


def test_rate_limit_is_linear_then_exponential():
    limited = IDEAL.model_copy(update={"rate_limit_pa_s": 200e3})
    corner = 200e3 * limited.tau_s
    reach = (50e3 - corner) / 200e3
    assert after(limited, 50e3, reach).pressure_pa[0] == pytest.approx(50e3 - corner, rel=1e-12)
    late = after(limited, 50e3, reach + limited.tau_s).pressure_pa[0]
    assert late == pytest.approx(50e3 - corner * math.exp(-1), rel=1e-12)


def test_hysteresis_leaves_half_its_width_on_either_side():
    model = IDEAL.model_copy(update={"hysteresis_pa": 1000.0})
    up = after(model, 50e3, 5.0)
    assert up.pressure_pa[0] == pytest.approx(49.5e3)
    down = after(model, 40e3, 5.0, state=up)
    assert down.pressure_pa[0] == pytest.approx(40.5e3)
    inside = after(model, 41e3, 5.0, state=down)
    assert inside.pressure_pa[0] == pytest.approx(40.5e3)


def test_reading_is_noisy_and_quantised_and_repeats_with_its_seed():
    model = RegulatorModel()
    state = initial_state(model, 3, pressure_pa=20e3)
    first = reading(model, state, np.random.default_rng(5))
    again = reading(model, state, np.random.default_rng(5))
    assert np.array_equal(first, again)
    many = np.array(
        [reading(model, state, rng)[0] for rng in [np.random.default_rng(1)] for _ in range(4000)]
    )
    assert np.allclose(many % 100.0, 0.0)
    # Quantisation adds its own variance of resolution^2 / 12.
    assert np.std(many) == pytest.approx(math.hypot(100.0, 100.0 / math.sqrt(12)), rel=0.05)


def test_set_points_outside_its_range_saturate():
    assert after(IDEAL, 500e3, 5.0).pressure_pa[0] == pytest.approx(90e3)
    assert after(IDEAL, -50e3, 5.0).pressure_pa[0] == 0.0


@settings(max_examples=100)
@given(
    st.integers(1, 40),
    st.floats(0, 0.03),
    st.sampled_from([0.0, 300e3]),
    st.sampled_from([0.0, 900.0]),
    st.lists(st.floats(0, 90e3), min_size=1, max_size=5),
)
def test_the_result_does_not_depend_on_the_step(splits, delay, rate, width, setpoints):
    model = IDEAL.model_copy(update={"delay_s": delay, "rate_limit_pa_s": rate, "hysteresis_pa": width})
    coarse = fine = initial_state(model, 1)
    for setpoint in setpoints:
        coarse = after(model, setpoint, 0.04, 1, coarse)
        fine = after(model, setpoint, 0.04, splits, fine)
    assert fine.pressure_pa[0] == pytest.approx(coarse.pressure_pa[0], rel=1e-9, abs=1e-6)
    assert 0.0 <= fine.pressure_pa[0] <= 90e3


@settings(max_examples=50)
@given(st.floats(0, 0.03), st.lists(st.floats(-10e3, 120e3), min_size=1, max_size=6))
def test_the_targets_of_a_tick_fill_it_and_come_after_the_dead_time(delay, setpoints):
    """What a valve in place of the lag moves to: each set point for its tick, later by the dead time."""
    model, dt = IDEAL.model_copy(update={"delay_s": delay}), 0.005
    state, held = initial_state(model, 1), []
    for setpoint in setpoints:
        state, spans = targets(model, state, np.array([setpoint]), dt)
        assert sum(span for span, _ in spans) == pytest.approx(dt)
        assert min(span for span, _ in spans) >= 0.0
        held += [(span, target[0]) for span, target in spans]
    ends = np.cumsum([span for span, _ in held])
    for k, setpoint in enumerate(setpoints):
        middle = (k + 0.5) * dt + delay
        if middle < ends[-1] - 1e-9:
            at = int(np.searchsorted(ends, middle))
            assert held[at][1] == min(max(setpoint, 0.0), 90e3)


def test_vent_time_bounds_the_vent():
    model = RegulatorModel(rate_limit_pa_s=400e3)
    state = initial_state(model, 1, pressure_pa=90e3)
    took = vent_time(model, 90e3, 5e3)
    assert step(model, state, np.zeros(1), took).pressure_pa[0] == pytest.approx(5e3, rel=1e-6)
    assert vent_time(model, 90e3, 100.0) == math.inf


def test_a_fall_may_be_slower_than_a_rise() -> None:
    model = IDEAL.model_copy(update={"tau_s": 0.1, "vent_tau_s": 0.4})
    up, down = np.array([0.0]), np.array([50e3])
    rising = step(model, RegulatorState(up, up), down, 0.1).pressure_pa
    falling = step(model, RegulatorState(down, down), up, 0.1).pressure_pa
    assert rising == pytest.approx(50e3 * -math.expm1(-1.0))
    assert falling == pytest.approx(50e3 * math.exp(-0.25))
    both = RegulatorState(np.array([0.0, 50e3]), np.array([0.0, 50e3]))
    mixed = step(model, both, np.array([50e3, 0.0]), 0.1).pressure_pa
    assert mixed == pytest.approx([rising[0], falling[0]])
    assert vent_time(model, 50e3, 5e3) == pytest.approx(0.4 * math.log(10.0))
