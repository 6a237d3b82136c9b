"""Latency of the loop against the emulated valves' own dead time of 5 ms and lag of 52 ms."""

import json

import numpy as np
import pytest
from hil_bench import NAMES, OnAir, OnCan, platform

from soro_core.errors import ConfigError, HardwareError
from soro_core.pneumatics import RegulatorModel
from soro_hardware.emulation.faults.fault_types import read_injection
from soro_hardware.hil import latency, report
from soro_hardware.hil.latency import LatencyConfig, compare, evaluate
from soro_hardware.hil.latency_run import latency_limits, measure
from soro_hardware.hil.paced import CycleSample, PacedRegulator
from tests.refused import fails

CONFIG = LatencyConfig(repeat=6, hold_s=0.4)


def guarded(driver, config=CONFIG):
    driver.configure()
    limits = latency_limits(platform(), config)
    return PacedRegulator(platform(), driver, limits, lockstep=True)


@pytest.fixture(scope="module")
def on_can():
    loop = guarded(OnCan(platform()).driver)
    runs = measure(CONFIG, loop)
    return runs, evaluate(CONFIG, NAMES, 200.0, runs)


@pytest.mark.slow
def test_dead_time_and_lag_are_those_of_the_emulated_valves(on_can, figure):
    _, found = on_can
    for chamber in found.chambers:
        figure(
            f"latency: {chamber.name} dead {chamber.dead_s * 1e3:.2f} ms, lag {chamber.lag_s * 1e3:.2f} ms"
        )
        assert chamber.steps == 12
        assert chamber.waited.max_s == 0.0, "a command is sent with the exchange that follows it"
        assert chamber.dead_s == pytest.approx(0.005, abs=0.0015)
        assert chamber.lag_s == pytest.approx(0.052, rel=0.06)
        # The play of 900 Pa is missing from a step of 4 kPa.
        assert chamber.gain == pytest.approx(3100 / 4000, abs=0.03)
        assert 0.010 <= chamber.moved.p50_s <= 0.020
        assert chamber.t63_up_s == pytest.approx(0.0575, abs=0.0076)
        assert chamber.t63_down_s == pytest.approx(0.0575, abs=0.0076)
    assert all(finding.level == "ok" for finding in compare(found, platform().regulator, 200.0))


def test_steps_are_small_one_at_a_time_and_within_one_cycle(on_can):
    runs, _ = on_can
    sent = np.array([sample.sent_pa for samples in runs for sample in samples])
    assert (np.count_nonzero(sent, axis=1) <= 1).all()
    assert sent.max() == CONFIG.low_pa + CONFIG.step_pa
    assert np.abs(np.diff(sent, axis=0)).max() <= 1.01 * CONFIG.step_pa
    for chamber in range(3):
        up = (sent[:-1, chamber] == 5e3) & (sent[1:, chamber] == 9e3)
        assert up.sum() == CONFIG.repeat
    assert not sent[-1].any()


def test_a_model_that_is_wrong_is_told(on_can):
    _, found = on_can
    slower = compare(found, RegulatorModel(delay_s=0.005, tau_s=0.1), 200.0)
    assert [finding.level for finding in slower] == ["warn"] * 3
    assert "lag 5" in slower[0].found
    later = compare(found, RegulatorModel(delay_s=0.05, tau_s=0.052), 200.0)
    assert [finding.level for finding in later] == ["warn"] * 3


def test_the_delay_of_a_slow_line_is_none_of_its_valves():
    times, none = latency.Times(0.045, 0.050, 0.055), np.zeros(1)
    chamber = latency.ChamberLatency("a", 9, times, times, 0.085, 0.085, 0.029, 0.052, 1.0, none, none)
    found = latency.Latency(200.0, times, (chamber,))
    model = RegulatorModel(delay_s=0.005, tau_s=0.052)
    assert [f.level for hz in (200.0, 36.0) for f in compare(found, model, hz)] == ["warn", "ok"]


