"""What reaches the wire is finite, in range, fresh and slew-limited, whatever is asked for."""

import math
from unittest.mock import ANY

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soro_core.config import parse, with_changes
from soro_core.errors import ConfigError
from soro_core.pneumatics.lag import follow
from soro_core.safety import (
    Limiter,
    Limits,
    Rating,
    SafetyState,
    check_rating,
    for_regulators,
    initial_state,
    interpolated,
    judge,
    narrowed,
    offer,
    request_vent,
    reset,
    slew,
)
from soro_core.safety.limiter import TYPICAL
from tests.refused import fails, refused

MS = 1_000_000
LIMITS = Limits()
COLD = np.zeros(3)


def cycle(limits, state, reading, fresh, now_ns, **found):
    return judge(limits, slew(limits, state, now_ns), reading, fresh, now_ns, **found)


def commanded(command, at_ms=0, state=None, source="command"):
    state, refusal = offer(
        LIMITS, state or initial_state(3), np.array(command), at_ms * MS, at_ms * MS, source
    )
    return state, refusal


def run(state: SafetyState, from_ms: int, to_ms: int, reading=COLD, fresh=True, step_ms=5) -> SafetyState:
    for now in range(from_ms, to_ms + 1, step_ms):
        state = cycle(LIMITS, state, reading, fresh, now * MS)
    return state


def test_idle_until_a_first_command():
    state = run(initial_state(3), 0, 1000)
    assert not state.vented
    assert np.array_equal(state.setpoint_pa, COLD)


def test_a_good_command_is_approached_at_the_slew_rate_and_held():
    state, refusal = commanded([50e3, 20e3, 0.0])
    assert refusal is None
    state = run(state, 0, 50)
    assert state.setpoint_pa == pytest.approx([10e3, 10e3, 0.0])


@pytest.mark.parametrize(
    ("command", "stamp_ms", "now_ms", "says"),
    [
        ([math.nan, 0, 0], 0, 0, "not finite: chamber 0"),
        ([0, math.inf, 0], 0, 0, "not finite: chamber 1"),
        ([0, 0, -math.inf], 0, 0, "not finite: chamber 2"),
        ([0, 90_001.0, 0], 0, 0, "out of range: chamber 1"),
        ([0, 0, -1.0], 0, 0, "out of range: chamber 2"),
        ([0, 0], 0, 0, "wrong length"),
        ([[0, 0, 0]], 0, 0, "wrong length"),
        ([1, 1, 1], 0, 101, "stale"),
        ([1, 1, 1], 500, 100, "from the future"),
    ],
)
def test_a_bad_command_is_refused_counted_and_changes_nothing(command, stamp_ms, now_ms, says):
    before = initial_state(3)
    after, refusal = offer(LIMITS, before, np.array(command, dtype=float), stamp_ms * MS, now_ms * MS)
    assert refusal.startswith(says)
    assert after.rejected == {says.split(":")[0]: 1}
    assert np.array_equal(after.command_pa, before.command_pa)
    assert after.command_ns is None


def test_reordered_and_repeated_commands_are_refused():
    state, _ = commanded([1e3] * 3, 20)
    for at in (20, 10):
        state, refusal = offer(LIMITS, state, np.full(3, 2e3), at * MS, 21 * MS)
        assert refusal.startswith("out of order")
    assert state.command_pa[0] == 1e3


def test_a_clock_that_went_back_vents_and_its_last_stamp_orders_nothing():
    """As where /clock jumps ahead in lockstep, is answered, and goes on where it was."""
    state, _ = commanded([30e3] * 3, 10**9)
    state = run(state, 10**9, 10**9)
    state = run(state, 500, 500)
    assert state.cause.startswith("command lost: the clock went back by 999999.5")
    state, refusal = commanded(COLD, 500, state)
    assert refusal is None
    state, refusal = reset(LIMITS, state, 500 * MS)
    assert refusal is None
    assert not run(state, 505, 590).vented


def test_reordered_commands_are_refused_when_their_clock_runs_ahead_too():
    state, _ = offer(LIMITS, initial_state(3), np.full(3, 1e3), 90 * MS, 0)
    state, refusal = offer(LIMITS, state, np.full(3, 2e3), 80 * MS, 1 * MS)
    assert refusal is not None
    assert refusal.startswith("out of order")
    state, refusal = offer(LIMITS, state, np.full(3, 3e3), 91 * MS, 1 * MS)
    assert refusal is None
    assert state.command_pa[0] == 3e3


