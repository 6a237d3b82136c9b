"""Alicat: the exact lines, columns of real devices, gates by firmware, the source trap, streams."""

import re

import numpy as np
import pytest
from hardware_bench import codes, transcript
from serial_bench import SerialBench, alicat, quiet

from soro_core.errors import ConfigError, HardwareError
from soro_hardware.emulation.serial_line.alicat import EmulatedAlicat
from soro_hardware.emulation.serial_line.valve import ValveSetup
from soro_hardware.serial_line.alicat_codec import (
    FrameLayout,
    is_refusal,
    parse_frame,
    parse_layout,
    parse_setpoint,
    parse_version,
)
from soro_hardware.serial_line.lockstep import MARK
from tests.refused import fails

NEW, LATE_8, OLD = "10v20.0-R24", "8v17.0-R23", "5v12.0-R22"


def bench_of(n=3, firmware=NEW, **changes):
    return SerialBench(alicat(n, **quiet(firmware=firmware), **changes))


@pytest.fixture
def three():
    bench = bench_of()
    bench.driver.configure()
    assert bench.run(120, 20e3, 40e3, 60e3).faults == ()
    return bench


# -- transcripts -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("firmware", "name"), [(NEW, "alicat"), (OLD, "alicat_old")])
def test_start_up_and_cycle(firmware, name):
    bench = bench_of(1, firmware)
    bench.driver.configure()
    assert bench.log() == transcript(f"{name}_start_up")
    bench.run(10, 20e3)
    assert bench.log() == transcript(f"{name}_cycle")


def test_ignored_set_point():
    """The trap: taken, answered, not followed."""
    bench = bench_of(1)
    bench.driver.configure()
    bench.run(40, 20e3)
    bench.log()
    bench.valves[0].source = "A"
    result = bench.run(12, 30e3)
    assert bench.log() == transcript("alicat_ignored")
    assert ("setpoint_ignored", "link0/chamber0 (unit A on port0)") in codes(result)
    assert result.faults[0].message == "was sent 30000 Pa and keeps 20000 Pa"


def test_ignored_set_point_of_old_firmware():
    bench = bench_of(2, OLD)
    bench.driver.configure()
    bench.run(40, 20e3)
    bench.valves[1].source = "A"
    seen = {code for _ in range(20) for code in codes(bench.exchange(30e3))}
    assert ("setpoint_ignored", "link0/chamber1 (unit B on port0)") in seen


# -- firmware --------------------------------------------------------------------------------------


@pytest.mark.parametrize("firmware", ["1v05.0", "5v12.0-R22", "7v99.0-R1", "8v17.0-R23", "8v99.9-R9"])
def test_nothing_that_locks_the_panel_below_9v00(firmware):
    bench = bench_of(2, firmware)
    bench.driver.configure()
    bench.run(60, 20e3, 50e3)
    bench.driver.vent()
    bench.driver.close()
    sent = [entry for entry in bench.log() if entry.startswith(">")]
    assert not [entry for entry in sent if re.match("> [A-Z] ?L", entry)]
    assert not any("LCK" in valve.flags for valve in bench.valves)


@pytest.mark.parametrize(
    ("firmware", "command"),
    [("8v99.0", "AS"), ("9v00.0", "ALS "), ("9v01.0-R1", "ALS "), ("10v20.0-R24", "ALS ")],
)
def test_set_point_command_by_firmware(firmware, command):
    bench = bench_of(1, firmware)
    bench.driver.configure()
    bench.log()
    bench.run(60, 15e3)
    sent = [entry for entry in bench.log() if re.match(r"> A.*\d", entry)]
    assert sent[-1] == f"> {command}15.00"


def test_s_on_request_gives_twice_the_rate():
    slow, fast = bench_of(3), bench_of(3, setpoint_command="S")
    slow.driver.configure()
    fast.driver.configure()
    fast.run(60, 15e3)
    assert not [entry for entry in fast.log() if "LS " in entry]
    assert fast.driver.update_hz > 1.9 * slow.driver.update_hz
    np.testing.assert_allclose(fast.devices.pressure_pa, 15e3, atol=150)


