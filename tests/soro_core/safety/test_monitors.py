"""Plausibility: every monitor trips in its time, naming chamber and cause, and no healthy hour trips."""

import math
from dataclasses import replace

import numpy as np
import pytest

from soro_core.config import parse
from soro_core.pneumatics import regulator
from soro_core.pneumatics.regulator import RegulatorModel
from soro_core.safety import Limits, Monitors, Rating, check_rating, initial_state, judge, offer, reset, slew
from tests.refused import refused, tripped

MS = 1_000_000
NAMES = ("link0/chamber0", "link0/chamber1", "link0/chamber2")
LIMITS = Limits()
# Valves as emulated: with noise, hysteresis and quantisation.
VALVES = RegulatorModel()
DT_MS = 5


class Arm:
    """The limiter before modelled valves, at 200 Hz."""

    def __init__(self, limits=LIMITS, names=NAMES, model=VALVES, seed=0, dt_ms=DT_MS):
        self.limits, self.model, self.dt_ms, self.now_ms = limits, model, dt_ms, 0
        self.safety = initial_state(len(names), names)
        self.valves = regulator.initial_state(model, len(names))
        self.rng = np.random.default_rng(seed)

    def tick(
        self, command_pa, sensor=lambda p: p, valve=lambda before, after: after, fresh=True, supply=None
    ):
        """One cycle: command, exchange, judge; `valve` and `sensor` change what they do."""
        now = self.now_ms * MS
        n = len(self.safety.setpoint_pa)
        self.safety, _ = offer(self.limits, self.safety, np.broadcast_to(command_pa, n), now, now)
        self.safety = slew(self.limits, self.safety, now)
        reading = sensor(regulator.reading(self.model, self.valves, self.rng))
        self.safety = judge(self.limits, self.safety, reading, fresh, now, None, supply, self.model)
        before = self.valves
        after = regulator.step(self.model, before, self.safety.setpoint_pa, self.dt_ms * 1e-3)
        self.valves = replace(after, pressure_pa=valve(before.pressure_pa, after.pressure_pa))
        self.now_ms += self.dt_ms

    def run(self, for_ms, command_pa, **kinds):
        """Cycles until a trip; its time since the call [ms], or None."""
        start = self.now_ms
        while self.now_ms < start + for_ms:
            at = self.now_ms
            self.tick(command_pa(at) if callable(command_pa) else command_pa, **kinds)
            if self.safety.vented:
                return at - start
        return None

    @property
    def cause(self):
        return self.safety.cause


@pytest.fixture
def arm():
    """Three chambers that have settled at 40 kPa."""
    it = Arm()
    assert it.run(3000, 40e3) is None
    return it


def only(n, change):
    """Change of chamber `n` alone."""

    def apply(*pressures):
        out = pressures[-1].copy()
        out[n] = change(*(p[n] for p in pressures))
        return out

    return apply


def test_a_reading_that_leaves_the_model_trips_after_its_time(arm):
    took = arm.run(2000, 40e3, sensor=only(1, lambda p: p + 9e3))
    assert 300 <= took <= 305
    assert tripped(arm.cause) == ("implausible", "link0/chamber1")


def test_a_small_offset_is_tolerated(arm):
    assert arm.run(20_000, 40e3, sensor=only(1, lambda p: p + 6e3)) is None


def test_stuck_valve(arm):
    """A set point 12 kPa away shows it by itself, with the model's threshold out of reach."""
    arm.limits = Limits(monitors=Monitors(model_pa=30e3))
    took = arm.run(2000, 52e3, valve=only(2, lambda before, after: before))
    assert 500 <= took <= 600, "500 ms, and the time of the ramp to 10 kPa"
    assert tripped(arm.cause) == ("stuck valve", "link0/chamber2")


def test_stuck_valve_is_found_by_the_model_first(arm):
    took = arm.run(2000, 52e3, valve=only(2, lambda before, after: before))
    assert 300 <= took <= 450
    assert tripped(arm.cause) == ("implausible", "link0/chamber2")


def circle(at_ms, size=5e3):
    """Set points of a slow circle around 40 kPa."""
    angle = 2 * math.pi * at_ms / 4000
    return 40e3 + size * np.sin(angle + np.arange(3) * 2 * math.pi / 3)


