"""The contact of the emergency stop at the board: what vents, and what keeps the latch closed."""

import ctypes
import os

import pytest
from board_bench import BOARD, BoardBench, board_platform, file_of
from hardware_bench import wait_for
from served_bench import served

from soro_core.errors import ConfigError, HardwareError
from soro_core.safety import Limits
from soro_hardware import doctor
from soro_hardware.board import messages
from soro_hardware.board.config import StopContact
from soro_hardware.board.pi import contact
from soro_hardware.board.pi.contact import GpioLine, StopInput
from soro_hardware.board.pi.server import run_board
from soro_hardware.emulation.board.i2c import EmulatedAds1015, EmulatedI2c, EmulatedMcp4725
from soro_hardware.emulation.faults.fault_types import read_injection
from soro_hardware.limited_regulator import LimitedRegulator
from tests.refused import fails

MS = 1_000_000
STOP = {"board": {"stop": {"line": 17}}}
PRESSED = read_injection("fault: stop_pressed")


@pytest.fixture
def bench():
    """Three valves at 20 kPa behind a board with a stop."""
    bench = BoardBench(board_platform(**STOP))
    bench.driver.configure()
    assert bench.run(100, 20e3).faults == ()
    return bench


def demands_nothing(bench):
    """Whether every DAC asks for 0 Pa."""
    return {dac.code for dac in bench.devices.dacs} == {2048}


def test_a_pressed_stop_vents_and_latches(bench):
    bench.devices.faults.add(PRESSED)
    result = bench.run(4, 20e3)  # 10 ms of bouncing, and the cycle after it
    assert [fault.code for fault in result.faults] == ["stop_pressed"]
    assert "contact of the emergency stop is open" in result.faults[0].message
    assert demands_nothing(bench)
    bench.devices.faults.clear()
    bench.run(20, 20e3)
    assert demands_nothing(bench), "a released stop does not set the arm under pressure again"


def test_the_board_vents_without_its_host(bench):
    """In real time: nothing of the host comes after the stop."""
    bench.devices.lockstep = False
    bench.devices.faults.add(PRESSED)
    bench.devices.run(bench.devices.now_ns + 20 * MS)
    assert demands_nothing(bench)
    assert bench.devices.board.state.cause.name == "STOP_CONTACT"


def test_noise_of_the_host_does_not_delay_the_vent(bench):
    board = bench.devices.board
    bench.devices.faults.add(PRESSED)
    for k in range(4):
        board.feed(b"no frame", bench.devices.now_ns + k * 4 * MS)
    assert demands_nothing(bench)


def test_a_bounce_shorter_than_its_time_does_nothing(bench):
    bench.devices.faults.add(read_injection("fault: stop_pressed, duration_s: 0.005"))
    assert bench.run(50, 0.0).faults == ()


def test_reset_is_refused_while_the_stop_is_pressed(bench):
    platform, device = bench.driver.platform, bench.driver
    loop = LimitedRegulator(platform, device, Limits())
    now = [bench.cycle * 5 * MS]

    def cycle(pressure_pa):
        now[0] += 5 * MS
        loop.offer([pressure_pa] * 3, now[0], now[0])
        loop.cycle(now[0])

    for _ in range(100):
        cycle(20e3)
    assert loop.cause is None
    bench.devices.faults.add(PRESSED)
    for _ in range(4):
        cycle(20e3)
    assert loop.cause.startswith("stop_pressed: board: ")
    cycle(0.0)
    refusal = loop.reset(lambda: now[0])
    assert "contact of the emergency stop is open" in refusal
    cycle(0.0)
    assert loop.cause is not None
    bench.devices.faults.clear()
    for _ in range(4):
        bench.devices.tick(bench.devices.now_ns + 5 * MS)
    assert loop.reset(lambda: now[0]) is None
    for _ in range(100):
        cycle(20e3)
    assert loop.cause is None


def test_a_board_whose_stop_is_pressed_does_not_start():
    bench = BoardBench(board_platform(**STOP))
    bench.devices.faults.add(PRESSED)
    bench.devices.power_cycle()
    bench.devices.line.hang_up = False
    with fails(HardwareError, "contact of the emergency stop is open", device="board"):
        bench.driver.configure()


@pytest.mark.process
def test_doctor_names_a_pressed_stop():
    platform = board_platform(**STOP)
    with served(platform) as (devices, address):
        devices.faults.add(PRESSED)
        assert wait_for(lambda: devices.board.state.cause is messages.Cause.STOP_CONTACT)
        found = {finding.name: finding for finding in doctor.examine(platform, address, run_s=0.0)}
    assert found["board"].level == "ok"
    assert (found["stop contact"].level, "broken wire" in found["stop contact"].do) == ("warn", True)


def test_without_a_contact_the_board_goes_on():
    bench = BoardBench(board_platform())
    bench.driver.configure()
    bench.run(50, 10e3)
    bench.devices.faults.add(PRESSED)
    assert bench.run(20, 10e3).faults == ()
    assert max(bench.devices.pressure_pa) < 1e3, "the dump valve opens without the board"


