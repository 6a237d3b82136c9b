"""SMC ITV: the exact lines, what is spread, what is noticed, what is tolerated."""

import numpy as np
import pytest
from hardware_bench import codes, transcript
from serial_bench import SerialBench, itv, quiet

from soro_core.errors import ConfigError, HardwareError
from soro_hardware.emulation.serial_line.devices import EmulatedItv
from soro_hardware.emulation.serial_line.valve import ValveSetup
from soro_hardware.serial_line.itv import is_refusal, parse
from tests.refused import fails


@pytest.fixture
def one():
    bench = SerialBench(itv(1, **quiet()))
    bench.driver.configure()
    return bench


@pytest.fixture
def three():
    bench = SerialBench(itv())
    bench.driver.configure()
    assert bench.run(80, 20e3, 40e3, 60e3).faults == ()
    return bench


# -- transcripts -----------------------------------------------------------------------------------


def test_start_up(one):
    assert one.log() == transcript("itv_start_up")


def test_cycle(one):
    one.log()
    one.run(22, 20e3)
    assert one.log()[:-1] == transcript("itv_cycle")


def test_restart_of_the_device(one):
    one.run(60, 20e3)
    one.log()
    one.valves[0].reboot(one.devices.now_ns)
    result = one.run(26, 20e3)
    assert one.log()[:-1] == transcript("itv_rebooted")
    assert codes(result) == {("rebooted", "link0/chamber0 (port0)")}
    assert result.faults[0].message == "confirmed 20039 Pa and has 0 Pa: restarted, or set by another"


# -- set points ------------------------------------------------------------------------------------


def set_points(log):
    return [int(entry.split()[-1]) for entry in log if entry.startswith("> SET")]


def test_a_step_is_spread_over_messages(one):
    one.log()
    one.run(100, 80e3)
    counts = [0, *set_points(one.log())]
    assert counts[-1] == round(80e3 / 1e5 * 1023)
    assert len(counts) > 5
    # 400 kPa/s and at most ten cycles of 5 ms between two messages
    assert np.diff(counts).max() <= 400e3 * 0.05 / 1e5 * 1023 + 1


def test_a_step_after_a_long_rest_is_spread_too(one):
    one.run(300, 20e3)
    one.log()
    one.run(3, 80e3)
    first = set_points(one.log())[0]
    assert first <= (20e3 + 3 * 400e3 * 0.005) / 1e5 * 1023 + 1


def test_a_vent_is_not_spread(one):
    one.run(100, 80e3)
    one.log()
    for _ in range(6):
        one.driver.vent()
    assert set_points(one.log()) == [0]


def test_zeros_after_a_vent_do_not_slow_it_down(one):
    """The caller goes on with zeros: they must not become a ramp."""
    one.run(100, 80e3)
    one.log()
    one.driver.vent()
    one.run(8, 0.0)
    assert set_points(one.log()) == [0]


def test_unchanged_set_point_is_not_sent_again_but_looked_at(one):
    one.run(100, 30e3)
    one.log()
    one.run(100, 30e3)
    log = one.log()
    assert not set_points(log)
    assert 3 <= log.count("> REQ") <= 6  # every 0.1 s
    assert log.count("> MON") > 20


@pytest.mark.parametrize(
    ("setpoint_pa", "counts"), [(0.0, 0), (48.0, 0), (49.0, 1), (90e3, 920), (100e3 / 1023 * 500, 500)]
)
def test_counts(one, setpoint_pa, counts):
    one.run(100, setpoint_pa)
    assert one.valves[0].setpoint == counts


# -- faults ----------------------------------------------------------------------------------------


def test_silent_device_latches_and_the_others_are_vented(three):
    three.valves[1].muted = True
    result = three.run(120, 20e3, 40e3, 60e3)
    assert ("device_silent", "link0/chamber1 (port1)") in codes(result)
    assert all(fault.latched for fault in result.faults)
    assert three.valves[0].setpoint == three.valves[2].setpoint == 0
    assert three.devices.pressure_pa.max() < 500.0, "it hears, so it is vented too"
    three.valves[1].muted = False
    assert three.run(100, 20e3, 40e3, 60e3).faults, "only configure clears it"
    three.driver.configure()
    assert three.run(100, 20e3, 40e3, 60e3).faults == ()


def test_babbling_line_is_a_fault_and_a_vent_gets_through(three):
    """A device that never stops talking: the line is never quiet."""
    noisy = three.devices.lines[1]
    seen = set()
    for _ in range(160):
        noisy.put(b"\x00x7")
        seen |= codes(three.exchange(20e3, 40e3, 60e3))
    assert {source for _, source in seen} == {"link0/chamber1 (port1)"}
    assert "device_silent" in {code for code, _ in seen}
    assert three.valves[1].setpoint == 0
    assert three.devices.pressure_pa.max() < 500.0


