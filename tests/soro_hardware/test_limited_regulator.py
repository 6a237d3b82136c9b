"""A regulator behind the limiter: what the regulator node, `soro hil` and the fault matrix run."""

import time

import numpy as np
import pytest
from hardware_bench import platform

from soro_core import safety
from soro_hardware.canopen.driver import CanopenRegulator
from soro_hardware.emulation.faults.fault_types import read_injection
from soro_hardware.limited_regulator import LimitedRegulator
from soro_hardware.port import Exchange
from tests.soro_hardware.hub_bus import HubBus


class Guarded:
    """Emulated CANopen valves behind the limiter, in lockstep."""

    def __init__(self, **limits) -> None:
        self.platform = platform(canopen={"boot_timeout_s": 0.2})
        self.bus = HubBus(self.platform, seed=1)
        self.driver = CanopenRegulator(self.platform, lambda: self.bus, time.monotonic, lockstep=True)
        self.driver.configure()
        self.loop = LimitedRegulator(self.platform, self.driver, safety.Limits(**limits))
        self.now_ns = 0

    def run(self, seconds: float, command_pa: float) -> None:
        for _ in range(round(seconds * self.platform.cycle_hz)):
            self.loop.offer(np.full(3, command_pa), self.now_ns, self.now_ns)
            self.loop.cycle(self.now_ns)
            self.now_ns += round(1e9 / self.platform.cycle_hz)

    def reset(self) -> str | None:
        return self.loop.reset(lambda: self.now_ns)

    def inject(self, text: str) -> None:
        self.bus.world.faults.add(read_injection(f"fault: {text}"))


def test_a_reset_takes_devices_with_any_fault_through_their_start_up_or_says_why_not():
    """A silent one is no latched fault of the driver, and may have lost anything meanwhile."""
    it = Guarded()
    it.run(0.5, 40e3)
    it.inject("mute, chamber: link0/chamber1")
    it.run(0.03, 40e3)
    assert it.loop.cause.startswith("stale_reading: link0/chamber1")
    it.run(0.02, 0.0)  # shorter than the time after which its heartbeat is lost
    refusal = it.reset()
    assert refusal is not None
    assert "link0/chamber1 (node 2): boot: no answer" in refusal
    assert it.loop.state.vented
    it.bus.world.faults.clear()
    assert it.reset() is None
    it.run(0.5, 40e3)
    assert it.loop.cause is None
    np.testing.assert_allclose(it.bus.world.pressure_pa, 40e3, atol=2e3)


def test_a_pressed_stop_is_the_reason_of_a_refused_reset_before_the_devices_are():
    """The stop may have taken the power of the devices: their start-up would fail, and say that."""
    it = Guarded()
    it.run(0.3, 20e3)
    it.inject("reboot, chamber: link0/chamber1")
    it.run(0.05, 20e3)
    it.inject("mute, chamber: link0/chamber1")
    it.loop.why_stopped = lambda: "stop pressed: /safety/stop says so"
    it.run(0.1, 0.0)
    assert it.loop.cause.startswith("rebooted"), "the first cause stays"
    assert it.reset() == "stop pressed: /safety/stop says so"
    it.bus.world.faults.clear()
    it.loop.why_stopped = lambda: None
    assert it.reset() is None


def test_a_start_up_that_takes_long_loses_no_command():
    """Nobody could command while the reset waited for the devices."""
    it = Guarded()
    it.run(0.1, 0.0)
    it.inject("reboot, chamber: link0/chamber1")
    it.run(0.1, 0.0)
    assert "rebooted" in it.loop.cause
    configure = it.driver.configure

    def slowly() -> None:
        configure()
        it.now_ns += 2_000_000_000

    it.driver.configure = slowly
    assert it.reset() is None
    it.loop.cycle(it.now_ns)
    assert it.loop.cause is None


@pytest.mark.parametrize(
    ("fault", "at_kpa"),
    [
        ("", None),
        ("slow_valve, factor: 5", None),
        ("vent_blocked", 40.0),
        ("stuck_closed", 40.0),
        ("stuck_open", 150.0),
        ("kinked_line, factor: 100", 27.0),
    ],
)
def test_a_chamber_that_keeps_its_pressure_after_a_vent_is_named(fault, at_kpa):
    it = Guarded()
    it.run(0.5, 40e3)
    if fault:
        it.inject(f"{fault}, chamber: link0/chamber1")
    it.loop.vent("asked for")
    it.run(1.99, 0.0)
    assert it.loop.not_vented is None
    it.run(1.0, 0.0)
    assert it.loop.cause == "asked for", "the first cause stays"
    if at_kpa is None:
        assert it.loop.not_vented is None
        assert it.reset() is None
        return
    name, rest = it.loop.not_vented.split(" still at ")
    assert name == "link0/chamber1"
    assert float(rest.split(" kPa")[0]) == pytest.approx(at_kpa, abs=2.0)
    assert rest.endswith(" kPa 2.0 s after the vent: open the dump valve")
    assert it.loop.state.complaint == f"asked for; {it.loop.not_vented}"


