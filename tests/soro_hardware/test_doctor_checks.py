"""The checks of `soro doctor` that need nothing opened: what each finds, and what to do about it."""

import grp
import re
import resource

import numpy as np
import pytest
from board_bench import veab_platform
from hardware_bench import Bench, platform
from serial_bench import alicat, itv
from vtem_bench import vtem_platform

from soro_hardware import doctor
from soro_hardware.canopen import probe
from soro_hardware.canopen.budget import cycle_bits, highest_rate_hz, serial_rate_hz
from soro_hardware.finding import Finding

TWELVE = [{"chamber": f"link{n // 3}/chamber{n % 3}", "node": n + 1} for n in range(12)]
QUADS = [{"chamber": f"link{n // 3}/chamber{n % 3}", "node": n // 4 + 1, "channel": n % 4} for n in range(12)]


# Bus budget ---------------------------------------------------------------------------------------


def test_bits_of_a_cycle_are_those_of_the_budget():
    """12 single-valve nodes cannot exceed 428 Hz at 1 Mbit/s, 3 four-channel nodes 1156 Hz."""
    singles = platform(valves=TWELVE)
    quads = platform(valves=QUADS, canopen={"mapping": {"device": "cia408_4ch"}})
    assert cycle_bits(singles) == 2335
    assert cycle_bits(quads) == 865
    assert highest_rate_hz(singles) == pytest.approx(428.27, abs=0.01)
    assert highest_rate_hz(quads) == pytest.approx(1156.07, abs=0.01)
    assert serial_rate_hz(singles, 115_200) == pytest.approx(33.7, abs=0.1)


@pytest.mark.parametrize(("hz", "level"), [(256.0, "ok"), (258.0, "warn"), (428.0, "warn"), (430.0, "fail")])
def test_rate_against_the_bus(hz, level):
    finding = probe.check_budget(2335, 1e6 / 2335, hz, 1_000_000)
    assert finding.level == level
    assert "2335 bits" in finding.found
    assert ("257" in finding.do) == (level != "ok")


def test_rate_against_a_real_serial_line():
    slow = platform(valves=TWELVE, transport={"kind": "slcan", "serial_baud": 115_200})
    (finding,) = probe.check_serial("/dev/ttyUSB0", slow)
    assert finding.level == "fail"
    assert re.findall(r"\d+", finding.found) == ["115200", "34", "200"]
    assert list(probe.check_serial("/dev/pts/3", slow)) == [], "a pseudo-terminal has no baud rate"
    quick = platform(valves=TWELVE, transport={"kind": "slcan", "serial_baud": 1_000_000})
    assert next(iter(probe.check_serial("/dev/ttyUSB0", quick))).level == "ok"


def test_what_the_adapter_lets_its_host_see():
    assert probe.check_acknowledgement(True).level == "ok"
    assert probe.check_acknowledgement(False).level == "warn"


def test_transmit_queue_of_a_kernel_interface():
    kernel = platform(valves=TWELVE, transport={"kind": "socketcan", "channel": "can0"})
    device = Bench(kernel).driver.device
    finding = probe.check_queue(10, kernel, device)
    assert finding.level == "warn"
    assert re.findall(r"\d+", finding.found) == ["10", "14"]
    assert finding.do == "`sudo ip link set can0 txqueuelen 64`"
    assert probe.check_queue(64, kernel, device).level == "ok"


# Checks by themselves -----------------------------------------------------------------------------


def test_range_beside_rating_and_default_limits():
    assert doctor.check_range(platform()) == Finding(
        "pressure range", "ok", "0 to 90 kPa, rated below 100 kPa"
    )
    narrow = doctor.check_range(platform(range={"maximum_pa": 50e3}))
    assert (narrow.level, "90 kPa" in narrow.found) == ("warn", True)
    assert narrow.do == "`limits: {maximum_pa: 50000}` in the scene (--scene looks there)"
    weak = doctor.check_range(platform(rating={"maximum_pa": 91e3}))
    assert weak.level == "warn"
    assert weak.do.startswith("in the scene, limits.over_pressure_pa: at most 95550")


def test_rate_of_the_line():
    assert doctor.check_update(platform(), 200.0).level == "ok"
    slow = doctor.check_update(platform(), 31.0)
    assert (slow.level, "31 times a second" in slow.found) == ("warn", True)


def test_a_device_without_watchdog_needs_a_dump_valve():
    assert doctor.check_watchdog(platform(), True).level == "ok"
    finding = doctor.check_watchdog(itv(1), False)
    assert (finding.level, "300 ms" in finding.found) == ("warn", True)
    assert "dump valve" in finding.do


@pytest.mark.parametrize(
    ("unwatched", "key"),
    [
        (itv(1, line={"supervisor": False}), "line.supervisor"),
        (alicat(1, line={"supervisor": False}), "line.supervisor"),
        (veab_platform(host={"supervisor": False}), "host.supervisor"),
        (vtem_platform(host={"supervisor": False}), "host.supervisor"),
    ],
    ids=lambda value: getattr(value, "family", ""),
)
def test_a_driver_that_nobody_vents_after_is_a_failure(unwatched, key):
    finding = doctor.check_watchdog(unwatched, False)
    assert finding.level == "fail"
    assert f"`{key}: true`" in finding.do
    assert "dump valve" in finding.do


@pytest.mark.parametrize(
    ("soft", "root", "level"),
    [
        (0, False, "warn"),
        (10, False, "warn"),
        (30, False, "ok"),
        (resource.RLIM_INFINITY, False, "ok"),
        (0, True, "ok"),
    ],
)
def test_real_time_priority(soft, root, level):
    finding = doctor.check_real_time(soft, soft, root)
    assert finding.level == level
    assert ("rtprio" in finding.do) == (level == "warn")


def test_device_files(tmp_path):
    assert doctor.check_device("127.0.0.1:29536") == [], "found out by opening it"
    assert doctor.check_device("can0") == []
    missing = doctor.check_device(str(tmp_path / "ttyACM0"))[0]
    assert (missing.level, "does not exist" in missing.found) == ("fail", True)
    assert doctor.check_device("/dev/null,/dev/zero") == [
        Finding("device", "ok", "/dev/null may be opened"),
        Finding("device", "ok", "/dev/zero may be opened"),
    ]


def test_a_folder_that_no_emulator_made_is_one_line(tmp_path):
    for name in ("ttyS0", "ttyS1", "random"):
        (tmp_path / name).touch()
    (finding,) = doctor.check_device(str(tmp_path))
    assert (finding.level, finding.found) == ("fail", f"{tmp_path} is a folder")


def test_a_forbidden_device_names_its_group(tmp_path):
    path = tmp_path / "ttyACM0"
    path.touch()
    finding = doctor.check_path(path, may_open=False)
    assert finding.level == "fail"
    number = path.stat().st_gid
    group = {one.gr_gid: one.gr_name for one in grp.getgrall()}.get(number, str(number))
    assert f"usermod -aG {group} " in finding.do


@pytest.mark.parametrize(
    ("pressure", "level"),
    [(0.0, "ok"), (-1.9e3, "ok"), (2.1e3, "warn"), (-5.1e3, "fail"), (60e3, "fail"), (np.nan, "fail")],
)
def test_offsets_at_rest(pressure, level):
    (finding,) = doctor.check_offsets(("link0/chamber0",), np.array([pressure]), np.array([100.0]))
    assert finding.level == level
    assert finding.name == "offset of link0/chamber0"


@pytest.mark.parametrize(
    ("cycles", "took", "lost", "level"), [(200, 1.0, 0, "ok"), (200, 1.0, 3, "warn"), (200, 1.3, 0, "warn")]
)
def test_run(cycles, took, lost, level):
    assert doctor.check_run(cycles, took, 200.0, lost).level == level