def test_vent_after_a_failed_start_up_never_raises():
    bench = SerialBench(itv(line={"boot_timeout_s": 0.1}))
    bench.valves[1].muted = True
    with pytest.raises(HardwareError):
        bench.driver.configure()
    bench.driver.vent()
    bench.driver.close()


def test_short_silence_is_tolerated(three):
    before = three.driver.statistics.frames_lost
    three.valves[1].muted = True
    three.run(20, 20e3, 40e3, 60e3)
    three.valves[1].muted = False
    assert three.run(60, 20e3, 40e3, 60e3).faults == ()
    assert three.driver.statistics.frames_lost > before
    np.testing.assert_allclose(three.devices.pressure_pa, [20e3, 40e3, 60e3], atol=600)


def test_restart_while_the_set_point_moves_is_noticed(three):
    """A new set point must not hide that the device has lost the last one."""
    seen = set()
    for cycle in range(100):
        if cycle == 30:
            three.valves[1].reboot(three.devices.now_ns)
        if cycle == 31:
            three.valves[1].muted = True
        if cycle == 40:
            three.valves[1].muted = False
            three.valves[1].setpoint = 0
        result = three.exchange(20e3, 40e3 + 200.0 * cycle, 60e3)
        seen |= codes(result)
    assert ("rebooted", "link0/chamber1 (port1)") in seen


def test_ignored_set_point(three):
    """It says what it was told and stays where it is."""
    three.valves[0].ignores_setpoint = True
    result = three.run(100, 30e3, 40e3, 60e3)
    assert "rebooted" in {fault.code for fault in result.faults}


def change(bench, port, old, new, times=1):
    """Let a word on its way to the host be changed, some times."""
    left = [times]

    def to_host(chunk):
        if old in chunk and left[0]:
            left[0] -= 1
            return chunk.replace(old, new)
        return chunk

    bench.devices.lines[port].to_host = to_host


def test_wrong_echo_is_corrected(one):
    one.run(60, 20e3)
    change(one, 0, b"3", b"8")
    result = one.run(60, 30e3)
    assert result.faults == ()
    assert one.valves[0].setpoint == round(30e3 / 1e5 * 1023)


def test_other_echo_again_and_again(one):
    one.run(60, 20e3)
    one.valves[0].command = lambda line: b"7"
    seen = {fault.code for _ in range(60) for fault in one.exchange(30e3).faults}
    assert "setpoint_ignored" in seen


@pytest.mark.parametrize("answer", [b"OUT OF RANGE", b"UNKNOWN COMMAND", b"out of range"])
def test_refusals(one, answer):
    one.run(60, 20e3)
    one.valves[0].command = lambda line: answer
    result = one.run(30, 30e3)
    assert ("command_rejected", "link0/chamber0 (port0)") in codes(result)
    assert answer.decode() in result.faults[0].message
    assert one.driver.statistics.frames_refused > 3


def test_garbled_answers_are_counted_and_the_line_is_in_step_again(one):
    one.run(60, 20e3)
    before = one.driver.statistics
    garbled = iter([b"5l2", b"\xff\x00", b"1024", b"12 34", b"-5", b"00205"])
    answer = one.valves[0].command

    def command(line):
        return next(garbled, None) or answer(line) if one.cycle % 20 < 3 else answer(line)

    one.valves[0].command = command
    result = one.run(240, 20e3)
    assert result.faults == ()
    assert one.driver.statistics.frames_garbled - before.frames_garbled == 6
    assert abs(one.valves[0].demand_pa() - 20e3) < 50


def test_late_answer_is_not_taken_for_the_next(one):
    """An answer that comes after its time: the line is flushed before anything else is asked."""
    one.run(60, 20e3)
    held = []
    line = one.devices.lines[0]

    def hold(chunk):
        held.append(chunk)
        return b""

    line.to_host = hold
    one.run(13, 20e3)
    line.to_host = lambda chunk: chunk
    line.put(b"".join(held))
    result = one.run(60, 20e3)
    statistics = one.driver.statistics
    assert result.faults == ()
    assert statistics.frames_late + statistics.frames_lost >= 1
    assert result.sent_pa == pytest.approx([20e3], abs=50.0)
    assert result.pressure_pa == pytest.approx([20e3], abs=1.5e3)


