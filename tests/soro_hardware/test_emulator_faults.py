"""Faults on an emulator's process: by option, over its control socket, and a line that is pulled out."""

import time

import numpy as np
import pytest
from hardware_bench import PERIOD_NS, driver, emulator, platform, platform_file

from soro_core.errors import HardwareError
from soro_hardware.emulation.__main__ import main
from soro_hardware.emulation.faults.fault_types import Injection
from soro_hardware.emulation.sockets.control import ControlClient
from tests.patience import LIMIT_S
from tests.refused import fails

TARGET = np.array([20e3, 40e3, 60e3])
STUCK = "fault: stuck_at, pressure_pa: 30e3, chamber: link0/chamber1"


def cycles(regulator, number, first=0):
    for cycle in range(first, first + number):
        result = regulator.exchange(TARGET, cycle * PERIOD_NS)
    return result


def exchange_for(regulator, seconds):
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        regulator.exchange(TARGET, time.monotonic_ns())


@pytest.mark.process
def test_by_option_at_its_time_of_the_devices(tmp_path):
    path = platform_file(tmp_path)
    with (
        emulator(tmp_path, "--lockstep", "--fault", f"{STUCK}, at: 1.0", platform=path) as served,
        driver(platform(), served.device) as regulator,
    ):
        assert cycles(regulator, 190).pressure_pa[1] == pytest.approx(40e3, abs=1e3)
        assert cycles(regulator, 200, 190).pressure_pa == pytest.approx([20e3, 30e3, 60e3], abs=1e3)


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        ("fault: jam", "allowed: fault: one of drop, corrupt_bits, "),
        ("fault: stuck_open", "a chamber"),
        (
            "fault: stuck_open, chamber: link9/chamber0",
            "fault: chamber: got 'link9/chamber0'; allowed: one of link0",
        ),
        ("fault: bus_off, chamber: link0/chamber0", "no chamber"),
        ("fault: drop, p: 1.5", "p from 0 to 1"),
        ("fault: drop, q: 1", "drop: p from 0 to 1, not q"),
        ("[", "valid YAML"),
    ],
)
def test_a_wrong_option_is_one_line(fault, says, capfd):
    assert main(["emulated_canopen", "--lockstep", "--fault", fault]) == 2
    out, error = capfd.readouterr()
    assert out == ""
    assert says in error
    assert len(error.splitlines()) == 1


@pytest.mark.process
def test_a_wrong_option_ends_the_process(tmp_path, capfd):
    with emulator(tmp_path, "--lockstep", "--fault", "fault: stuck_open") as served:
        assert served.ready == ""
        assert served.wait() == 2
    assert len(capfd.readouterr().err.splitlines()) == 1


@pytest.mark.process
def test_over_the_control_socket(tmp_path):
    path = platform_file(tmp_path)
    with (
        emulator(tmp_path, "--lockstep", "--control", str(tmp_path / "faults"), platform=path) as served,
        driver(platform(), served.device) as regulator,
    ):
        cycles(regulator, 100)
        client = ControlClient(tmp_path / "faults")
        assert client.inject(STUCK) == "stuck_at of link0/chamber1 (pressure 30 kPa)"
        sensor = Injection(fault="sensor_offset", chamber="link0/chamber0", value=-5e3, duration_s=100.0)
        assert client.inject(sensor) == "sensor_offset of link0/chamber0 (offset -5 kPa)"
        assert client.inject("list").count(" of ") == 2
        with fails(HardwareError, "link0/chamber0", code="setting"):
            client.inject("fault: leak, chamber: link3/chamber0")
        with fails(HardwareError, "fault", code="setting"):
            client.inject("fault: gremlin")
        assert cycles(regulator, 200, 100).pressure_pa == pytest.approx([15e3, 30e3, 60e3], abs=1.2e3)
        assert client.inject("fault: clear") == "clear"
        assert client.inject("list") == "no faults"
        assert cycles(regulator, 200, 300).pressure_pa == pytest.approx(TARGET, abs=1.2e3)
        client.close()
        assert served.stop() == 0
    assert not (tmp_path / "faults").exists()
    with fails(HardwareError, code="open"):
        ControlClient(tmp_path / "faults")


@pytest.mark.process
def test_an_adapter_that_is_pulled_out_and_put_back(tmp_path):
    path = platform_file(tmp_path, canopen={"heartbeat_consumer_s": 1.0, "rpdo_deadline_s": 0.5})
    given = platform(canopen={"heartbeat_consumer_s": 1.0, "rpdo_deadline_s": 0.5})
    with (
        emulator(tmp_path, "--control", str(tmp_path / "faults"), platform=path) as served,
        driver(given, served.device, lockstep=False) as regulator,
    ):
        regulator.exchange(TARGET, time.monotonic_ns())
        client = ControlClient(tmp_path / "faults")
        client.inject("fault: adapter_unplug, duration_s: 0.3")
        with fails(HardwareError, code="gone"):
            exchange_for(regulator, LIMIT_S)
        regulator.vent()
        deadline = time.monotonic() + LIMIT_S
        while client.inject("list") != "no faults" or not served.device.exists():
            assert time.monotonic() < deadline
        regulator.configure()
        assert regulator.exchange(TARGET, time.monotonic_ns()).faults == ()
        client.close()