def test_devices_of_different_firmware_on_one_line():
    bench = bench_of(3)
    bench.valves[1].version, bench.valves[1].firmware = (5, 12), OLD
    bench.driver.configure()
    bench.log()
    assert bench.run(120, 20e3, 40e3, 60e3).faults == ()
    log = bench.log()
    assert "> BS40.00" in log
    assert "> CLS 60.00" in log
    np.testing.assert_allclose(bench.devices.pressure_pa, [20e3, 40e3, 60e3], atol=100)


def test_device_that_does_not_report_its_version():
    bench = bench_of(1)
    bench.valves[0].firmware = "unknown"
    with fails(HardwareError, device="link0/chamber0 (unit A on port0)", step="firmware", code="refused"):
        bench.driver.configure()
    assert not [entry for entry in bench.log() if entry.startswith("> AL")]


@pytest.mark.parametrize("source", ["A", "U"])
def test_wrong_source_is_found_at_start_up(source):
    bench = bench_of(1)
    bench.valves[0].source = source
    with fails(HardwareError, f"'A {source}'", step="set point source", code="refused"):
        bench.driver.configure()


def test_wrong_source_of_old_firmware_is_found_by_its_set_point():
    bench = bench_of(1, OLD)
    bench.valves[0].setpoint, bench.valves[0].source = 30.0, "A"
    with fails(HardwareError, "30000 Pa", step="set point 0", code="refused"):
        bench.driver.configure()


# -- columns ---------------------------------------------------------------------------------------

HEAD = "A D00 ID_ NAME______________________ TYPE_______ WIDTH NOTES___________________"
# Pressure controllers; the form is that of captures of 8v17 and 10v20, and of 5v12.
GAUGE_PSI = [
    HEAD,
    "A D01 700 Unit ID                    string          1",
    "A D02 006 Gauge Press                s decimal     7/2 022 02 PSIG",
    "A D03 038 Gauge Press Setpt          s decimal     7/2 022 02 PSIG",
    "A D04 701 *Error                     string          3 ADC",
    "A D05 702 *Status                    string          3 POV",
]
OLD_PSI = [
    "A  D00 NAME_______ TYPE_____ MinVal_  MaxVal_  UNITS__",
    "A  D01 Unit ID     char         A         Z         na",
    "A  D02 Temperature signed    -010.00  +050.00        C",
    "A  D03 Pressure    signed    +000.00  +160.00     PSIG",
    "A  D04 SetPoint    signed    +0000.0  +0160.0     PSIG",
    "A  D05 Status      string         na      LCK       na",
]
# A mass flow controller, as captured: it has no pressure set point.
FLOW = [
    HEAD,
    "A D01 700 Unit ID                    string          1",
    "A D02 002 Abs Press                  s decimal     7/2 010 02 PSIA",
    "A D03 003 Flow Temp                  s decimal     7/2 002 02 `C",
    "A D04 004 Volu Flow                  s decimal     7/2 012 02 CCM",
    "A D05 005 Mass Flow                  s decimal     7/2 012 02 SCCM",
    "A D06 037 Mass Flow Setpt            s decimal     7/2 012 02 SCCM",
    "A D07 703 Gas                        string          6",
]


def layout(rows, unit="A"):
    return parse_layout([row.encode() for row in rows], unit)


def test_layouts():
    assert layout(GAUGE_PSI) == FrameLayout(3, 1, 2, 6894.757293168, 2)
    assert layout(OLD_PSI) == FrameLayout(4, 2, 3, 6894.757293168, 1)
    assert layout(OLD_PSI).resolution_pa == pytest.approx(689.4757293168)


@pytest.mark.parametrize(
    ("rows", "text"),
    [
        (FLOW, "its pressure is in PSIA, not in a gauge unit"),
        (GAUGE_PSI[:3], "0 columns of set point"),
        ([], "0 columns of set point in its data frame .columns: none."),
        ([*GAUGE_PSI, GAUGE_PSI[2]], "2 columns of pressure"),
        ([row.replace("PSIG", "PSID") for row in GAUGE_PSI], "in PSID, not in a gauge unit"),
        ([row.replace("PSIG", "inHgG") for row in GAUGE_PSI], "in inHgG; known are"),
        ([*GAUGE_PSI[:3], GAUGE_PSI[3].replace("PSIG", "kPaG")], "set point in kPaG, pressure in PSIG"),
    ],
)
def test_bad_layouts(rows, text):
    with pytest.raises(ValueError, match=text):
        layout(rows)


def test_rows_of_another_unit_are_left_out():
    with pytest.raises(ValueError, match="0 columns"):
        layout(GAUGE_PSI, "B")