def test_unplugged_port_is_named_and_the_others_are_vented(three):
    three.ports[1].gone = True
    with fails(HardwareError, device="port1", code="gone"):
        three.run(1, 20e3, 40e3, 60e3)
    three.driver.vent()


def test_two_devices_on_one_port(one):
    """Answers without a request are counted; the line is flushed."""
    one.run(20, 20e3)
    for _ in range(5):
        one.devices.lines[0].put(b"77\r\n")
        one.run(12, 20e3)
    statistics = one.driver.statistics
    assert statistics.frames_late + statistics.frames_garbled >= 5
    assert one.run(30, 20e3).faults == ()


# -- start-up --------------------------------------------------------------------------------------


def test_start_up_errors_name_device_and_step():
    bench = SerialBench(itv(line={"boot_timeout_s": 0.3}))
    bench.valves[1].muted = True
    with fails(HardwareError, "0.3 s", device="link0/chamber1 (port1)", step="boot", code="silent"):
        bench.driver.configure()
    bench = SerialBench(itv())
    bench.valves[2].ignores_setpoint = True
    bench.valves[2].setpoint = 300
    with fails(HardwareError, "'300'", device="link0/chamber2 (port2)", step="REQ", code="refused"):
        bench.driver.configure()
    bench = SerialBench(itv())
    bench.valves[0].command = lambda line: b"UNKNOWN COMMAND"
    with fails(HardwareError, "'UNKNOWN COMMAND'", step="SET 0", code="refused"):
        bench.driver.configure()


def test_start_up_finds_a_device_in_the_middle_of_something():
    bench = SerialBench(itv(1))
    bench.ports[0].write(b"SET 5")  # half a command of one that was killed
    bench.valves[0].setpoint = 400
    bench.driver.configure()
    assert bench.valves[0].setpoint == 0


# -- the emulated device and the codec -------------------------------------------------------------


@pytest.fixture
def valve():
    pressure = [30e3]
    valve = EmulatedItv(None, ValveSetup(100e3, lambda: pressure[0]), 0)
    valve.pressure = pressure
    return valve


def test_emulated_commands(valve):
    say = valve.command
    assert say(b"REQ") == b"0"
    assert say(b"SET 512") == b"512"
    assert say(b"INC") == b"513"
    assert say(b"DEC") == b"512"
    assert say(b"REQ") == b"512"
    assert say(b"MON") == b"306"
    assert say(b"SET 1023") == b"1023"
    assert say(b"INC") == b"1023"
    assert say(b"SET 0") == b"0"
    assert say(b"DEC") == b"0"
    assert say(b"SET 1024") == b"OUT OF RANGE"
    assert say(b"SET 99999999999") == b"OUT OF RANGE"
    for bad in (b"SET", b"SET -1", b"SET 1.5", b"set 5", b"MON 1", b"HELLO", b"\xff"):
        assert say(bad) == b"UNKNOWN COMMAND"
    assert valve.setpoint == 0
    valve.pressure[0] = -500.0
    assert say(b"MON") == b"0"
    valve.pressure[0] = 130e3
    assert say(b"MON") == b"1023"


def test_parse():
    assert [parse(line) for line in (b"0", b"7", b"0007", b"1023")] == [0, 7, 7, 1023]
    bad = (b"", b"1024", b"-1", b"+1", b"1.0", b" 1", b"00001", "١".encode(), b"\xb2", b"1e2")
    assert all(parse(line) is None for line in bad)
    assert is_refusal(b"UNKNOWN COMMAND")
    assert not is_refusal(b"12")


BAD = {
    "range beyond full scale": ({"full_scale_pa": 50e3}, ("", "range.maximum_pa:", "full_scale_pa", "50000")),
    "range below zero": (
        {"range": {"minimum_pa": -10e3, "maximum_pa": 90e3}},
        ("", "range.minimum_pa:", "0"),
    ),
    "port twice": (
        {"valves": [{"chamber": f"link0/chamber{n}", "port": "/dev/ttyUSB0"} for n in range(3)]},
        ("", "valves:", "/dev/ttyUSB0"),
    ),
    "baud": ({"baud": 1234}, ("baud", "1234")),
}


@pytest.mark.parametrize(("changes", "found"), BAD.values(), ids=BAD.keys())
def test_bad_platform(changes, found):
    with fails(ConfigError, *found[1:], key=found[0]):
        itv(**changes)


def test_device_of_the_platform():
    ports = [f"/dev/ttyUSB{n}" for n in range(3)]
    valves = [{"chamber": f"link0/chamber{n}", "port": port} for n, port in enumerate(ports)]
    assert itv(valves=valves).device == ",".join(ports)
    assert itv().device is None
