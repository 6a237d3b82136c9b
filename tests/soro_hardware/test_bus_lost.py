"""A bus that is lost: when it is opened again, and that nothing is sent before `configure`."""

import errno
import time

import can
import numpy as np
import pytest
from hardware_bench import Bench, codes, platform

from soro_core.errors import HardwareError
from soro_hardware.transport.bus_watch import Reconnect
from soro_hardware.transport.frame import Frame
from soro_hardware.transport.link import CanLink
from tests.refused import fails


class Clock:
    """Time in the hands of a test."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def lost(monkeypatch):
    """A running arm whose bus can be made to fail, and its clock."""
    clock = Clock()
    bench = Bench(platform(), clock=clock)
    bench.driver.configure()
    bench.run(20, 20e3)
    monkeypatch.setattr(time, "sleep", lambda seconds: setattr(clock, "now", clock.now + seconds))
    return bench, clock


def go_off(bench, monkeypatch, off=True):
    state = can.BusState.ERROR if off else can.BusState.ACTIVE
    monkeypatch.setattr(type(bench.bus), "state", property(lambda self: state))


@pytest.mark.timeout(120)
def test_an_adapter_that_never_stops_giving_frames_is_given_up(lost, monkeypatch):
    """No bus carries so many; a server of frames, or a broken adapter, can."""
    bench, clock = lost
    with monkeypatch.context() as flood:
        flood.setattr(CanLink, "receive", lambda link, timeout_s: Frame(0x7FF, b"x"))
        bench.driver.vent()
        with fails(HardwareError, code="flood"):
            bench.exchange(20e3)
    clock.now += 20.0
    assert codes(bench.exchange(20e3)) == {("connection_lost", "bus")}


@pytest.mark.timeout(120)
def test_frames_of_others_without_end_do_not_lengthen_a_cycle_for_ever(monkeypatch):
    bench = Bench(platform(lockstep_timeout_s=0.1))
    bench.driver.configure()
    bench.run(20, 20e3)
    drained = iter([None])
    with monkeypatch.context() as flood:
        flood.setattr(CanLink, "receive", lambda link, timeout_s: next(drained, Frame(0x7FF, b"x")))
        assert not bench.exchange(20e3).fresh.any()


def test_bus_off_is_opened_again_after_half_a_second_and_stays_silent(lost, monkeypatch):
    bench, clock = lost
    go_off(bench, monkeypatch)
    assert codes(bench.exchange(20e3)) == {("bus_off", "bus")}
    go_off(bench, monkeypatch, off=False)
    link = bench.driver.link
    assert not link.is_open
    clock.now += 0.4
    bench.exchange(20e3)
    assert not link.is_open
    clock.now += 0.2
    bench.bus.take_log()
    assert codes(bench.exchange(20e3)) == {("bus_off", "bus")}
    assert link.is_open
    bench.driver.vent()
    assert bench.bus.take_log() == [], "vented by their own watchdogs; nothing is sent before configure"
    bench.driver.configure()
    assert bench.run(100, 20e3).faults == ()


def test_a_bus_that_stays_off_is_tried_seldom_and_leaves_a_try_to_the_user(lost, monkeypatch):
    bench, clock = lost
    go_off(bench, monkeypatch)
    opened = []
    link = bench.driver.link
    link.open_bus = lambda: opened.append(clock.now) or bench.bus
    for _ in range(500):
        clock.now += 0.1
        bench.exchange(20e3)
    assert len(opened) == 1, "off again at once: two times off within a minute"
    go_off(bench, monkeypatch, off=False)
    bench.driver.configure()
    assert bench.run(5, 20e3).faults == ()


def test_bus_off_three_times_a_minute_is_enough(lost, monkeypatch):
    bench, clock = lost
    for _ in range(3):
        bench.driver.configure()
        go_off(bench, monkeypatch)
        bench.exchange(20e3)
        go_off(bench, monkeypatch, off=False)
        clock.now += 1.0
    with fails(HardwareError, "57 s", device="bus", code="bus_off"):
        bench.driver.configure()
    clock.now += 58.0
    bench.driver.configure()
    assert bench.run(5, 20e3).faults == ()


def test_broken_connection_raises_comes_back_and_stays_latched(lost, monkeypatch):
    bench, clock = lost
    link, working = bench.driver.link, bench.driver.link.open_bus

    def gone():
        raise HardwareError("cannot open", "adapter", "open")

    def unplugged(timeout=None):
        raise OSError(errno.EIO, "unplugged")

    monkeypatch.setattr(bench.bus, "recv", unplugged)
    link.open_bus = gone
    for _ in range(3):
        with fails(HardwareError, "Input/output error", code="gone"):
            bench.exchange(20e3)
    monkeypatch.undo()
    attempts = []
    link.open_bus = lambda: attempts.append(clock.now) or gone()
    for _ in range(400):
        clock.now += 0.1
        with pytest.raises(HardwareError):
            bench.exchange(20e3)
    pauses = np.diff(attempts)
    assert len(attempts) < 12
    assert pauses.max() <= 10.2
    assert np.all(np.diff(pauses) > -0.15), "longer and longer"
    link.open_bus = working
    clock.now += 20.0
    bench.bus.take_log()
    result = bench.exchange(20e3)
    assert codes(result) == {("connection_lost", "bus")}
    assert not result.sent_pa.any()
    assert bench.bus.take_log() == []
    bench.driver.configure()
    assert bench.run(5, 20e3).faults == ()


def test_devices_without_a_watchdog_are_sent_zeros_as_soon_as_the_bus_is_back(monkeypatch):
    """They have held their pressure meanwhile: only the driver can vent them."""
    scaling = {"kind": "fixed", "setpoint": {"pa_per_count": 10.0}, "reading": {"pa_per_count": 10.0}}
    mapping = {"device": "aventics_aes", "scaling": scaling}
    valves = [{"chamber": f"link0/chamber{n}", "node": 1, "channel": n} for n in range(3)]
    clock = Clock()
    bench = Bench(platform(valves=valves, canopen={"mapping": mapping}), clock=clock)
    bench.driver.configure()
    bench.run(100, 50e3)
    go_off(bench, monkeypatch)
    assert codes(bench.exchange(50e3)) == {("bus_off", "bus")}
    assert bench.world.pressure_pa.min() > 49e3
    go_off(bench, monkeypatch, off=False)
    clock.now += 0.6
    for _ in range(60):
        assert codes(bench.exchange(50e3)) == {("bus_off", "bus")}
    assert bench.world.pressure_pa.max() < 5e3
    bench.driver.configure()
    assert bench.run(5, 20e3).faults == ()


def test_reconnect_pauses():
    policy = Reconnect()
    assert policy.wait_s(0.0) == 0.0
    pauses = []
    for _ in range(7):
        policy.broken(0.0)
        pauses.append(policy.wait_s(0.0))
    assert pauses == [0.5, 1.0, 2.0, 4.0, 8.0, 10.0, 10.0]
    policy.opened()
    policy.healthy()
    policy.broken(0.0)
    assert policy.wait_s(0.0) == 0.5
