"""The first pressurisation: a healthy platform passes, and every fault is found and named."""

import itertools
import json

import numpy as np
import pytest
from hil_bench import CONFIG, NAMES, OnAir, Pressurised, failed, platform
from hypothesis import given, settings
from hypothesis import strategies as st

from soro_core.errors import ConfigError
from soro_core.pneumatics import RegulatorModel
from soro_core.robot import load_robot
from soro_hardware.emulation.faults.fault_types import read_injection
from soro_hardware.hil import report
from soro_hardware.hil.first_pressure import advance
from soro_hardware.hil.judge import Expectation, judge_holds
from soro_hardware.hil.measured import PressureHold
from soro_hardware.hil.paced import CycleSample, PacedRegulator, small_limits
from soro_hardware.hil.plan import FirstPressureConfig, HilPlan, ProcedureState
from soro_hardware.hil.pressurise import expectation
from tests.refused import fails

TOP_PA = CONFIG.steps_pa[-1]


@pytest.fixture(scope="module")
def healthy():
    rig = Pressurised(arm=True, can=True)
    return rig, rig.run()


def test_a_healthy_platform_passes(healthy):
    _, state = healthy
    assert failed(state) == {}
    assert all(finding.level == "ok" for finding in state.findings)
    assert [(hold.chamber, hold.setpoint_pa) for hold in state.holds] == [
        (n, p) for n in range(3) for p in CONFIG.steps_pa
    ]
    assert [vent.chamber for vent in state.vents] == [0, 1, 2]
    for hold in state.holds:
        # The play of the emulated valves: half its width below the set point.
        assert hold.level_pa[hold.chamber] == pytest.approx(hold.setpoint_pa - 450.0, abs=60.0)


def test_one_chamber_at_a_time_in_small_steps_within_slew(healthy):
    rig, _ = healthy
    sent = np.array([sample.sent_pa for sample in rig.samples])
    assert (np.count_nonzero(sent, axis=1) <= 1).all()
    assert sent.max() == TOP_PA
    assert np.diff(sent, axis=0).max() <= CONFIG.rise_pa_s * rig.limited.period_s + 1e-6
    assert np.array(rig.true_pa).max() < TOP_PA
    assert rig.true_pa[-1].max() < 1e3


@pytest.mark.parametrize(
    ("fault", "where", "says"),
    [
        ("stuck_closed", "link0/chamber1: rises", "does not rise: reads"),
        ("burst", "link0/chamber1: rises", "does not rise: reads"),
        ("kinked_line", "link0/chamber1: rises", "slow: reads"),
        ("slow_valve", "link0/chamber1: rises", "slow: reads"),
        ("slow_valve, factor: 7", "link0/chamber1: speed", "slow: 63 %"),
        ("leak", "link0/chamber1: level", "low: 17.7"),
        ("sensor_scale", "link0/chamber1: level", "high: 6.8"),
        ("vent_blocked", "link0/chamber1: vent", "link0/chamber1 keeps 19."),
        ("sensor_offset", "offset of link0/chamber1", "+15.0"),
        ("sensor_offset, offset_pa: 6e3", "offset of link0/chamber1", "+6.0"),
        ("sensor_stuck", "link0/chamber1: limiter", "vented: frozen sensor: link0/chamber1"),
        ("sensor_open_circuit", "at rest: limiter", "vented: open circuit: link0/chamber1"),
        ("stuck_open", "at rest: limiter", "vented: over-pressure: link0/chamber1"),
        ("stuck_at", "offset of link0/chamber1", " kPa at rest, noise"),
    ],
)
def test_a_fault_is_found_and_named(fault, where, says):
    rig = Pressurised(fault=f"fault: {fault}, chamber: link0/chamber1")
    state = rig.run()
    found = failed(state)
    assert says in found[where], found
    assert not any(name.startswith(("link0/chamber0", "link0/chamber2")) for name in found), found
    assert all(finding.do for finding in state.findings if finding.level == "fail")
    sent = np.array([sample.sent_pa for sample in rig.samples])
    healthy_hold_ends = [sample.t_s for sample in rig.samples if sample.sent_pa[1] == TOP_PA]
    if where.endswith(("rises", "speed")):
        assert not healthy_hold_ends  # the first step that failed was the chamber's last
        assert sent[:, 2].max() == TOP_PA  # and the others were examined all the same
    assert not rig.samples[-1].sent_pa.any()