class Lines:
    """A contact by hand."""

    def __init__(self, *states):
        self.states = list(states)

    def is_open(self):
        state = self.states.pop(0)
        if isinstance(state, OSError):
            raise state
        return state


def judged(*states, debounce_s=0.01, step_ms=4):
    stop = StopInput(StopContact(line=1, debounce_s=debounce_s), Lines(*states))
    return [stop.is_pressed(k * step_ms * MS) for k in range(len(states))]


def test_debouncing():
    on, off = True, False
    assert judged(off, off, on, on, on, on, off, on) == [off, off, off, off, off, on, on, on]
    assert judged(off, on, off, on, off, on) == [off] * 6
    assert judged(on, off, off, off, off) == [on, on, on, on, off]
    assert judged(off, on, debounce_s=0.0) == [off, on]


def test_a_line_that_cannot_be_read_counts_as_pressed():
    assert judged(False, *[OSError(5, "EIO")] * 4)[-1] is True
    assert judged(OSError(5, "EIO")) == [True]


class Attribute(ctypes.Structure):
    """struct gpio_v2_line_config_attribute of linux/gpio.h."""

    _fields_ = [("id", ctypes.c_uint32), ("padding", ctypes.c_uint32), ("value", ctypes.c_uint64),
                ("mask", ctypes.c_uint64)]  # fmt: skip


class Request(ctypes.Structure):
    """struct gpio_v2_line_request of linux/gpio.h."""

    _fields_ = [("offsets", ctypes.c_uint32 * 64), ("consumer", ctypes.c_char * 32),
                ("flags", ctypes.c_uint64), ("num_attrs", ctypes.c_uint32),
                ("config_padding", ctypes.c_uint32 * 5), ("attrs", Attribute * 10),
                ("num_lines", ctypes.c_uint32), ("event_buffer_size", ctypes.c_uint32),
                ("padding", ctypes.c_uint32 * 5), ("fd", ctypes.c_int32)]  # fmt: skip


class Values(ctypes.Structure):
    """struct gpio_v2_line_values of linux/gpio.h."""

    _fields_ = [("bits", ctypes.c_uint64), ("mask", ctypes.c_uint64)]


def _iowr(number, kind):
    """_IOWR(0xB4, number, kind) of asm-generic/ioctl.h."""
    return 3 << 30 | ctypes.sizeof(kind) << 16 | 0xB4 << 8 | number


def test_the_words_to_the_kernel(monkeypatch, tmp_path):
    """By the structures of the header, as C lays them out; no machine here has a GPIO chip."""
    chip = tmp_path / "gpiochip0"
    chip.touch()
    given, is_high = os.open(chip, os.O_RDONLY), [1]
    seen = []

    def ioctl(_, number, buffer):
        if number == _iowr(7, Request):
            request = Request.from_buffer(buffer)
            seen.append((list(request.offsets[:2]), request.consumer, request.flags, request.num_attrs))
            assert request.num_lines == 1
            request.fd = given
        else:
            assert number == _iowr(14, Values)
            values = Values.from_buffer(buffer)
            values.bits = is_high[0] & values.mask

    monkeypatch.setattr(contact.fcntl, "ioctl", ioctl)
    line = GpioLine(StopContact(chip=str(chip), line=17))
    assert seen == [([17, 0], b"soro stop", 1 << 2 | 1 << 8, 0)]  # input, pulled up
    assert line.is_open() is True
    is_high[0] = 0
    assert line.is_open() is False
    line.close()
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(given)


def test_a_chip_that_is_none(tmp_path):
    with fails(HardwareError, "cannot read line 3", device=str(tmp_path / "none")):
        GpioLine(StopContact(chip=str(tmp_path / "none"), line=3))
    with fails(HardwareError, "cannot read line 3", device="/dev/null"):
        GpioLine(StopContact(chip="/dev/null", line=3))


@pytest.mark.parametrize("key", ["line", "debounce_s"])
def test_what_a_contact_may_not_be(key):
    with fails(ConfigError, key=f"board.stop.{key}"):
        board_platform(board={"stop": {"line": 1, key: -1}})


@pytest.mark.parametrize(("is_open", "says"), [(True, "OPEN: pressed, or a broken wire"), (False, "closed")])
def test_check_shows_the_contact(tmp_path, is_open, says):
    platform = board_platform()
    buses = {}
    for port in platform.ports:
        bus = buses.setdefault(port.bus, EmulatedI2c({}))
        bus.chips |= {port.dac: EmulatedMcp4725(2048), port.adc: EmulatedAds1015(lambda: 1.0)}

    class Contact(Lines):
        def close(self):
            pass

    lines = []
    config = file_of(tmp_path, BOARD, **STOP)
    options = {"open_bus": buses.__getitem__, "open_contact": lambda _: Contact(is_open)}
    run_board(config, "", lines.append, check=True, **options)
    assert lines[-1] == f"stop contact: {says}"
