"""The test of the watchdogs at each start: the host falls silent at 0 Pa, and something has to vent."""

import contextlib
import functools
import re

import pytest
from board_bench import board_platform
from hardware_bench import cycles_in_real_time, platform
from serial_bench import alicat, itv
from served_bench import served

from soro_core.config import with_changes
from soro_core.errors import HardwareError
from soro_hardware import driver, load_platform, open_regulator, supervisor_client
from soro_hardware.board.pi import core
from soro_hardware.emulation.canopen.node import EmulatedNode
from soro_hardware.emulation.faults.fault_types import read_injection
from tests.refused import fails

WATCHED = {"canopen": platform, "board": board_platform}
SUPERVISED = {
    "itv": itv,
    "alicat": alicat,
    "veab": lambda: load_platform("veab_tcp"),
    "vtem": lambda: load_platform("vtem_modbus"),
}
supervised = pytest.mark.parametrize("make", SUPERVISED.values(), ids=SUPERVISED)
# A process that gives its sign of life, and nothing else.
DEAF = """
import os, select, socket, struct, sys, time
control = socket.socket(fileno=0)
control.send(b"ready")
while True:
    os.pwrite(int(sys.argv[1]), struct.pack("d", time.monotonic()), 0)
    if select.select([control], [], [], 0.02)[0] and control.recv(1 << 20) in (b"", b"end", b"left"):
        break
"""


def changed_rules(rules, **values):
    """Rules of a board whose watchdog sleeps."""
    return rules(**{**values, "watchdog_ns": 10**12})


@contextlib.contextmanager
def opened(described):
    """A regulator on emulated devices in real time."""
    with served(described) as (devices, address):
        regulator = open_regulator(described, address)
        try:
            yield regulator, devices
        finally:
            regulator.close()


@pytest.mark.process
@supervised
def test_the_supervisor_vents_once_and_another_one_waits(make, monkeypatch, capfd):
    began = []

    class Noted(supervisor_client.Supervisor):
        def __init__(self):
            super().__init__()
            began.append(self)

    for module in (supervisor_client, driver):
        monkeypatch.setattr(module, "Supervisor", Noted)
    with opened(make()) as (regulator, _):
        regulator.configure()
        first, second = began
        assert first.process.poll() == 0, "every device has confirmed its vent"
        assert regulator.supervisor is second
        assert second.is_alive
        assert cycles_in_real_time(regulator, 0.1, [20e3] * 3)[-1].faults == ()
        regulator.configure()  # a reset does not repeat it
        assert began == [first, second]
    assert capfd.readouterr().err == ""


@pytest.mark.process
@supervised
def test_a_supervisor_that_does_not_vent_ends_the_start(make, monkeypatch, tmp_path):
    monkeypatch.setattr("soro_hardware.driver._TEST_S", 0.1)
    (tmp_path / "deaf.py").write_text(DEAF)
    monkeypatch.setattr(supervisor_client, "SCRIPT", tmp_path / "deaf.py")
    with opened(make()) as (regulator, _):
        expected = "test at 0 Pa: it has not vented 0.4 s after the last message"
        with fails(HardwareError, expected, device="supervisor", code="refused", step="start-up"):
            regulator.configure()
    with opened(with_changes(make(), watchdog_test=False)) as (regulator, _):
        regulator.configure()


@pytest.mark.process
@pytest.mark.parametrize("make", WATCHED.values(), ids=WATCHED)
def test_devices_fall_back_once_and_start_again(make):
    with opened(make()) as (regulator, _):
        regulator.configure()
        found = regulator.statistics
        assert cycles_in_real_time(regulator, 0.1, [20e3] * regulator.n_chambers)[-1].faults == ()
        regulator.configure()
        assert regulator.statistics.emergencies == found.emergencies, "a reset does not repeat it"
    assert (found.emergencies > 0) == (regulator.kind != "board")


def test_a_node_that_does_not_watch_its_host_ends_the_start(monkeypatch):
    monkeypatch.setattr("soro_hardware.canopen.driver._TEST_S", 0.1)
    monkeypatch.setattr(EmulatedNode, "_stand", lambda self, code: None)
    expected = "test at 0 Pa: the device reports no lost host in 0.2 s of silence"
    with (
        opened(platform()) as (regulator, _),
        fails(HardwareError, expected, code="refused", step="start-up"),
    ):
        regulator.configure()
    with opened(platform(watchdog_test=False)) as (regulator, _):
        regulator.configure()


@pytest.mark.process
def test_a_board_without_a_watchdog_ends_the_start(monkeypatch):
    monkeypatch.setattr(core, "Rules", functools.partial(changed_rules, core.Rules))
    described = board_platform(host={"start_timeout_s": 0.3})
    expected = "test at 0 Pa: its watchdog has not vented in 0.4 s of silence"
    with opened(described) as (regulator, _), fails(HardwareError, expected, code="refused", step="start-up"):
        regulator.configure()
    with opened(with_changes(described, watchdog_test=False)) as (regulator, _):
        regulator.configure()


@pytest.mark.process
@pytest.mark.parametrize("family", ["itv", "alicat", "vtem"])
def test_it_is_left_out_with_a_word_where_a_chamber_is_not_empty(family, caplog):
    """The supervisor could not confirm a vent; a sensor that is off at rest is for the limiter to judge."""
    with opened(SUPERVISED[family]()) as (regulator, devices):
        devices.faults.add(read_injection("fault: sensor_offset, offset_pa: 3e3, chamber: link0/chamber1"))
        regulator.configure()
        assert regulator.supervisor.is_alive
        devices.faults.clear()
    (record,) = [record for record in caplog.records if "no test of the supervisor" in record.message]
    assert re.search(r"a chamber reads [23]\.\d kPa at 0 Pa", record.message)