def test_a_leak_behind_a_closed_valve_is_a_drift():
    rig = Pressurised(FirstPressureConfig(steps_pa=(TOP_PA,), hold_s=1.5))

    def close(sample, record=rig.record):
        record(sample)
        if sample.sent_pa[1] == TOP_PA and not rig.devices.faults.is_active:
            for fault in ("stuck_closed", "leak, rate_1_s: 0.06"):
                rig.devices.faults.add(
                    read_injection(f"fault: {fault}, chamber: link0/chamber1, at: 0.3, duration_s: 3")
                )

    rig.record = close
    found = failed(rig.run())
    assert found["link0/chamber1: leak"].startswith("leak: -1."), found
    assert set(found) <= {"link0/chamber1: leak", "link0/chamber1: vent", "not examined"}


def test_readings_of_swapped_sensors_are_named():
    found = failed(Pressurised(sensors=(0, 2, 1)).run())
    assert set(found) == {"link0/chamber1: rises", "link0/chamber2: rises"}
    assert "swapped: " in found["link0/chamber1: rises"]
    assert "link0/chamber2 +4.5" in found["link0/chamber1: rises"]


def test_lines_swapped_behind_the_valves_show_by_the_bending_alone():
    assert failed(Pressurised(wiring=(1, 0, 2)).run()) == {}
    found = failed(Pressurised(wiring=(1, 0, 2), arm=True).run())
    assert set(found) == {"bends"}
    assert "swapped: link0/chamber0 acts as link0/chamber1, link0/chamber1 acts as" in found["bends"]


def test_a_chamber_with_a_line_that_is_off_behind_its_sensor_is_named():
    found = failed(Pressurised(share=(1.0, 0.05, 1.0), arm=True).run())
    assert found["bends"].startswith("link0/chamber1 gives 0.")


def test_the_person_who_watches_is_asked_and_may_leave_a_chamber_out():
    answers = {"link0/chamber1": "n"}
    rig = Pressurised(confirm=True, answer=lambda q: answers.get(q.split()[1], "y"))
    state = rig.run()
    assert len(rig.questions) == 3
    assert {hold.chamber for hold in state.holds} == {0, 2}
    assert [f.found for f in state.findings if f.name == "not examined"] == ["link0/chamber1: left out"]
    assert report.verdict(state.findings) == "INCOMPLETE"


def test_nothing_is_pressurised_before_the_answer():
    rig = Pressurised(confirm=True, answer=lambda q: None, stop_at=600)
    state = rig.run()
    assert not np.array([sample.sent_pa for sample in rig.samples]).any()
    assert rig.limited.cause == "interrupted"
    assert state.findings[-1].found == f"{', '.join(NAMES)}: interrupted"


def test_a_wrong_direction_seen_by_the_person_fails():
    rig = Pressurised(
        confirm=True,
        directions=("left", "right", "up"),
        answer=lambda q: "n" if "towards right" in q else "y",
    )
    found = failed(rig.run())
    assert list(found) == ["link0/chamber1: bends"]
    assert "right" in found["link0/chamber1: bends"]


@pytest.mark.parametrize("chamber", [0, 2])
def test_a_device_that_restarts_while_it_vents_ends_it(healthy, chamber):
    """In the last vent too, after which nothing is reset."""
    at_s = [vent.t_s for vent in cause_begins(healthy[0].samples)][chamber] + 0.1
    rig = Pressurised(can=True, fault=f"fault: reboot, chamber: link0/chamber1, at: {at_s}")
    state = rig.run()
    assert "rebooted: link0/chamber1" in failed(state)["devices: limiter"]
    assert not any(sample.sent_pa.any() for sample in rig.samples if sample.t_s > at_s)


def test_an_interrupt_vents_at_once():
    rig = Pressurised(stop_at=300)
    state = rig.run()
    assert rig.samples[-1].sent_pa.any()
    assert rig.devices.vents == 1
    # The chamber that was not taken to its end is named as well.
    assert state.findings[-1].found == f"{', '.join(NAMES)}: interrupted"
    for _ in range(60):
        rig.limited.cycle(np.full(3, TOP_PA))  # nothing gets past the latch
    assert rig.devices.pressure_pa.max() < 1e3


def cause_begins(samples):
    return [b for a, b in itertools.pairwise(samples) if a.cause is None and b.cause is not None]


def guarded():
    devices = OnAir(platform())
    limits = small_limits(platform(), 20e3, 50e3)
    return devices, PacedRegulator(platform(), devices, limits, lockstep=True)