def test_frames():
    psi = layout(GAUGE_PSI)
    frame = parse_frame(b"A +014.70 +015.00 MOV HLD", "A", psi)
    assert frame.pressure_pa == pytest.approx(14.7 * 6894.757293168)
    assert frame.setpoint_counts == 1500
    assert frame.flags == {"MOV", "HLD"}
    assert parse_frame(b"A -000.10 0116.3", "A", psi).setpoint_counts == 11630  # 5v12 leaves the sign out
    assert parse_frame(b"A +020.00 +001.23 +0015.0 LCK", "A", layout(OLD_PSI)).setpoint_counts == 150


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"?",
        b"A",
        b"A +014.70",
        b"B +014.70 +015.00",
        b"A +014.7O +015.00",
        b"A +014.70 +015.00 +016.00",
        b"A nan +015.00",
        b"A inf +015.00",
        b"A 1e5 +015.00",
        b"A +014.70 +015.00 mov",
        b"A +014.70 +015.00 M\xffV",
        b"A  -- +015.00",
        "A +014.70 +٠15.00".encode(),
    ],
)
def test_bad_frames(line):
    assert parse_frame(line, "A", layout(GAUGE_PSI)) is None


def test_confirmations_refusals_versions():
    psi = layout(GAUGE_PSI)
    assert parse_setpoint(b"A +078.95 +078.88 12 SCCM", "A", psi) == 7888
    assert parse_setpoint(b"A +078.95 +078.88 12", "A", psi) is None
    assert parse_setpoint(b"B +078.95 +078.88 12 PSIG", "A", psi) is None
    assert is_refusal(b"?")
    assert is_refusal(b"A ?")
    assert not is_refusal(b"A +1 ?")
    assert parse_version(b"A   10v20.0-R24 Jan  9 2025,15:04:07") == (10, 20)
    assert parse_version(b"A M09 Software GP07R100") is None


@pytest.mark.parametrize(
    ("unit", "firmware"), [("PSIG", NEW), ("barG", NEW), ("PSIG", OLD), ("kPaG", LATE_8)]
)
def test_units(unit, firmware):
    bench = SerialBench(alicat(2, **quiet(firmware=firmware, unit=unit)))
    bench.driver.configure()
    result = bench.run(120, 20e3, 70e3)
    assert result.faults == ()
    np.testing.assert_allclose(result.sent_pa, [20e3, 70e3], atol=35)
    np.testing.assert_allclose(bench.devices.pressure_pa, result.sent_pa, atol=10)
    np.testing.assert_allclose(result.pressure_pa, result.sent_pa, atol=120)


# -- faults ----------------------------------------------------------------------------------------


def test_restart_of_a_unit(three):
    three.valves[1].reboot(three.devices.now_ns)
    result = three.run(30, 20e3, 40e3, 60e3)
    assert codes(result) == {("rebooted", "link0/chamber1 (unit B on port0)")}
    three.run(60, 20e3, 40e3, 60e3)
    assert three.devices.pressure_pa.max() < 500.0


def test_vent_after_a_failed_start_up_never_raises():
    bench = bench_of(2, line={"boot_timeout_s": 0.1})
    bench.valves[1].muted = True
    with fails(HardwareError, "0.1 s", device="link0/chamber1 (unit B on port0)", step="boot", code="silent"):
        bench.driver.configure()
    bench.driver.vent()
    bench.driver.close()


def test_silent_unit_does_not_hold_up_the_vent_of_the_others(three):
    three.valves[0].muted = True
    result = three.run(150, 20e3, 40e3, 60e3)
    assert codes(result) == {("device_silent", "link0/chamber0 (unit A on port0)")}
    assert [valve.setpoint for valve in three.valves[1:]] == [0.0, 0.0]
    sampled = np.sum([three.exchange(0.0).fresh for _ in range(100)], axis=0)
    assert sampled[0] == 0
    assert sampled[1:].min() > 20
    three.valves[0].muted = False
    three.driver.configure()
    assert three.run(120, 20e3, 40e3, 60e3).faults == ()


def test_hold_is_a_fault_while_it_lasts(three):
    three.valves[2].command("HP")
    result = three.run(10, 20e3, 40e3, 60e3)
    assert codes(result) == {("not_active", "link0/chamber2 (unit C on port0)")}
    three.valves[2].command("C")
    assert three.run(10, 20e3, 40e3, 60e3).faults == ()


