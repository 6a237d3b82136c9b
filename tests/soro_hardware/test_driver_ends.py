"""The end of a driver: what got pressure is not called empty, the ramp is kept, the wait is bounded."""

import numpy as np
import pytest
from hardware_bench import Bench
from rest_bench import FAMILIES
from test_canopen_mapping import analog
from test_canopen_unwatched import Cable
from test_veab_ports import Timed

from soro_core.errors import HardwareError
from soro_hardware.canopen.driver import CanopenRegulator
from soro_hardware.transport.frame import Frame
from soro_hardware.transport.link import CanLink
from tests.refused import fails

PERIOD_NS = 5_000_000


@pytest.mark.parametrize("family", ["veab_tcp", "vtem_modbus"])
def test_an_arm_that_got_pressure_as_the_connection_was_lost_is_not_called_empty(family, monkeypatch):
    rig = FAMILIES[family](0.0)
    rig.configure()
    for _ in range(40):
        rig.exchange(0.0)
    assert rig.driver.seen_empty
    line = rig.devices.lines[0]
    feed = line.feed

    def last(data):
        feed(data)
        line.output.clear()
        rig.unplug()

    monkeypatch.setattr(line, "feed", last)
    assert "link_lost" in {fault.code for fault in rig.exchange(30e3).faults}
    assert not rig.driver.seen_empty
    rig.driver.close()
    assert rig.told.dismissed is False


def test_couplers_that_got_pressure_as_the_bus_was_lost_are_not_called_empty(monkeypatch, caplog):
    cable = Cable(analog(), monkeypatch)
    cable.bench.run(40, 0.0)
    assert cable.bench.driver.seen_empty
    waiting = iter([None])

    def receive(link, timeout_s):
        try:
            return next(waiting)
        except StopIteration:
            cable.is_in = False
            raise HardwareError("unplugged", code="gone") from None

    with monkeypatch.context() as pulled, fails(HardwareError, code="gone"):
        pulled.setattr(CanLink, "receive", receive)
        cable.bench.exchange(50e3)
    cable.bench.driver.close()
    assert "has not seen the arm empty: open the dump valve" in caplog.text


def test_an_orderly_end_of_a_server_that_is_kept_alive_is_a_ramp():
    timed = Timed(4, 4)
    timed.driver.configure()
    for n in range(100):
        timed.driver.exchange(np.full(3, 60e3), n * PERIOD_NS)
    timed.link.log.clear()
    timed.driver.close()
    sent = [np.frombuffer(data, "<f8")[0] for mark, data in timed.link.log if mark == ">"]
    platform = timed.driver.platform
    fall = platform.shutdown_ramp_pa_s / platform.cycle_hz / 200e3
    assert np.abs(np.diff([0.8, *sent])).max() <= fall + 1e-9
    assert timed.driver.latched == ()
    assert timed.devices.ended is not None


def test_readings_that_become_invalid_in_a_pause_of_the_start_up_are_told(monkeypatch):
    """No cycle has latched them yet."""
    timed = Timed(4, 4)
    wait, count = timed.driver.wait, iter(range(1000))

    def disturbed(duration_s):
        wait(duration_s)
        if next(count) == 8:
            timed.devices.line.put(b"\x40")
            wait(0.05)

    monkeypatch.setattr(timed.driver, "wait", disturbed)
    with fails(HardwareError, code="gone", step="start-up"):
        timed.driver.configure()
    timed.driver.close()


@pytest.mark.timeout(60)
def test_frames_of_others_do_not_lengthen_a_pause_of_the_end(monkeypatch):
    now_s = iter(np.arange(0.0, 100.0, 1e-3)).__next__
    bench = Bench(analog())
    driver = CanopenRegulator(bench.platform, lambda: bench.bus, clock=now_s)
    taken = []

    def receive(link, timeout_s):
        taken.append(timeout_s)
        assert len(taken) < 100
        return Frame(0x7FF, b"x")

    monkeypatch.setattr(CanLink, "receive", receive)
    driver.wait(0.02)
    assert taken
