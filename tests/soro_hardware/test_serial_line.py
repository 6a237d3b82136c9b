"""What both dialects stand on: paced lines, ports, lockstep and real time over pseudo-terminals."""

import contextlib
import os
import time
import tty

import numpy as np
import pytest
from hardware_bench import driver, emulator
from serial_bench import SerialBench, alicat, itv, platform_file, quiet

from soro_core.errors import HardwareError
from soro_hardware import load_platform, open_regulator
from soro_hardware.emulation.serial_line.uart import Station, Uart
from soro_hardware.emulation.sockets.plant_link import PlantLinkClient
from soro_hardware.serial_line.line.port import SerialPort, open_with_retries, paths_of
from soro_hardware.serial_line.line.request import LineSplitter
from soro_hardware.serial_line.line.session import StartupSession
from soro_hardware.serial_line.lockstep import LockstepPort
from tests.refused import fails

MS = 1_000_000


# -- the emulated line -----------------------------------------------------------------------------


class Echo(Station):
    """Answers every line with itself."""

    def __init__(self, line, delay_ns=0):
        self.line, self.delay_ns, self.heard = line, delay_ns, []
        line.station = self

    def receive(self, chunk, end_ns):
        self.heard.append((chunk, end_ns))
        if chunk.endswith(b"\r"):
            self.line.send(chunk, end_ns + self.delay_ns)


class Clock:
    def __init__(self):
        self.now = 0

    def __call__(self):
        return self.now


def settle(line, until_ns):
    while (due := line.due_ns()) is not None and due <= until_ns:
        line.step(due)


@pytest.mark.parametrize("baud", [9600, 19200, 115200])
def test_bytes_take_their_time_in_both_directions(baud):
    clock = Clock()
    line = Uart(baud, False, clock)
    echo = Echo(line)
    line.feed(b"123456789\r")
    byte_ns = 10e9 / baud
    settle(line, round(9.9 * byte_ns))
    assert not echo.heard
    settle(line, round(10.1 * byte_ns))
    assert echo.heard[0][1] == pytest.approx(10 * byte_ns, rel=1e-4)
    settle(line, round(19.9 * byte_ns))
    assert not line.output.endswith(b"\r")
    settle(line, round(20.1 * byte_ns))
    assert bytes(line.output) == b"123456789\r"


def test_slow_lines_deliver_byte_by_byte():
    line = Uart(9600, False, Clock())
    Echo(line)
    line.feed(b"123456789\r")
    seen = []
    while (due := line.due_ns()) is not None:
        line.step(due)
        seen.append(bytes(line.output))
    assert b"1234" in seen


def test_a_wire_for_both_directions_collides():
    clock = Clock()
    line = Uart(9600, True, clock)
    echo = Echo(line)
    line.feed(b"ABCD\r")
    settle(line, 6 * MS)
    clock.now = 7 * MS  # in the middle of the answer
    line.feed(b"EF\r")
    assert line.collisions == 1
    settle(line, 100 * MS)
    assert b"ABCD\r" not in line.output
    assert line.output.startswith(b"A")  # what was over before the collision
    assert echo.heard[-1][0] != b"EF\r"
    full_duplex = Uart(9600, False, clock)
    Echo(full_duplex)
    clock.now = 0
    full_duplex.feed(b"ABCD\r")
    settle(full_duplex, 6 * MS)
    clock.now = 7 * MS
    full_duplex.feed(b"EF\r")
    settle(full_duplex, 100 * MS)
    assert bytes(full_duplex.output) == b"ABCD\rEF\r"


def test_an_answer_into_the_host_s_words_collides_too():
    clock = Clock()
    line = Uart(9600, True, clock)
    line.feed(b"A long question\r")
    line.send(b"B\r", 2 * MS)
    assert line.collisions == 1
    settle(line, 100 * MS)
    assert bytes(line.output) != b"B\r"


def test_a_flood_is_bounded():
    line = Uart(9600, False, Clock())
    for _ in range(100):
        line.feed(b"x" * 1000)
    assert line.overruns > 0


# -- pieces ----------------------------------------------------------------------------------------