def test_one_live_source_at_a_time():
    state, _ = commanded([1e3] * 3, 0, source="controller")
    state, refusal = commanded([2e3] * 3, 50, state, source="joystick")
    assert refusal == "second source: joystick while controller is live"
    state, refusal = commanded([2e3] * 3, 101, state, source="joystick")
    assert refusal is None


def test_a_source_that_falls_silent_trips_and_no_other_takes_its_place_before():
    """However many commands of another one come between two cycles."""
    state = run(commanded([1e3] * 3, 0, source="controller")[0], 0, 100)
    state, refusal = commanded([80e3] * 3, 101, state, source="joystick")
    assert refusal == "second source: joystick while controller is live"
    state = run(state, 105, 105)
    assert state.cause == "command lost: last one 105 ms old"
    state, refusal = commanded([0.0] * 3, 106, state, source="joystick")
    assert refusal is None
    assert reset(LIMITS, state, 107 * MS)[1] is None


def test_watchdog_vents_within_one_cycle_of_100_ms_and_latches():
    state, _ = commanded([50e3] * 3)
    state = run(state, 0, 100)
    assert not state.vented
    state = run(state, 105, 105)
    assert state.cause == "command lost: last one 105 ms old"
    assert np.array_equal(state.setpoint_pa, COLD)
    state, refusal = commanded([50e3] * 3, 110, state)
    state = run(state, 110, 150)
    assert refusal is None
    assert state.vented
    assert np.array_equal(state.setpoint_pa, COLD)


def test_a_stream_of_nan_ends_in_a_vent():
    state, _ = commanded([30e3] * 3)
    for now in range(0, 200, 5):
        state, _ = offer(LIMITS, state, np.full(3, math.nan), now * MS, now * MS)
        state = cycle(LIMITS, state, COLD, True, now * MS)
    assert state.cause.startswith("command lost")
    assert state.rejected == {"not finite": 40}


def test_over_pressure_trips_after_its_time_and_burst_at_once():
    high = np.array([0.0, 101e3, 0.0])
    state = run(initial_state(3), 0, 20, reading=high)
    assert not state.vented
    state = run(state, 25, 25, reading=high)
    assert state.cause == "over-pressure: chamber 1 at 101.0 kPa"
    assert run(initial_state(3), 0, 0, reading=np.array([0.0, 0.0, 111e3])).vented


def test_a_short_spike_of_pressure_is_tolerated():
    state = run(initial_state(3), 0, 15, reading=np.full(3, 101e3))
    state = run(state, 20, 35, reading=np.full(3, 60e3))
    assert run(state, 40, 55, reading=np.full(3, 101e3)).cause is None


def test_lost_readings_and_nan_readings_trip():
    state = run(initial_state(3), 0, 5)
    assert run(state, 10, 60, fresh=False).cause.startswith("readings lost")
    assert (
        cycle(LIMITS, state, np.array([0, math.nan, 0]), True, 10 * MS).cause
        == "reading not finite: chamber 1"
    )


def test_a_fault_of_the_regulators_trips_and_the_first_cause_stays():
    state = cycle(LIMITS, initial_state(3), COLD, True, 0, fault="heartbeat_lost: node 2")
    assert request_vent(state, "something later").cause == "heartbeat_lost: node 2"


@pytest.mark.parametrize(
    ("found", "reason"),
    [
        ({"fault": "bus off"}, "bus off"),
        ({"fresh": False}, "readings lost: chamber 0 not fresh for 55 ms"),
        ({"reading_pa": np.array([0, math.nan, 0])}, "reading not finite: chamber 1"),
    ],
    ids=["fault", "silent", "no number"],
)
def test_a_fault_while_vented_on_request_is_told_and_keeps_the_latch_closed(found, reason):
    limiter = Limiter(LIMITS, [])
    limiter.state = request_vent(run(commanded([0.0] * 3)[0], 0, 5), "vent requested")
    assert run(limiter.state, 10, 500).complaint == "vent requested"
    for now in range(10, 120, 5):
        limiter.slew(now * MS)
        limiter.judge(**{"reading_pa": COLD, "fresh": True, "now_ns": now * MS} | found)
    assert limiter.state.complaint == f"vent requested; {reason}"
    assert limiter.reset(lambda: 120 * MS) == reason.replace("55", "110")
    # Over again, it stays in the complaint, as a trip does, until the reset.
    limiter.judge(COLD, True, 125 * MS)
    assert limiter.state.complaint == f"vent requested; {reason}"
    assert limiter.reset(lambda: 125 * MS) is None
    assert limiter.state.complaint is None