def test_a_trip_vents_within_its_cycle():
    devices, loop = guarded()
    for _ in range(2):
        loop.cycle(np.full(3, 20e3))
    assert loop.cycle(np.full(3, 20e3)).sent_pa.any()
    devices.faults.add(read_injection("fault: sensor_open_circuit, chamber: link0/chamber2"))
    sample = loop.cycle(np.full(3, 20e3))
    assert sample.cause == "open circuit: link0/chamber2 reads -125.0 kPa"
    assert devices.vents == 1
    assert not loop.cycle(np.full(3, 20e3)).sent_pa.any()


def test_what_is_out_of_range_is_not_sent():
    _, loop = guarded()
    for wanted in (np.full(3, 20e3 + 1), np.array([1e3, np.nan, 0.0]), np.full(3, -1.0)):
        for _ in range(10):
            assert not loop.cycle(wanted).sent_pa.any()


def test_a_connection_that_breaks_is_a_trip():
    devices, loop = guarded()
    loop.cycle(np.zeros(3))
    devices.gone = True
    sample = loop.cycle(np.zeros(3))
    assert sample.cause == loop.cause == "the adapter is gone"
    assert np.isnan(sample.reading_pa).all()
    assert devices.vents == 1


def test_the_limits_end_above_the_highest_step_and_within_the_rating():
    limits = small_limits(platform(), 20e3, 50e3)
    assert (limits.maximum_pa, limits.over_pressure_pa, limits.burst_pressure_pa) == (20e3, 30e3, 40e3)
    near = small_limits(platform(), 90e3, 50e3)
    assert (near.over_pressure_pa, near.burst_pressure_pa) == (100e3, 110e3)
    with fails(ConfigError, "steps_pa"):
        expectation(platform(), 200.0, FirstPressureConfig(steps_pa=(5e3, 91e3)))
    with fails(ConfigError, "steps_pa", "higher"):
        FirstPressureConfig(steps_pa=(10e3, 5e3))


def test_a_sign_that_is_wrong_is_named():
    expected = Expectation(NAMES[:1], (5e3,), RegulatorModel(), 50e3, 0.005)
    hold = PressureHold(0, 5e3, np.array([-4.5e3]), 0.0, 1.0, 0.1, None)
    (finding,) = judge_holds(expected, [hold])
    assert finding.found.startswith("wrong sign: reads -4.50 kPa")


PLAN = HilPlan(
    CONFIG, Expectation(NAMES, CONFIG.steps_pa, RegulatorModel(), CONFIG.rise_pa_s, 0.005), confirm=False
)
READINGS = st.lists(st.sampled_from([0.0, 4.6e3, 9.6e3, 19.6e3, -5e3, np.nan]), min_size=3, max_size=3)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(READINGS, st.sampled_from([None] * 30 + ["leak: x"])), min_size=1, max_size=80))
def test_whatever_is_read_one_chamber_is_asked_for_at_most_and_none_after_a_trip(readings):
    state, tripped = ProcedureState(), False
    for n, (reading, cause) in enumerate(readings):
        sample = CycleSample(
            0.3 * n, np.zeros(3), np.zeros(3), np.array(reading), np.ones(3, dtype=bool), 0.0, cause
        )
        state, order = advance(PLAN, state, sample)
        tripped = tripped or cause is not None
        assert np.count_nonzero(order.setpoint_pa) <= 1
        assert 0.0 <= order.setpoint_pa.min() <= order.setpoint_pa.max() <= TOP_PA
        if tripped and state.phase == "done":
            assert not order.setpoint_pa.any()


def test_the_report_has_every_line_and_is_read_back(healthy, tmp_path):
    rig, state = healthy
    text = report.markdown("First pressurisation", {"device": "here"}, rig.plan, state)
    assert "**passed**" in text
    assert text.count("| ok |") == len(state.findings)
    read = json.loads(report.first_pressure_json({"device": "here"}, rig.plan, state))
    assert read["passed"] is True
    assert len(read["holds"]) == 6
    report.draw_first_pressure(tmp_path / "report.png", "First pressurisation", rig.plan, rig.samples)
    assert (tmp_path / "report.png").stat().st_size > 20_000


def test_the_model_of_the_three_bellow_arm_says_where_each_chamber_bends_it():
    expected = expectation(platform(), 200.0, CONFIG, load_robot("config/robots/tue_three_bellow.yaml"))
    x = expected.bending.expected_m[:, -1]
    np.testing.assert_allclose(np.degrees(np.arctan2(x[:, 1], x[:, 0])) % 360, [180, 300, 60], atol=0.5)
    assert 0.012 < np.linalg.norm(x, axis=1).min() < np.linalg.norm(x, axis=1).max() < 0.017
    assert expected.bending.directions()[0] == "-x of the base frame (180 deg)"
