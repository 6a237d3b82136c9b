"""The process that vents when a driver without device watchdogs dies: real kills, real pseudo-terminals."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import tty

import pytest
from hardware_bench import emulator
from serial_bench import alicat, itv, platform_file

from soro_core.errors import HardwareError
from soro_core.hardware import open_regulator, supervisor
from soro_core.hardware.plant_link import PlantLinkClient
from soro_core.hardware.supervisor_client import SCRIPT, Supervisor

DRIVER = """
import sys, time
import numpy as np
from soro_core.hardware import load_platform, open_regulator
regulator = open_regulator(load_platform(sys.argv[1]), sys.argv[2])
regulator.configure()
print("supervisor", regulator._supervisor.pid, flush=True)
while True:
    regulator.exchange(np.array([20e3, 40e3, 60e3]), time.monotonic_ns())
    print("cycle", flush=True)
    time.sleep(0.005)
"""


def wait_for(condition, limit_s=10.0):
    """Poll until a condition holds; its value."""
    deadline = time.monotonic() + limit_s
    while time.monotonic() < deadline:
        if value := condition():
            return value
        time.sleep(0.005)
    raise AssertionError("the condition was not met in time")


def is_running(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize("make", [itv, alicat], ids=["itv", "alicat"])
def test_valves_vent_when_the_driver_is_killed(tmp_path, make):
    path = platform_file(tmp_path, make())
    with emulator(tmp_path, platform=path) as served:
        host = subprocess.Popen(
            [sys.executable, "-c", DRIVER, path, str(served.device)], stdout=subprocess.PIPE, text=True
        )
        try:
            word, pid = host.stdout.readline().split()
            assert word == "supervisor"
            link = PlantLinkClient(served.plant)
            reader = threading.Thread(target=host.stdout.read)
            reader.start()
            wait_for(lambda: link.receive(5.0).pressures[2] > 55e3)
        finally:
            host.send_signal(signal.SIGKILL)
            host.wait(10)
            reader.join()
            host.stdout.close()
        frames = [link.latest()]
        # In time of the devices: a busy machine may stop the emulator.
        wait_for(lambda: frames.append(link.receive(5.0)) or frames[-1].pressures.max() < 5e3)
        pressures = [frame.pressures[2] for frame in frames]
        assert max(pressures) > 50e3
        link.close()
        wait_for(lambda: not is_running(int(pid)))  # and leaves the ports to the next driver
        regulator = open_regulator(make(), str(served.device))
        regulator.configure()
        assert regulator.exchange([0.0, 0.0, 0.0], time.monotonic_ns()).faults == ()
        regulator.close()


def test_orderly_end_leaves_nothing_to_do(tmp_path):
    with emulator(tmp_path, platform=platform_file(tmp_path, itv())) as served:
        regulator = open_regulator(itv(), str(served.device))
        regulator.configure()
        process = regulator._supervisor._process
        regulator.close()
        assert process.returncode == 0


def test_its_death_is_a_fault(tmp_path):
    with emulator(tmp_path, platform=platform_file(tmp_path, itv())) as served:
        regulator = open_regulator(itv(), str(served.device))
        regulator.configure()
        os.kill(regulator._supervisor.pid, signal.SIGKILL)
        regulator._supervisor._process.wait(5)
        result = regulator.exchange([0.0, 0.0, 0.0], time.monotonic_ns())
        assert {fault.code for fault in result.faults} == {"supervisor_lost"}
        regulator.configure()  # a reset starts another one
        assert regulator.exchange([0.0, 0.0, 0.0], time.monotonic_ns()).faults == ()
        regulator.close()


class Line:
    """A pseudo-terminal whose other end is this test."""

    def __init__(self):
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.path = os.ttyname(self.slave)

    def close(self):
        os.close(self.master)
        os.close(self.slave)


@pytest.fixture
def line():
    line = Line()
    yield line
    line.close()


def start(plan):
    process = subprocess.Popen(
        [sys.executable, "-I", "-S", str(SCRIPT)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout.readline() == b"ready\n"
    process.stdin.write(json.dumps(plan).encode() + b"\n")
    process.stdin.flush()
    return process


def test_repeats_until_it_is_confirmed(line):
    plan = [
        {
            "address": line.path,
            "baud": 9600,
            "timeout_s": 0.02,
            "steps": [{"send": "SET 0\r\n", "expect": "0+"}],
        }
    ]
    process = start(plan)
    process.stdin.close()
    heard = b""
    while heard.count(b"SET 0\r\n") < 3:
        heard += os.read(line.master, 4096)
        if heard.count(b"SET 0\r\n") == 1:
            os.write(line.master, b"512\r\nUNKNOWN COMMAND\r\n")  # not the answer
    os.write(line.master, b"0\r\n")
    assert process.wait(5) == 0
    text = process.stderr.read().decode()
    process.stdout.close()
    process.stderr.close()
    assert heard.startswith(b"\r\n")  # ends what the driver may have begun
    assert "the driver died; vented" in text


def test_says_what_it_could_not_vent(line):
    plan = [
        {"address": line.path, "baud": 9600, "timeout_s": 0.001, "steps": [{"send": "AS0\r", "expect": "A"}]}
    ]
    process = start(plan)
    process.stdin.close()
    assert process.wait(10) == 1
    text = process.stderr.read().decode()
    process.stdout.close()
    process.stderr.close()
    assert f"{line.path}: not confirmed: 'AS0\\r'" in text
    assert "NOT ALL VENTED: open the dump valve" in text


def test_waits_for_the_drivers_lock(line):
    """The lock of a killed process goes with it; until then the supervisor tries again."""
    from soro_core.hardware.serial_line.port import SerialPort

    port = SerialPort(line.path, 9600)
    plan = [{"address": line.path, "timeout_s": 0.05, "steps": [{"send": "SET 0\r\n"}]}]
    process = start(plan)
    process.stdin.close()
    time.sleep(0.05)
    assert process.poll() is None
    with pytest.raises(HardwareError, match="cannot open"):
        SerialPort(line.path, 9600)
    port.close()
    assert process.wait(5) == 0
    process.stdout.close()
    process.stderr.close()


def test_speaks_tcp_too():
    server = socket.create_server(("127.0.0.1", 0))
    address = f"127.0.0.1:{server.getsockname()[1]}"
    half = "\x00\x00\x00\x00\x00\x00\xe0\x3f"
    done = []
    thread = threading.Thread(
        target=lambda: done.append(
            supervisor.carry_out(
                [{"address": address, "begin": "", "timeout_s": 0.1, "steps": [{"send": half}]}]
            )
        )
    )
    thread.start()
    connection, _ = server.accept()
    assert connection.recv(64) == half.encode("latin-1")
    thread.join()
    assert done == [True]
    connection.close()
    server.close()


def test_client_survives_a_dead_process():
    process = Supervisor()
    os.kill(process.pid, signal.SIGKILL)
    process._process.wait(5)
    assert not process.is_alive
    with pytest.raises(HardwareError, match="supervisor"):
        process.arm([])
    process.dismiss()
    process.dismiss()