def test_splitter():
    splitter = LineSplitter(b"\r\n")
    assert splitter.feed(b"12\r") == [b"12"]
    assert splitter.feed(b"\n3") == []
    assert splitter.feed(b"4\n\n\r5\r") == [b"34", b"5"]
    assert splitter.feed(b"x" * 500 + b"\r6\r")[-1] == b"6"
    assert splitter.overlong > 0


def test_paths():
    assert paths_of("/dev/a,/dev/b", 2) == ["/dev/a", "/dev/b"]
    with fails(HardwareError, "1", "3", device="/dev/a", code="setting"):
        paths_of("/dev/a", 3)


def test_port_that_nobody_named():
    with fails(HardwareError, device="itv_rs232", code="setting"):
        open_regulator(itv()).configure()


@pytest.fixture
def terminal():
    master, slave = os.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave), slave
    for descriptor in (master, slave):
        with contextlib.suppress(OSError):
            os.close(descriptor)


def test_port_without_waiting(terminal):
    master, path, _ = terminal
    port = SerialPort(path, 19200)
    assert port.read() == b""
    port.write(b"REQ\r\n")
    assert os.read(master, 64) == b"REQ\r\n"
    os.write(master, b"0\r\n")
    assert port.read() == b"0\r\n"
    with fails(HardwareError, code="open"):
        SerialPort(path, 19200)  # locked
    os.close(master)
    with fails(HardwareError, device=path, code="gone"):
        port.read()
    with fails(HardwareError, device=path, code="gone"):
        port.write(b"REQ\r\n")
    port.close()
    port.close()


def test_port_that_takes_no_more_is_not_waited_for(terminal):
    master, path, _ = terminal
    port = SerialPort(path, 19200)
    port.write(b"x" * 100_000)
    heard = b""
    while len(heard) < 100_000:
        heard += os.read(master, 65536)
        port.read()
    assert heard == b"x" * 100_000
    port.close()


def test_opening_is_tried_again_with_longer_and_longer_pauses(tmp_path):
    times = iter([0.0, 0.1, 0.2, 0.3])
    start = time.monotonic()
    with fails(HardwareError, code="open"):
        open_with_retries(str(tmp_path / "none"), 9600, 0.4, lambda: next(times))
    assert time.monotonic() - start >= 0.15  # 50 and 100 ms; 200 more would have been too late
    assert next(times, None) is None


# -- lockstep --------------------------------------------------------------------------------------


@pytest.mark.process
@pytest.mark.parametrize("make", [itv, alicat], ids=["itv", "alicat"])
def test_lockstep_over_pseudo_terminals_is_that_of_this_process(tmp_path, make):
    bench = SerialBench(make(), seed=4)
    bench.driver.configure()
    with (
        emulator(tmp_path, "--lockstep", "--seed", "4", platform=platform_file(tmp_path, make())) as served,
        driver(make(), served.device) as regulator,
    ):
        link = PlantLinkClient(served.plant)
        for cycle in range(60):
            target = [20e3 + 500 * cycle, 40e3, 60e3]
            ours = bench.exchange(*target)
            theirs = regulator.exchange(target, cycle * 5 * MS)
            np.testing.assert_array_equal(ours.pressure_pa, theirs.pressure_pa)
            np.testing.assert_array_equal(ours.sent_pa, theirs.sent_pa)
            np.testing.assert_array_equal(ours.fresh, theirs.fresh)
        frames = []
        while (frame := link.wait(0.05)) is not None:
            frames.append(frame)
        assert np.all(np.diff([frame.time_ns for frame in frames]) == 5 * MS)
        assert bench.driver.statistics == regulator.statistics
        link.close()


@pytest.mark.parametrize("platform", [itv(), alicat()], ids=["itv", "alicat"])
def test_start_up_is_no_cycle_of_the_loop(platform):
    """The twin takes every frame for a tick, and the estimator wants a pressure at the first one."""
    bench = SerialBench(platform)
    frames = []
    bench.devices.on_tick = lambda time_ns, *_: frames.append(time_ns)
    bench.driver.configure()
    assert frames == []
    assert bench.devices.now_ns > 0, "the lines take their time all the same"
    first = bench.exchange(0.0)
    assert len(frames) == 1
    assert np.isfinite(first.pressure_pa).all()
    assert not first.fresh.all()
    bench.driver.configure()
    assert len(frames) == 1
    bench.driver.close()