def test_an_infinite_reading_while_vented_on_request_is_told():
    """It is no pressure that has time to fall."""
    state = request_vent(run(commanded([0.0] * 3)[0], 0, 5), "vent requested")
    state = judge(LIMITS, state, np.array([0.0, 0.0, math.inf]), True, 10 * MS)
    assert "reading not finite: chamber 2" in state.complaint
    assert reset(LIMITS, state, 10 * MS)[1] is not None


def test_a_stop_while_vented_on_request_is_told():
    limiter = Limiter(LIMITS, ["a"])
    limiter.vent("vent requested")
    limiter.why_stopped = lambda: "stop pressed: panel says so"
    limiter.slew(5 * MS)
    assert limiter.state.complaint == "vent requested; stop pressed: panel says so"
    assert limiter.reset(lambda: 5 * MS) == "stop pressed: panel says so"


def test_what_follows_a_trip_is_not_added_to_its_cause():
    state = cycle(LIMITS, initial_state(3), COLD, True, 0, fault="heartbeat lost: node 2")
    state = cycle(LIMITS, state, COLD, False, 500 * MS, fault="bus off")
    assert state.complaint == "heartbeat lost: node 2"
    assert reset(LIMITS, state, 500 * MS)[1] == "bus off"


def test_reset_needs_a_zero_command_and_starts_afresh():
    state, _ = commanded([50e3] * 3)
    state = request_vent(run(state, 0, 5), "vent requested")
    state, _ = commanded([50e3] * 3, 10, state)
    state, refusal = reset(LIMITS, state, 15 * MS)
    assert refusal == "command still asks for pressure: the command must be zero"
    assert state.vented
    state, _ = commanded([0.0] * 3, 20, state)
    state, refusal = reset(LIMITS, state, 25 * MS)
    assert refusal is None
    assert not state.vented
    assert np.array_equal(state.setpoint_pa, COLD)


def test_reset_right_after_a_vent_is_refused_while_somebody_asks_for_pressure():
    state, _ = commanded([80e3] * 3)
    state = request_vent(run(state, 0, 5), "vent requested")
    state, refusal = reset(LIMITS, state, 10 * MS)
    assert refusal == "command still asks for pressure: the command must be zero"
    assert state.vented


@pytest.mark.parametrize("silence_ms", [120, 60_000])
def test_reset_is_refused_when_the_last_command_asked_for_pressure_however_old_it_is(silence_ms):
    """The laptop of a controller freezes, somebody resets, the laptop wakes up; or a source is too slow."""
    state, _ = commanded([30e3] * 3)
    state = run(state, 0, 110)
    assert state.cause == "command lost: last one 105 ms old"
    state, refusal = reset(LIMITS, state, silence_ms * MS)
    assert refusal == "command asked last for pressure: the command must be zero"
    assert state.vented
    state, _ = commanded([0.0] * 3, silence_ms, state)
    state, refusal = reset(LIMITS, state, (silence_ms + 1) * MS)
    assert refusal is None


def test_a_zero_command_that_was_long_ago_opens_and_is_not_lost():
    state = request_vent(commanded([0.0] * 3)[0], "vent requested")
    state, refusal = reset(LIMITS, state, 5000 * MS)
    assert refusal is None
    assert not run(state, 5000, 6000).vented


def test_after_a_reset_a_second_source_is_still_the_second():
    state = request_vent(commanded([0.0] * 3, 0, None, "A")[0], "vent requested")
    assert commanded([60e3] * 3, 1, state, "B")[1] == "second source: B while A is live"
    state, refusal = reset(LIMITS, state, 2 * MS)
    assert refusal is None
    assert commanded([60e3] * 3, 3, state, "B")[1] == "second source: B while A is live"
    assert commanded([60e3] * 3, 3, state, "A")[1] is None