def test_an_arm_that_was_found_full_is_reset_when_it_has_been_seen_empty():
    it = Guarded(vent_limit_s=0.5)
    it.run(0.5, 40e3)
    it.inject("vent_blocked, chamber: link0/chamber1")
    it.loop.vent("asked for")
    it.run(0.2, 0.0)
    assert it.reset() is None, "still on its way, for all that is known"
    it.loop.vent("asked for again")
    it.run(0.6, 0.0)
    assert it.reset() == it.loop.not_vented is not None
    assert it.loop.cause == "asked for again"
    it.bus.world.faults.clear()  # somebody has opened the dump valve
    it.run(0.3, 0.0)
    assert it.loop.not_vented is None
    assert it.reset() is None
    it.run(0.5, 40e3)
    assert it.loop.cause is None


def test_devices_that_keep_their_pressure_are_taken_through_their_start_up_before_the_latch_opens():
    """Some let it go by their start-up alone; but the arm is seen empty before it is commanded."""
    it = Guarded(vent_limit_s=0.5)
    it.run(0.5, 40e3)
    it.inject("setpoint_ignored, chamber: link0/chamber1")
    it.loop.vent("asked for")
    it.loop.lost = "chamber1: complained"
    it.run(0.6, 0.0)
    started = []
    configure = it.driver.configure
    it.driver.configure = lambda: started.append(configure())
    it.loop.offer(np.full(3, 40e3), it.now_ns, it.now_ns)
    assert "still asks for pressure" in it.reset()
    assert not started
    it.run(0.01, 0.0)
    assert it.reset() == it.loop.not_vented is not None
    assert len(started) == 1
    it.bus.world.faults.clear()
    it.run(0.3, 0.0)
    assert it.reset() is None
    assert len(started) == 1


def test_a_device_over_its_limit_is_taken_through_its_start_up_too():
    it = Guarded()
    it.run(0.5, 40e3)
    it.inject("stuck_open, supply_pa: 120e3, chamber: link0/chamber1")
    it.run(0.5, 0.0)
    assert it.loop.cause.startswith(("over-pressure", "implausible"))
    it.loop.lost = "chamber1: complained"
    started = []
    configure = it.driver.configure
    it.driver.configure = lambda: started.append(configure())
    assert it.reset() == "a measured pressure is still above the limit"
    assert len(started) == 1
    assert it.loop.cause is not None


def read(it: Guarded, seconds: float) -> list[np.ndarray | None]:
    """What is told of the pressures after each cycle, while 30 kPa are commanded."""
    told = []
    for _ in range(round(seconds * it.platform.cycle_hz)):
        it.loop.offer(np.full(3, 30e3), it.now_ns, it.now_ns)
        exchange = it.loop.cycle(it.now_ns)
        told.append(it.loop.readings_pa(exchange, it.now_ns))
        it.now_ns += round(1e9 / it.platform.cycle_hz)
    return told


def test_while_a_device_is_silent_the_readings_of_the_others_go_on():
    it = Guarded()
    assert all(np.isfinite(one).all() for one in read(it, 0.5)[5:])
    it.inject("mute, chamber: link0/chamber1")
    told = read(it, 1.0)
    begin = next(k for k, one in enumerate(told) if one is not None and np.isnan(one).any())
    assert begin / it.platform.cycle_hz == pytest.approx(it.loop.limits.reading_age_s, abs=0.02)
    assert all(one is None for one in told[1:begin]), "old readings are not told as new ones"
    assert it.loop.cause.startswith("stale_reading: link0/chamber1"), "the arm is vented before"
    known = np.array(told[begin:], dtype=float)
    assert np.isnan(known[:, 1]).all()
    assert np.isfinite(known[:, [0, 2]]).all()
    assert known[0, 0] > 5e3
    assert known[-1, [0, 2]] == pytest.approx(0.0, abs=1e3), "seen to become empty"
    it.bus.world.faults.clear()
    assert np.isfinite(read(it, 0.05)[-1]).all()


def test_where_no_device_answers_nothing_is_told_but_to_a_loop_that_needs_every_tick():
    it = Guarded()
    read(it, 0.1)
    for chamber in range(3):
        it.inject(f"mute, chamber: link0/chamber{chamber}")
    assert read(it, 0.3)[-1] is None
    exchange = it.loop.cycle(it.now_ns)
    assert np.isnan(it.loop.readings_pa(exchange, it.now_ns, every_cycle=True)).all()


@pytest.mark.parametrize("in_turn", [False, True])
def test_a_sensor_without_a_number_does_not_hide_the_others(in_turn):
    it = Guarded()
    read(it, 0.1)
    it.loop.in_turn = in_turn
    pressure, fresh = np.array([1e3, np.nan, 2e3]), np.array([True, True, not in_turn])
    it.driver.exchange = lambda sent, _: Exchange(sent, pressure, fresh)
    exchange = it.loop.cycle(it.now_ns)
    assert it.loop.cause.startswith("reading not finite: link0/chamber1")
    np.testing.assert_array_equal(it.loop.readings_pa(exchange, it.now_ns), pressure)
