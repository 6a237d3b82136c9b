"""CANopen devices without a watchdog: told when configured, vented as soon as they are reached again."""

import shutil
import time

import can
import pytest
from hardware_bench import Bench, codes
from test_canopen_mapping import analog, four

from soro_core.config import config_folder
from soro_core.errors import HardwareError
from soro_hardware.canopen import frames
from soro_hardware.canopen.boot import startup
from soro_hardware.canopen.driver import CanopenRegulator
from soro_hardware.emulation.faults.fault_types import read_injection
from tests.refused import fails


class Cable:
    """An adapter that can be pulled, and a clock that can be put forward."""

    def __init__(self, platform, monkeypatch):
        self.bench, self.late_s, self.is_in = Bench(platform), 0.0, True
        send = self.bench.bus.send
        monkeypatch.setattr(self.bench.bus, "send", lambda *message: self._require() or send(*message))
        self.bench.driver = CanopenRegulator(
            platform, self._open, lambda: time.monotonic() + self.late_s, lockstep=True
        )
        self.bench.driver.configure()

    def _open(self):
        if not self.is_in:
            raise HardwareError("unplugged", code="open")
        return self.bench.bus

    def _require(self):
        if not self.is_in:
            raise can.CanOperationError("unplugged")

    def pull(self):
        """Take it out: the next exchange fails, and nothing goes out."""
        self.is_in = False
        with fails(HardwareError, "unplugged", code="gone"):
            self.bench.exchange(50e3)

    def plug_in(self):
        """Put it in again, when the driver is about to try."""
        self.is_in = True
        self.late_s += 1.0
        self.bench.bus.take_log()


def test_a_coupler_without_watchdog_gets_zeros_as_soon_as_it_is_reached_again(monkeypatch):
    """Nobody else vents it: it has held its pressure while the adapter was out."""
    cable = Cable(analog(), monkeypatch)
    bench = cable.bench
    bench.run(100, 50e3)
    cable.pull()
    for _ in range(60):
        bench.send(frames.SYNC)  # of whoever else is on the bus: time goes by
    assert bench.world.pressure_pa.min() > 45e3
    cable.plug_in()
    result = bench.exchange(50e3)
    assert bench.bus.take_log()[:2] == ["> 201 [8] 64 00 64 00 64 00 64 00", "> 080 [0]"]
    assert codes(result) == {("connection_lost", "bus")}
    assert not result.sent_pa.any()
    assert codes(bench.run(100, 50e3)) == {("connection_lost", "bus")}
    assert bench.world.pressure_pa.max() < 2.5e3


def test_devices_with_a_watchdog_are_left_alone_until_they_are_configured(monkeypatch):
    cable = Cable(four(), monkeypatch)
    cable.bench.run(100, 50e3)
    cable.pull()
    cable.plug_in()
    assert codes(cable.bench.run(3, 50e3)) == {("connection_lost", "bus")}
    assert cable.bench.bus.take_log() == []


def test_configuring_warns_once_of_devices_that_nothing_vents(caplog, tmp_path):
    """Of each kind of device, in a process: a mapping of its own is a kind that no other test has."""
    own = str(shutil.copy(config_folder() / "canopen" / "aventics_aes.yaml", tmp_path))
    for arm in (four(), analog(device=own), analog(device=own)):
        Bench(arm).driver.configure()
    assert [record.getMessage() for record in caplog.records] == [
        f"canopen: {own}: the EDS names no watchdog, so nothing vents these devices when the driver "
        "dies: a normally open dump valve is needed"
    ]


def test_a_start_up_without_adapter_does_not_end_the_vent(monkeypatch):
    """As after a reset that was refused: it is opened again, and the coupler gets its zeros."""
    cable = Cable(analog(), monkeypatch)
    cable.bench.run(100, 50e3)
    cable.pull()
    with fails(HardwareError, "unplugged", code="open"):
        cable.bench.driver.configure()
    cable.plug_in()
    cable.bench.driver.vent()
    assert "> 201 [8] 64 00 64 00 64 00 64 00" in cable.bench.bus.take_log()


def test_the_zero_of_a_coupler_is_known_before_its_start_up_has_got_far(monkeypatch):
    """0 Pa are 100 counts there, and 0 counts less than that."""
    cable = Cable(analog(), monkeypatch)
    bench = cable.bench
    monkeypatch.setattr(
        startup, "wait_for_boot", lambda *_: (_ for _ in ()).throw(HardwareError("silent", code="silent"))
    )
    with fails(HardwareError, "silent", code="silent"):
        bench.driver.configure()
    bench.bus.take_log()
    bench.driver.vent()
    assert "> 201 [8] 64 00 64 00 64 00 64 00" in bench.bus.take_log()


@pytest.mark.parametrize("is_stuck", [False, True])
def test_a_coupler_without_watchdog_is_called_empty_only_when_it_was_seen_so(is_stuck, caplog):
    bench = Bench(analog())
    bench.driver.configure()
    bench.run(100, 50e3)
    if is_stuck:
        bench.world.faults.add(read_injection("fault: stuck_at, pressure_pa: 30e3, chamber: link0/chamber1"))
    caplog.clear()
    bench.driver.close()
    assert ("has not seen the arm empty: open the dump valve" in caplog.text) is is_stuck


def test_a_coupler_without_watchdog_gets_zeros_at_the_end_of_a_bus_that_came_back(monkeypatch, caplog):
    cable = Cable(analog(), monkeypatch)
    cable.bench.run(100, 50e3)
    cable.pull()
    cable.plug_in()
    cable.bench.exchange(50e3)
    cable.bench.bus.take_log()
    cable.bench.driver.close()
    assert "> 201 [8] 64 00 64 00 64 00 64 00" in cable.bench.bus.take_log()
    assert "has not seen the arm empty" in caplog.text