def test_after_a_reset_a_command_from_before_it_is_out_of_order():
    state, _ = commanded([50e3] * 3, 0)
    state, _ = commanded([0.0] * 3, 40, request_vent(state, "vent requested"))
    state, refusal = reset(LIMITS, state, 60 * MS)
    assert refusal is None
    late = offer(LIMITS, state, np.full(3, 50e3), 10 * MS, 61 * MS)
    assert late[1] == "out of order: not newer than the last command"


@settings(max_examples=200, deadline=None, derandomize=True)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["command", "cycle", "vent", "reset"]),
            st.sampled_from(["A", "B"]),
            st.sampled_from([0.0, 30e3]),
            st.integers(0, 150),  # time since the last event [ms]
            st.integers(0, 80),  # age of the stamp [ms]
        ),
        max_size=40,
    )
)
def test_a_latch_opens_only_after_a_zero_command_and_to_what_is_newer_than_it(events):
    """Whatever comes in whatever order, from two sources."""
    state, now, zero_ns = initial_state(3), 0, {}
    accepted = np.zeros(3)
    for what, source, level, wait, age in events:
        now += wait * MS
        if what == "command":
            stamp = now - age * MS
            state, refusal = offer(LIMITS, state, np.full(3, level), stamp, now, source)
            if refusal is None:
                accepted = np.full(3, level)
                assert stamp > zero_ns.get(source, -math.inf), "from before the zero that opened the latch"
                zero_ns.pop(source, None)
        elif what == "cycle":
            state = cycle(LIMITS, state, COLD, True, now)
        elif what == "vent":
            state = request_vent(state, "vent requested")
        elif state.vented:
            state, refusal = reset(LIMITS, state, now)
            assert (refusal is None) == (not accepted.any())
            if refusal is None and state.command_source:
                zero_ns[state.command_source] = state.command_stamp_ns
                accepted = np.zeros(3)


def test_a_stamp_ahead_of_time_does_not_lengthen_the_watchdog():
    state, refusal = offer(LIMITS, initial_state(3), np.full(3, 50e3), 90 * MS, 0)
    assert refusal is None
    assert not run(state, 0, 100).vented
    assert run(state, 0, 105).cause == "command lost: last one 105 ms old"


def test_limits_that_contradict_each_other_are_refused():
    with refused("", names=("over_pressure_pa", "maximum_pa")):
        parse({"maximum_pa": 95e3, "over_pressure_pa": 94e3}, Limits, "f.yaml")
    with refused("", names=("burst_pressure_pa", "over_pressure_pa")):
        parse({"burst_pressure_pa": 50.0}, Limits, "f.yaml")


def test_reset_is_refused_while_the_pressure_is_high():
    state = run(initial_state(3), 0, 30, reading=np.full(3, 105e3))
    _, refusal = reset(LIMITS, state, 35 * MS)
    assert refusal == "a measured pressure is still above the limit"


def test_a_stall_of_the_loop_is_no_licence_to_jump():
    state, _ = commanded([90e3] * 3, 0)
    state = run(state, 0, 0)
    state, _ = commanded([90e3] * 3, 10_000, state)
    state = cycle(LIMITS, state, COLD, True, 10_000 * MS)
    assert np.all(state.setpoint_pa <= LIMITS.rise_pa_s * LIMITS.command_age_s)


@pytest.mark.parametrize("bad", [100e3, 120e3, math.nan, math.inf, -1.0])
def test_no_configuration_raises_the_hard_limit(bad):
    high = {"over_pressure_pa": 125e3, "burst_pressure_pa": 130e3}
    with refused("maximum_pa" if not bad >= 0 or bad == math.inf else "limits.maximum_pa", ANY):
        check_rating(parse({"maximum_pa": bad, **high}, Limits, "f.yaml"), Rating(), "f.yaml")