def risen(t):
    """Part of a step [1] that a pressure has done at a time [s] after it."""
    return 1 - np.exp(-max(t - 0.005, 0) / 0.052) if t >= 0 else 0.0


def sample(n, sent_pa, pressure_pa, took_s=0.0):
    sent, fresh = np.array([sent_pa]), np.ones(1, dtype=bool)
    return CycleSample(0.005 * n, sent, sent, np.array([pressure_pa]), fresh, took_s)


def test_the_time_that_an_exchange_takes_counts():
    for took_s in (0.0, 0.003):
        runs = [
            [
                sample(n, 9e3 if n >= 20 else 5e3, 5e3 + 4e3 * risen(0.005 * (n - 20)), took_s)
                for n in range(120)
            ]
        ]
        (chamber,) = evaluate(LatencyConfig(hold_s=0.5), NAMES[:1], 200.0, runs).chambers
        assert chamber.dead_s == pytest.approx(0.005 + took_s, abs=1e-5)
        assert chamber.lag_s == pytest.approx(0.052, rel=1e-3)


def test_what_the_limiter_does_not_allow_is_refused():
    with fails(ConfigError, "9901 Pa"):
        latency_limits(platform(), LatencyConfig(step_pa=12e3))
    with fails(ConfigError, "90000 Pa"):
        latency_limits(platform(), LatencyConfig(low_pa=88e3))


def test_a_step_that_takes_two_cycles_begins_with_the_first_of_them():
    """Of both directions; what ends between the levels, at rest, is no step."""
    samples = []
    for n in range(440):
        sent = 9e3 if 20 < n < 140 or 240 <= n < 340 else 5e3 if n < 340 else 0.0
        sent = 7e3 if n in (20, 140) else sent  # the third step and the fall to rest take one cycle
        done = risen(0.005 * (n - 20)) - risen(0.005 * (n - 140)) + risen(0.005 * (n - 240))
        samples.append(sample(n, sent, 5e3 + 4e3 * done if n < 340 else 0.0))
    (chamber,) = evaluate(LatencyConfig(hold_s=0.5), NAMES[:1], 200.0, [samples]).chambers
    assert chamber.steps == 3
    # Half a second after a step the lag has left 1e-4 of it.
    assert chamber.dead_s == pytest.approx(0.005, abs=1e-4)
    assert chamber.lag_s == pytest.approx(0.052, rel=1e-2)
    assert [chamber.t63_up_s, chamber.t63_down_s] == pytest.approx([0.06, 0.06]), "seen in the next cycle"


def test_a_trip_or_an_interrupt_ends_it_vented():
    devices = OnAir(platform())
    devices.faults.add(read_injection("fault: stuck_open, chamber: link0/chamber0, at: 1"))
    with fails(HardwareError, "over-pressure: link0/chamber0", code="vented"):
        measure(CONFIG, guarded(devices))
    devices = OnAir(platform())
    loop = guarded(devices)
    left = iter(range(300))
    with fails(HardwareError, "interrupted", code="vented"):
        measure(CONFIG, loop, lambda: next(left, None) is None)
    assert devices.vents == 1, "at once, past the slew and before the next exchange"
    for _ in range(60):
        assert not loop.cycle(np.full(3, 9e3)).sent_pa.any()
    assert devices.pressure_pa.max() < 1e3


def test_the_report(on_can, tmp_path):
    _, found = on_can
    text = report.latency_markdown(
        "Latency", {"device": "here"}, found, compare(found, RegulatorModel(), 200.0)
    )
    assert text.count("| link0/chamber") == 6
    read = json.loads(report.latency_json({"device": "here"}, found))
    assert [chamber["name"] for chamber in read["chambers"]] == list(NAMES)
    report.draw_latency(tmp_path / "report.png", "Latency", found)
    assert (tmp_path / "report.png").stat().st_size > 20_000