def test_lockstep_needs_an_emulator_in_lockstep(terminal):
    _, path, _ = terminal
    port = LockstepPort(SerialPort(path, 9600))
    port.end_cycle()
    with fails(HardwareError, "0.05 s", "lockstep", device=path, code="silent"):
        port.await_cycle(0.05, time.monotonic)
    port.close()


# -- real time -------------------------------------------------------------------------------------


# On a busy machine a process may be off its core for longer than a device's answer may take.
PATIENT = {"answer_timeout_s": 0.5, "silent_after": 10, "stale_s": 5.0}


@pytest.mark.process
@pytest.mark.parametrize("name", ["itv_serial", "alicat_serial"])
def test_real_time(tmp_path, name):
    shipped = load_platform(name)
    platform = shipped.model_copy(update={"line": shipped.line.model_copy(update=PATIENT)})
    with (
        emulator(tmp_path, platform=name) as served,
        driver(platform, served.device, lockstep=False) as regulator,
    ):
        target, seen, result = np.array([20e3, 40e3, 60e3]), np.zeros(3), None
        end = time.monotonic() + 30.0
        while (seen.min() < 30 or not np.allclose(result.pressure_pa, target, atol=1000.0)) and (
            time.monotonic() < end
        ):
            result = regulator.exchange(target, time.monotonic_ns())
            assert result.faults == ()
            seen += result.fresh
            time.sleep(0.003)
        assert seen.min() >= 30
        np.testing.assert_allclose(result.pressure_pa, target, atol=1000.0)
        assert regulator.statistics.frames_garbled == 0


@pytest.mark.process
def test_unplugged_and_plugged_in_again(tmp_path):
    path = platform_file(tmp_path, itv(line={"reconnect_s": 0.2, "supervisor": False}))
    platform = load_platform(path)
    regulator = open_regulator(platform, str(tmp_path / "adapter"))
    with emulator(tmp_path, platform=path) as served:
        regulator.configure()
        regulator.exchange([20e3, 20e3, 20e3], time.monotonic_ns())
        served.unplug()
        with fails(HardwareError, "adapter/0", code="gone"):
            regulator.exchange([20e3, 20e3, 20e3], time.monotonic_ns())
        regulator.vent()
        with fails(HardwareError, "adapter/", code="open"):
            regulator.configure()  # the links go one after the other
        with fails(HardwareError, code="order"):
            regulator.exchange([0.0, 0.0, 0.0], time.monotonic_ns())
    with emulator(tmp_path, platform=path):
        regulator.configure()
        regulator.close()


@pytest.mark.process
def test_configure_waits_for_a_port_that_comes_back(tmp_path):
    path = platform_file(tmp_path, alicat(1, line={"reconnect_s": 20.0, "supervisor": False}))
    with contextlib.ExitStack() as stack:
        calls = []

        def clock():
            calls.append(1)
            if len(calls) == 2:  # the first attempt has failed
                stack.enter_context(emulator(tmp_path, platform=path))
            return time.monotonic()

        regulator = open_regulator(load_platform(path), str(tmp_path / "adapter"), clock=clock)
        regulator.configure()
        regulator.close()


def test_no_supervisor_in_lockstep_or_where_it_is_switched_off():
    bench = SerialBench(itv(1, **quiet()))
    bench.driver.configure()
    assert bench.driver.supervisor is None
    assert not bench.driver.device_watchdog


class Noise:
    """A port that is never quiet, and the driver's time."""

    def __init__(self, noise):
        self.port, self.channels, self._noise, self._ns = self, (), noise, 0

    def read(self):
        return self._noise

    def write(self, data):
        pass

    def discard(self, now_ns):
        return self._noise

    def now_ns(self):
        self._ns += 1_000_000
        return self._ns

    def wait(self, timeout_s):
        pass


@pytest.mark.timeout(120)
@pytest.mark.parametrize("noise", [b"A M00 x\r", b"xxxxxxxx"], ids=["lines", "bytes"])
def test_a_line_that_is_never_quiet_does_not_hold_the_start_up_up(noise):
    line = Noise(noise)
    session = StartupSession(line, line, "port0", itv().line)
    session.try_ask(b"REQ\r")
    session.try_ask_table(b"A??D*\r")