anything = st.floats(allow_nan=True, allow_infinity=True, width=64)
event = st.tuples(
    st.lists(anything, min_size=3, max_size=3),
    st.integers(-200, 200),  # age of the stamp [ms]
    st.integers(0, 30),  # time since the last event [ms]
    st.lists(st.one_of(st.floats(-5e3, 95e3), anything), min_size=3, max_size=3),
    st.lists(st.booleans(), min_size=3, max_size=3),
    st.one_of(st.none(), st.lists(anything, min_size=3, max_size=3)),
)


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(st.lists(event, max_size=40))
def test_any_sequence_stays_in_range_and_within_slew(events):
    state, now, last_cycle = initial_state(3), 0, None
    for command, age, wait, reading, fresh, supply in events:
        now += wait * MS
        state, _ = offer(LIMITS, state, np.array(command), now - age * MS, now)
        before = state
        given = None if supply is None else np.array(supply)
        state = cycle(LIMITS, state, np.array(reading), np.array(fresh), now, supply_pa=given)
        sent = state.setpoint_pa
        assert np.all(np.isfinite(sent))
        assert np.all((sent >= LIMITS.minimum_pa) & (sent <= LIMITS.maximum_pa))
        if before.vented:
            assert state.vented
        if state.vented:
            assert np.array_equal(sent, COLD)
        else:
            dt = 0.0 if last_cycle is None else (now - last_cycle) * 1e-9
            assert np.all(sent - before.setpoint_pa <= LIMITS.rise_pa_s * dt + 1e-6)
            assert np.all(before.setpoint_pa - sent <= LIMITS.fall_pa_s * dt + 1e-6)
        last_cycle = now


# After a vent ----------------------------------------------------------------------------------------


def vented(reading, at_ms=0):
    return run(
        request_vent(initial_state(3, ("a", "b", "c")), "asked"), at_ms, at_ms + 2000, np.array(reading)
    )


def test_every_chamber_that_is_not_empty_in_time_is_named_and_the_first_cause_stays():
    state = run(request_vent(initial_state(3, ("a", "b", "c")), "asked"), 0, 1995, np.full(3, 32.1e3))
    assert state.not_vented is None
    state = vented([32.1e3, 4.9e3, -6e3])
    said = "a still at 32.1 kPa, c still at -6.0 kPa 2.0 s after the vent: open the dump valve"
    assert state.not_vented == said
    assert (state.cause, state.complaint) == ("asked", f"asked; {said}")
    state = run(state, 2005, 2500, np.array([31e3, 0.0, 0.0]))
    assert state.not_vented == said, "said once"
    state = run(state, 2505, 2505, np.array([31e3, 9e3, 0.0]))
    assert state.not_vented == (
        "a still at 31.0 kPa, b still at 9.0 kPa 2.5 s after the vent: open the dump valve"
    )


def test_an_arm_that_was_found_full_stays_latched_until_it_is_seen_empty():
    assert reset(LIMITS, vented([4.9e3] * 3), 2001 * MS)[1] is None
    assert (
        reset(LIMITS, run(request_vent(initial_state(3), "asked"), 0, 500, np.full(3, 40e3)), 501 * MS)[1]
        is None
    )
    state = vented([40e3, 0.0, 0.0])
    state, refusal = reset(LIMITS, state, 2001 * MS)
    assert refusal == state.not_vented is not None
    assert state.vented
    state = run(state, 2005, 2100, np.zeros(3), fresh=np.array([False, True, True]))
    assert reset(LIMITS, state, 2101 * MS)[1] is not None, "no reading has shown it empty"
    state = run(state, 2105, 2105, np.array([4.5e3, 0.0, 0.0]))
    assert state.not_vented is not None, "within the noise of the limit"
    state = run(state, 2110, 2110, np.zeros(3))
    assert state.not_vented is None
    assert reset(LIMITS, state, 2111 * MS)[1] is None


@pytest.mark.parametrize("nothing", [math.nan, -math.inf, -125e3])
def test_a_reading_that_no_pressure_explains_does_not_count_as_pressure_nor_as_empty(nothing):
    assert vented([nothing, 0.0, 0.0]).not_vented is None
    state = run(vented([40e3, 0.0, 0.0]), 2005, 2100, np.array([nothing, 0.0, 0.0]))
    assert state.not_vented is not None
    assert vented([math.inf, 0.0, 0.0]).not_vented is not None


@pytest.mark.parametrize(
    ("key", "bad"),
    [("vent_limit_s", 11.0), ("vent_limit_s", math.inf), ("vented_pa", 21e3), ("vented_pa", 0.0)],
)
def test_no_configuration_switches_the_look_at_a_vent_off(key, bad):
    with refused(key, bad if math.isfinite(bad) else ANY):
        parse({key: bad}, Limits, "f.yaml")


# Regulators that are slower than the loop -----------------------------------------------------------