def test_start_up_ends_a_hold():
    bench = bench_of(1)
    bench.valves[0].command("HC")
    bench.driver.configure()
    assert "> AC" in bench.log()
    assert not bench.valves[0].flags


def test_sensor_flags(three):
    three.valves[0].flags.add("POV")
    result = three.run(10, 20e3, 40e3, 60e3)
    assert codes(result) == {("sensor_failed", "link0/chamber0 (unit A on port0)")}
    three.valves[0].flags = {"MOV", "LCK"}
    assert three.run(10, 20e3, 40e3, 60e3).faults == ()
    three.valves[0].flags = {"TOV"}
    result = three.run(10, 20e3, 40e3, 60e3)
    assert codes(result) == {("over_temperature", "link0/chamber0 (unit A on port0)")}


def test_refused_set_point():
    """Devices whose full scale is lower than the platform says."""
    bench = SerialBench(alicat(3, **quiet(full_scale_pa=50e3)))
    bench.driver.configure()
    assert bench.run(120, 20e3, 40e3, 30e3).faults == ()
    seen = {code for _ in range(60) for code in codes(bench.exchange(20e3, 80e3, 30e3))}
    assert ("command_rejected", "link0/chamber1 (unit B on port0)") in seen


def test_reading_far_beyond_is_no_reading(three):
    before = three.driver.statistics.frames_garbled
    three.valves[0].frame = lambda: b"A +999.00 +020.00"
    result = three.run(1, 20e3, 40e3, 60e3)
    result = three.run(8, 20e3, 40e3, 60e3)
    assert three.driver.statistics.frames_garbled > before
    assert result.pressure_pa[0] < 25e3


# -- streams and the line --------------------------------------------------------------------------


@pytest.mark.parametrize("streaming", [0, 1, 2])
@pytest.mark.parametrize("baud", [19200, 115200])
def test_stream_is_stopped_at_start_up(streaming, baud):
    bench = bench_of(3, baud=baud)
    port = bench.ports[0]
    port.write(f"{'ABC'[streaming]}@ @\r\x16".encode())
    for _ in range(20):
        port.write(b"\x16")
    assert bench.valves[streaming].streaming
    assert port.read().replace(b"\x16", b"").count(b"@ +") >= 1
    bench.driver.configure()
    assert [valve.unit for valve in bench.valves] == ["A", "B", "C"]
    assert not any(valve.streaming for valve in bench.valves)
    assert bench.run(120, 20e3, 40e3, 60e3).faults == ()


class Endless(EmulatedAlicat):
    """One that nothing stops once it streams."""

    def __setattr__(self, name, value):
        if name != "streaming" or not getattr(self, name, False):
            super().__setattr__(name, value)


def test_stream_of_a_stranger_cannot_be_stopped():
    bench = bench_of(2)
    bench.devices.lines[0].station.units.append(Endless("Z", NEW, "kPaG", ValveSetup(100e3, lambda: 0.0)))
    bench.ports[0].write(b"Z@ @\r" + MARK)
    with fails(HardwareError, device="port0", step="streaming", code="flood"):
        bench.driver.configure()


def test_a_second_master_is_noticed_and_survived(three):
    line, bus = three.devices.lines[0], three.devices.lines[0].station
    before = three.driver.statistics
    assert (line.collisions, bus.hurried) == (0, 0), "the driver never talks into anything"
    line.to_devices = lambda chunk: chunk + b"B\r"
    three.run(1, 20e3, 40e3, 60e3)
    line.to_devices = lambda chunk: chunk
    three.run(60, 20e3, 40e3, 60e3)
    after = three.driver.statistics
    assert bus.hurried == 1
    assert after.frames_lost + after.frames_garbled > before.frames_lost + before.frames_garbled
    assert three.run(30, 20e3, 40e3, 60e3).faults == ()


def test_device_needs_an_idle_line_before_it_acts():
    bench = bench_of(1)
    line, bus = bench.devices.lines[0], bench.devices.lines[0].station
    line.feed(b"A\rA\r\x16")
    assert bus.hurried == 1
    assert bytes(line.output).count(b"A +") == 1
    line.output.clear()
    line.feed(b"A\r\n\x16")  # an LF after the CR is nothing
    assert bytes(line.output).count(b"A +") == 1