def test_frozen_sensor_on_a_small_circle(arm):
    arm.run(4000, circle)
    frozen = float(arm.safety.monitors.reading_pa[0])
    took = arm.run(4000, circle, sensor=only(0, lambda p: frozen))
    assert 500 <= took <= 2000
    assert tripped(arm.cause) == ("frozen sensor", "link0/chamber0")


def test_frozen_sensor_on_a_large_one_is_named_as_such(arm):
    frozen = float(arm.safety.monitors.reading_pa[0])
    took = arm.run(4000, lambda at: circle(at, 30e3), sensor=only(0, lambda p: frozen))
    assert took is not None
    assert tripped(arm.cause) == ("frozen sensor", "link0/chamber0")


@pytest.mark.parametrize("jump_pa", [51e3, -60e3])
def test_spike_in_one_sample(arm, jump_pa):
    assert arm.run(100, 40e3, sensor=only(1, lambda p: p + jump_pa)) == 0
    assert tripped(arm.cause) == ("spike", "link0/chamber1")


@pytest.mark.parametrize(("reading", "which"), [(-106e3, "open"), (151e3, "short"), (1e300, "short")])
def test_broken_wire(arm, reading, which):
    assert arm.run(100, 40e3, sensor=only(1, lambda p: reading)) == 0
    assert tripped(arm.cause) == (f"{which} circuit", "link0/chamber1")


def test_leak_at_a_constant_set_point(arm):
    """A valve that holds closed while the chamber loses 3 kPa/s; the model would see it after 2.7 s."""
    took = arm.run(5000, 40e3, valve=only(1, lambda before, after: before - 3e3 * DT_MS * 1e-3))
    assert 1000 <= took <= 2200
    assert tripped(arm.cause) == ("leak", "link0/chamber1")
    slow = Arm()
    slow.run(3000, 40e3)
    assert slow.run(3500, 40e3, valve=only(1, lambda before, after: before - 1.5e3 * DT_MS * 1e-3)) is None


def test_supply_low_where_it_is_reported(arm):
    assert arm.run(2000, 40e3, supply=np.array([math.nan, 95e3, math.nan])) is None
    took = arm.run(2000, 40e3, supply=np.array([math.nan, 85e3, math.nan]))
    assert took == 100
    assert tripped(arm.cause) == ("supply low", "link0/chamber1")


def test_one_chamber_that_never_answers_is_named(arm):
    took = arm.run(500, 40e3, fresh=np.array([True, True, False]))
    assert 50 <= took <= 55
    assert tripped(arm.cause) == ("readings lost", "link0/chamber2")


def test_chambers_that_miss_in_turns_are_tolerated(arm):
    for cycle_number in range(400):
        arm.tick(40e3, fresh=np.arange(3) != cycle_number % 3)
    assert arm.cause is None