def test_readings_may_be_as_old_as_the_bus_makes_them():
    assert for_regulators(LIMITS, 200.0, 0.02, "fast").reading_age_s == LIMITS.reading_age_s
    assert for_regulators(LIMITS, 36.0, 0.21, "slow").reading_age_s == 0.21
    assert for_regulators(LIMITS, 5.0, 2.0, "slower").reading_age_s == 0.5, "no bus is allowed more"
    with refused("readings of a chamber a second", "3", ("4",)) as caught:
        for_regulators(LIMITS, 3.0, 0.1, "slowest")
    assert caught.value.where == "slowest"


def test_a_reading_is_carried_on_by_what_the_set_points_change():
    state, _ = commanded([50e3, 50e3, 0.0])
    late = Limits(reading_age_s=0.5, command_age_s=0.5)
    reading = np.array([1e3, 0.0, 0.0])
    state = cycle(late, state, reading, True, 0)
    assert np.array_equal(interpolated(state, reading, True), reading)
    fresh = np.array([False, True, False])
    for now in range(5, 105, 5):
        state = cycle(late, state, reading, fresh, now * MS)
    carried = interpolated(state, reading, fresh)
    expected = state.monitors.expected.pressure_pa
    assert expected[0] > 4e3
    assert carried[0] == pytest.approx(expected[0], abs=1e-9), "the first reading set the model"
    assert carried[1] == reading[1], "fresh"
    assert abs(carried[2]) < 1.0, "nothing was asked of it"
    vented = request_vent(state, "asked")
    assert np.array_equal(interpolated(vented, reading, fresh), reading)


def test_a_wrong_reading_is_carried_on_with_its_error():
    """What is carried on is the reading, not the model: an offset stays in it."""
    state, _ = commanded([20e3, 20e3, 20e3])
    late = Limits(reading_age_s=0.5, command_age_s=0.5)
    for now in range(0, 200, 5):
        reading = state.monitors.expected.pressure_pa + 3e3
        state = cycle(late, state, reading, True, now * MS)
    assert interpolated(state, reading, False) == pytest.approx(
        state.monitors.expected.pressure_pa + state.monitors.residual_pa
    )
    assert np.all(state.monitors.residual_pa > 1e3)


def test_a_narrower_range_is_reached_without_a_step_and_keeps_the_arm_in_control():
    limiter, found, reading = Limiter(LIMITS, ("a", "b", "c")), [], np.zeros(3)
    for now in range(0, 1000, 5):
        if now == 500:
            limiter.narrow(narrowed(LIMITS, with_changes(LIMITS, maximum_pa=20e3), "test"))
        assert limiter.offer(np.array([60e3, 60e3, 10e3]), now * MS, now * MS) is None
        found.append(limiter.slew(now * MS))
        reading = follow(reading, found[-1], 5e-3, TYPICAL.tau_s)
        limiter.judge(reading, True, now * MS)
    assert limiter.cause is None
    assert found[99].tolist() == [60e3, 60e3, 10e3]
    assert found[-1].tolist() == [20e3, 20e3, 10e3]
    assert np.abs(np.diff(found, axis=0)).max() <= LIMITS.fall_pa_s * 5e-3 * (1 + 1e-9)
    assert found[100][0] == pytest.approx(60e3 - LIMITS.fall_pa_s * 5e-3)


def test_a_narrower_range_below_zero_is_reached_without_a_step():
    low = with_changes(LIMITS, minimum_pa=-50e3)
    limiter, found = Limiter(low, ("a",)), []
    for now in range(0, 1000, 5):
        if now == 500:
            limiter.narrow(narrowed(low, LIMITS, "test"))
        assert limiter.offer(np.array([-40e3]), now * MS, now * MS) is None
        found.append(limiter.slew(now * MS)[0])
    assert found[99] == -40e3
    assert found[100] == pytest.approx(-40e3 + LIMITS.rise_pa_s * 5e-3)
    assert found[-1] == 0.0


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("maximum_pa", 95e3),
        ("minimum_pa", -1.0),
        ("rise_pa_s", 3e5),
        ("command_age_s", 0.05),
        ("vented_pa", 6e3),
    ],
)
def test_limits_that_are_wider_or_of_a_trip_wait_for_the_next_configure(key, value):
    with fails(ConfigError, "next configure", key=f"limits.{key}"):
        narrowed(LIMITS, with_changes(LIMITS, **{key: value}), "test")
