"""What `soro doctor` says of every family: who is there, a wrong device, a wrong address."""

import socket
from pathlib import Path

import pytest
from board_bench import board_platform, veab_platform
from serial_bench import alicat, itv
from served_bench import served

from soro_hardware import doctor, load_platform
from soro_hardware.board import frames, messages
from soro_hardware.board.frames import BoardFrame, FrameType
from soro_hardware.families import FAMILIES

QUICK = {"boot_timeout_s": 0.3, "answer_timeout_s": 0.1, "check_s": 0.1}


def look(platform, address):
    """Findings by name, without starting anything."""
    return {finding.name: finding for finding in doctor.examine(platform, address, run_s=0.0)}


def test_itvs_answer_and_keep_their_set_points():
    platform = itv(2, line=QUICK)
    with served(platform) as (devices, address):
        devices.valves[1].setpoint = 200
        findings = look(platform, address)
        assert devices.valves[1].setpoint == 200
    ports = address.split(",")
    first, second = (findings[f"link0/chamber{n} ({ports[n]})"] for n in (0, 1))
    assert (first.level, second.level) == ("ok", "ok")
    assert "set point 0.0" in first.found
    assert "set point 19.6" in second.found
    assert findings["device watchdog"].level == "warn"
    assert "dump valve" in findings["device watchdog"].do
    assert findings["rate"].level == findings["age of readings"].level == "warn"


def test_alicats_tell_firmware_and_source():
    platform = alicat(2, line=QUICK)
    with served(platform) as (devices, address):
        devices.valves[1].ignore_setpoints(True)  # its source is another one
        findings = look(platform, address)
    first, second = (findings[f"link0/chamber{n} (unit {'AB'[n]} on {address})"] for n in (0, 1))
    assert first.level == "ok"
    assert first.found.startswith("firmware 10v20, 10 Pa a digit: set point 0.0, pressure ")
    assert second.level == "fail"
    assert "set point source" in second.found
    assert "settings" in second.do


@pytest.mark.slow
def test_a_line_with_other_devices_or_none_says_what_to_check():
    platform = itv(1, line=QUICK)
    with served(alicat(1)) as (_, address):
        findings = look(platform, address)
        assert findings[f"link0/chamber0 ({address})"].level == "fail"
        assert "9600 baud" in findings[f"link0/chamber0 ({address})"].do
        two = look(itv(2), address)
    assert two["port"].found == f"{address}: 1 ports named, the platform has 2"
    assert look(platform, "/dev/null")["port"].level == "fail"


@pytest.mark.process
def test_a_board_tells_who_it_is():
    platform = board_platform()
    with served(platform) as (_, address):
        findings = look(platform, address)
        assert findings["board"].level == "ok"
        assert "4 ports, watchdog 100 ms" in findings["board"].found
        narrow = look(board_platform(range={"maximum_pa": 50e3}), address)
        assert narrow["range on the board"].found == "port 0: 0 to 90 kPa on the board"
        wide = look(board_platform(ports=board_platform().model_dump()["ports"][:3]), address)
        assert (wide["board"].level, "number of ports" in wide["board"].found) == ("fail", True)


@pytest.mark.process
@pytest.mark.parametrize(
    ("options", "found", "do"),
    [
        ({}, "serves another host", "end the other driver"),
        ({"hosts": ["10.0.0.7"]}, "does not admit this host", "add this host's address to board.hosts there"),
    ],
)
def test_a_board_that_turns_this_host_away_says_what_to_do(options, found, do):
    platform = board_platform(board=options)
    with served(platform) as (_, address):
        host, port = address.split(":")
        with socket.create_connection((host, int(port))) as other:
            other.sendall(frames.encode(BoardFrame(FrameType.HELLO, 0, messages.pack_hello(4))))
            other.recv(1)  # it is let in, or told why not
            finding = look(platform, address)["board"]
    assert (finding.level, found in finding.found) == ("fail", True)
    assert do in finding.do


@pytest.mark.process
def test_a_board_is_not_the_published_server():
    with served(veab_platform()) as (_, address):
        finding = look(board_platform(), address)["board"]
    assert finding.level == "fail"
    assert "soro board" in finding.do


@pytest.mark.process
def test_the_published_server_is_not_touched_by_looking():
    platform = veab_platform()
    with served(platform) as (devices, address):
        findings = look(platform, address)
        assert not devices.line.hang_up
        assert not devices.line.refuses, "a client that leaves ends it"
    assert findings["published server"].level == "warn"
    started = {f.name: f for f in doctor.examine(platform, "127.0.0.1:9", run_s=0.1)}
    assert started["start-up"].level == "fail"
    assert started["start-up"].do == "start the server on the Pi, it ends with each client"
    assert list(started)[-1] == "start-up", "what comes later is left out"


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("emulated_canopen", "transport.device"),
        ("itv_serial", "`port` of every valve"),
        ("alicat_serial", "`port`"),
        ("veab_tcp", "transport.host"),
        ("soro_board", "transport.host"),
        ("vtem_modbus", "transport.host"),
    ],
)
def test_no_device_named(name, key):
    findings = look(load_platform(name), None)
    assert findings["device"].level == "fail"
    assert f"as {key} in the platform file" in findings["device"].do


def test_a_valve_without_a_port_is_named():
    valves = [{"chamber": f"link0/chamber{n}", "port": "/dev/ttyS0"} for n in range(1)]
    partly = itv(3, valves=[*valves, *({"chamber": f"link0/chamber{n}"} for n in (1, 2))])
    finding = look(partly, None)["device"]
    assert finding.found == "the platform file names no port for link0/chamber1, link0/chamber2"
    assert "`port` of every valve" in finding.do


def test_age_of_readings_against_what_the_devices_give():
    assert doctor.check_age(200.0, 0.02).level == "ok"
    slow = doctor.check_age(35.6, 0.208)
    assert (slow.level, "208 ms" in slow.found) == ("warn", True)
    assert doctor.check_age(5.0, 2.0).found == "a chamber without a reading for 500 ms vents the arm"
    none = doctor.check_age(2.3, 1.7)
    assert (none.level, "baud" in none.do) == ("fail", True)


def test_ports_in_a_folder_of_links(tmp_path):
    for number in range(2):
        (tmp_path / str(number)).symlink_to("/dev/null")
    names = [finding.found for finding in doctor.check_device(str(tmp_path))]
    assert names == [f"{tmp_path}/{number} may be opened" for number in range(2)]
    link = tmp_path / "tcp"
    link.symlink_to("127.0.0.1:8889")
    assert doctor.check_device(str(link)) == [], "an address, found out by opening it"


def test_what_each_family_was_tried_on_is_said_here_and_on_the_page():
    page = (Path(__file__).parents[2] / "docs/hardware.md").read_text(encoding="utf-8")
    for name, family in FAMILIES.items():
        assert f"| `{name}` | {family.tried_on} |" in page
    first = next(iter(doctor.examine(load_platform("emulated_canopen"), "nowhere", run_s=0.0)))
    assert (first.name, first.level) == ("family", "ok")
    assert first.found == f"canopen_408, tried on: {FAMILIES['canopen_408'].tried_on}"