def test_emulated_commands():
    valve = bench_of(1).valves[0]
    valve.reading_pa = lambda: 12.3e3
    assert valve.command("") == [b"A +012.30 +000.00"]
    assert valve.command("S15") == [b"A +012.30 +015.00"]
    assert valve.command("LS 20.5") == [b"A +012.30 +020.50 14 kPaG"]
    assert valve.command("LS") == [b"A +012.30 +020.50 14 kPaG"]
    assert valve.command("64000") == [b"A +012.30 +103.40"]
    assert valve.command("S103.41") == [b"?"]
    assert valve.command("S-1") == [b"?"]
    assert valve.command("S1.2.3") == [b"?"]
    assert valve.command("HELLO") == [b"?"]
    assert valve.command("LSS") == [b"A S"]
    assert valve.command("LSS X") == [b"?"]
    assert valve.command("LSS A") == [b"A A"]
    assert valve.command("S10") == [b"A +012.30 +103.40"]
    assert valve.command("HP") == [b"A +012.30 +103.40 HLD"]
    assert valve.demand_pa() == 12.3e3
    assert valve.command("C") == [b"A +012.30 +103.40"]
    assert valve.command("NCS 20") == [b"A +012.30 +103.40"]
    assert valve.interval_ns == 20_000_000
    old = bench_of(1, OLD).valves[0]
    old.reading_pa = lambda: 0.0
    assert old.command("LS 5") == [b"A +000.00 +000.00 LCK"]
    assert old.command("U") == [b"A +000.00 +000.00"]
    assert old.command("W91=30") == [b"A +000.00 +000.00"]
    late = bench_of(1, LATE_8).valves[0]
    late.reading_pa = lambda: 0.0
    assert late.command("LS 5") == [b"A +000.00 +000.00"], "its data frame, and nothing is set"


@pytest.mark.parametrize(
    ("firmware", "answers"),
    [("5v12", True), ("6v21", True), ("7v09", True), ("8v17", False), ("8v30", True), ("10v20", True)],
)
def test_which_firmware_answers_ve_as_captured(firmware, answers):
    """8v17 alone is silent; the driver then reads its version from the manufacturer's table."""
    bench = bench_of(1, f"{firmware}.0-R23")
    assert bool(bench.valves[0].command("VE")) is answers
    bench.driver.configure()
    log = bench.log()
    assert ("> A??M*" in log) is not answers
    assert any(entry.startswith("> ALS") for entry in log) is (int(firmware.split("v")[0]) >= 9)


def test_identification_of_the_emulated_device():
    new, old = bench_of(1).valves[0], bench_of(1, OLD).valves[0]
    assert new.command("??M*")[4] == b"A  M04 Model Number PC-103KPAG-D"
    assert new.command("??M9") == [b"A  M09 Software Revision 10v20.0-R24"]
    assert new.command("FPF 6") == [b"A +103.40 14 kPaG"]
    assert new.command("FPF 15") == [b"A +000.00 1 ---"]
    assert old.command("FPF 6") == [b"?"]
    assert new.command("LV") == [b"A 38"]
    assert old.command("R122") == [b"A   122 = 38"]
    new.reading_pa = old.reading_pa = lambda: 0.0
    assert old.command("LV") == [b"A +000.00 +000.00 LCK"]
    assert old.command("$$U") == [b"A +000.00 +000.00"]
    assert new.command("$$S12") == [b"A +000.00 +012.00"]


def test_case_does_not_matter():
    bench = bench_of(1)
    bench.devices.lines[0].feed(b"as12.5\r" + b"\x16" * 3)
    assert bench.valves[0].setpoint == 12.5


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        (
            {"valves": [{"chamber": f"link0/chamber{n}", "unit": "A"} for n in range(2)]},
            ("", "valves:", "unit", "A"),
        ),
        ({"valves": [{"chamber": "link0/chamber0", "unit": "a"}]}, ("valves[0].unit", "'a'")),
        ({"valves": [{"chamber": "link0/chamber0", "unit": "AB"}]}, ("valves[0].unit", "'AB'")),
        ({"setpoint_command": "LS"}, ("setpoint_command", "'LS'")),
    ],
)
def test_bad_platform(changes, found):
    with fails(ConfigError, *found[1:], key=found[0]):
        alicat(**changes)