def test_a_jump_over_a_gap_is_judged_by_what_was_expected_of_it():
    """Slow families: one reading in 160 ms, of a full step."""
    arm = Arm(limits=Limits(rise_pa_s=2e6, fall_pa_s=2e6, reading_age_s=0.5), dt_ms=5)
    for number in range(2000):
        arm.tick(0.0 if number // 100 % 2 else 90e3, fresh=number % 32 == 0)
    assert arm.cause is None


def test_reset_starts_the_monitors_afresh(arm):
    arm.run(100, 40e3, sensor=only(1, lambda p: -110e3))
    arm.safety, _ = offer(LIMITS, arm.safety, np.zeros(3), arm.now_ms * MS, arm.now_ms * MS)
    arm.safety, refusal = reset(LIMITS, arm.safety, arm.now_ms * MS)
    assert refusal is None
    assert arm.safety.monitors.names == NAMES
    assert not arm.safety.monitors.seen.any()
    assert arm.run(2000, 30e3) is None


CHAMBERS, SECONDS = 360, 30  # an hour of an arm of three chambers, side by side


def healthy(at_ms, phase):
    """Set points of all kinds: circles of every size and speed, and steps of full scale."""
    t = at_ms * 1e-3
    speed = 2 * math.pi / np.linspace(0.4, 8.0, CHAMBERS)
    circles = 45e3 + np.linspace(0, 45e3, CHAMBERS) * np.sin(speed * t + phase)
    steps = 90e3 * (np.floor(t / np.linspace(0.15, 4.0, CHAMBERS)) % 2)
    return np.where(np.arange(CHAMBERS) % 3 == 0, steps, circles)


@pytest.mark.slow
def test_no_healthy_hour_trips():
    """An hour's chamber seconds, with noise, hysteresis, quantisation, and one answer in 50 lost."""
    names = tuple(f"link0/chamber{n}" for n in range(CHAMBERS))
    arm = Arm(names=names, seed=3)
    lost = np.random.default_rng(4)
    phase = lost.uniform(0, 2 * math.pi, CHAMBERS)
    for _ in range(SECONDS * 1000 // DT_MS):
        arm.tick(healthy(arm.now_ms, phase), fresh=lost.random(CHAMBERS) > 0.02)
        assert arm.cause is None, arm.cause
    assert arm.valves.pressure_pa.max() > 85e3


def test_the_prediction_of_a_valve_is_that_of_the_time_of_its_reading():
    """Cycle by cycle, whatever is asked: the set points of an exchange act after its reading."""
    exact = RegulatorModel(reading_noise_pa=0.0, reading_resolution_pa=0.0)
    arm = Arm(model=exact)
    for number in range(400):
        pressure = arm.valves.pressure_pa
        arm.tick(60e3 if number % 120 < 60 else 10e3)
        np.testing.assert_allclose(arm.safety.monitors.expected.pressure_pa, pressure, atol=1e-6)
    assert arm.valves.pressure_pa.max() > 30e3


def test_other_kinds_of_valves_have_their_own_model():
    """A slow one trips nothing when the platform says that it is slow, and does when not."""
    slow = RegulatorModel(tau_s=0.4, delay_s=0.1)
    known = Arm(model=slow)
    assert known.run(10_000, lambda at: 80e3 * (at // 2000 % 2)) is None
    valves = regulator.initial_state(slow, 3)
    state = initial_state(3, NAMES)
    for number in range(400):
        now = number * DT_MS * MS
        state, _ = offer(LIMITS, state, np.full(3, 80e3), now, now)
        state = judge(LIMITS, slew(LIMITS, state, now), valves.pressure_pa, True, now)
        valves = regulator.step(slow, valves, state.setpoint_pa, DT_MS * 1e-3)
    assert tripped(state.cause) == ("implausible", "link0/chamber0")


@pytest.mark.parametrize(
    "monitors",
    [
        {"model_pa": 31e3},
        {"model_s": 1.1},
        {"stuck_pa": 31e3},
        {"stuck_s": 2.1},
        {"frozen_pa": 21e3},
        {"frozen_s": 6.0},
        {"spike_pa": 101e3},
        {"open_circuit_pa": -151e3},
        {"short_circuit_pa": 1.6e6},
        {"leak_pa_s": 21e3},
        {"leak_s": 11.0},
        {"supply_s": 1.1},
        {"model_pa": math.nan},
        {"off": True},
    ],
)
def test_no_configuration_crosses_the_hard_bounds(monitors):
    with refused(f"monitors.{next(iter(monitors))}"):
        parse({"monitors": monitors}, Limits, "f.yaml")


def test_wires_are_judged_beyond_the_burst_pressure():
    with refused("", names=("monitors.short_circuit_pa", "burst_pressure_pa")):
        parse({"monitors": {"short_circuit_pa": 105e3}}, Limits, "f.yaml")


STRONG = Rating(maximum_pa=150e3)
HIGH = {"maximum_pa": 103e3, "over_pressure_pa": 120e3, "burst_pressure_pa": 140e3}


def test_a_platform_has_its_own_rating():
    check_rating(Limits(**HIGH), STRONG, "f.yaml")
    with refused("limits.maximum_pa", 103e3, ("100000",)):
        check_rating(Limits(**HIGH), Rating(), "f.yaml")
    with refused("limits.over_pressure_pa", 158e3, ("157500",)):
        check_rating(
            Limits(
                **{
                    **HIGH,
                    "over_pressure_pa": 158e3,
                    "burst_pressure_pa": 160e3,
                    "monitors": Monitors(short_circuit_pa=200e3),
                }
            ),
            STRONG,
            "f.yaml",
        )
    with refused("limits.burst_pressure_pa"):
        check_rating(Limits(burst_pressure_pa=121e3), Rating(), "f.yaml")
    with refused("limits.minimum_pa", -20e3, ("-10000",)):
        check_rating(Limits(minimum_pa=-20e3), Rating(minimum_pa=-10e3), "f.yaml")
