"""The process that vents when a driver without device watchdogs dies: real kills, real pseudo-terminals."""

import contextlib
import os
import select
import signal
import socket
import struct
import subprocess
import threading
import time
import tty
from functools import partial
from pathlib import Path

import pytest
from hardware_bench import cycles_in_real_time, driver_process, emulator, frames_until, wait_for
from serial_bench import alicat, itv, platform_file
from served_bench import served

from soro_core.errors import HardwareError
from soro_hardware import load_platform, open_regulator, supervisor
from soro_hardware.doctor import examine
from soro_hardware.emulation.faults.fault_types import read_injection
from soro_hardware.emulation.sockets.plant_link import PlantLinkClient
from soro_hardware.families import FAMILIES
from soro_hardware.serial_line.line.port import SerialPort
from soro_hardware.supervisor_client import Supervisor, VentPlan, running
from tests.patience import LIMIT_S
from tests.refused import fails

SHIPPED = {
    "canopen_408": "canopen_socketcan",
    "itv_rs232": "itv_serial",
    "alicat": "alicat_serial",
    "veab_tcp": "veab_tcp",
    "soro_board": "soro_board",
    "vtem_modbus": "vtem_modbus",
}


# Set point 0 and its echo, and a reading that shows the chamber empty.
ITV_STEPS = [
    {"send": "SET 0\r\n", "line": "0+", "of": "one"},
    {"send": "MON\r\n", "line": r"(\d+)", "low": -1.0, "high": 20.0, "of": "one"},
]


def is_running(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.process
def test_valves_vent_when_the_driver_hangs_and_it_knows_when_it_comes_back(tmp_path):
    """Stopped, in a call that does not return, or in a program that has forgotten to go on."""
    path = platform_file(tmp_path, itv())
    with emulator(tmp_path, platform=path) as served:
        regulator = open_regulator(itv(), str(served.device))
        regulator.configure()
        link = PlantLinkClient(served.plant)
        wait_for(
            lambda: cycles_in_real_time(regulator, 0.1, [30e3] * 3) and link.latest().pressures.max() > 25e3
        )
        frames_until(link, lambda frame: frame.pressures.max() < 5e3)
        wait_for(lambda: not regulator.supervisor.is_alive)
        faults = {fault.code for fault in cycles_in_real_time(regulator, 0.1, [30e3] * 3)[-1].faults}
        assert "supervisor_lost" in faults
        assert link.latest().pressures.max() < 5e3
        regulator.configure()
        wait_for(
            lambda: cycles_in_real_time(regulator, 0.1, [30e3] * 3) and link.latest().pressures.max() > 25e3
        )
        regulator.vent()
        time.sleep(2 * supervisor.SILENCE_S)  # nothing comes of it that could be waited for
        assert cycles_in_real_time(regulator, 0.1, [0.0] * 3)[-1].faults == (), "at rest it may be silent"
        regulator.close()
        link.close()


@pytest.mark.process
@pytest.mark.parametrize("make", [itv, alicat], ids=["itv", "alicat"])
def test_valves_vent_when_the_driver_is_killed(tmp_path, make):
    path = platform_file(tmp_path, make())
    with emulator(tmp_path, platform=path) as served:
        with driver_process(path, served.device) as host:
            (pid,) = map(int, Path(f"/proc/{host.pid}/task/{host.pid}/children").read_text().split())
            assert "supervisor.py" in Path(f"/proc/{pid}/cmdline").read_text()
            link = PlantLinkClient(served.plant)
            frames_until(link, lambda frame: frame.pressures[2] > 55e3)
            # As a terminal or systemd does to a whole group: it outlives the driver.
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
                os.kill(pid, number)
        # In time of the devices: a busy machine may stop the emulator.
        frames = [link.latest(), *frames_until(link, lambda frame: frame.pressures.max() < 5e3)]
        pressures = [frame.pressures[2] for frame in frames]
        assert max(pressures) > 50e3
        link.close()
        wait_for(lambda: not is_running(pid))  # and leaves the ports to the next driver
        regulator = open_regulator(make(), str(served.device))
        regulator.configure()
        assert regulator.exchange([0.0, 0.0, 0.0], time.monotonic_ns()).faults == ()
        regulator.close()


@pytest.mark.process
def test_orderly_end_leaves_nothing_to_do(tmp_path):
    with emulator(tmp_path, platform=platform_file(tmp_path, itv())) as served:
        regulator = open_regulator(itv(), str(served.device))
        regulator.configure()
        process = regulator.supervisor.process
        regulator.close()
        assert process.returncode == 0


NOT_EMPTY = "the driver ended and has not seen the arm empty; NOT ALL VENTED: open the dump valve"


@pytest.mark.process
@pytest.mark.parametrize(
    ("make", "pressure_pa"),
    [
        (itv, 0.0),
        (itv, 30e3),
        (alicat, 30e3),
        (lambda: load_platform("veab_tcp"), 30e3),
        (lambda: load_platform("vtem_modbus"), 0.0),
        (lambda: load_platform("vtem_modbus"), 30e3),
    ],
    ids=["itv, empty", "itv", "alicat", "veab", "vtem, empty", "vtem"],
)
def test_an_orderly_end_after_the_devices_have_gone_tells_what_is_known(make, pressure_pa, capfd):
    """Nothing of an arm that was seen empty; of another one, that it may hold its pressure."""
    with served(make()) as (_, address):
        regulator = open_regulator(make(), address)
        regulator.configure()
        target = [pressure_pa] * 3
        wait_for(
            lambda: abs(cycles_in_real_time(regulator, 0.1, target)[-1].pressure_pa - pressure_pa).max() < 5e3
        )
    regulator.close()
    said = capfd.readouterr().err
    assert "died" not in said
    assert ("NOT ALL VENTED: open the dump valve" in said) == bool(said) == (pressure_pa > 0.0)


@pytest.mark.process
@pytest.mark.parametrize("make", [itv, alicat], ids=["itv", "alicat"])
def test_a_valve_that_takes_zero_and_keeps_its_pressure_is_not_called_vented(make, capfd):
    """The echo of a set point shows no empty chamber; what is read back does."""
    with served(make()) as (devices, address):
        regulator = open_regulator(make(), address)
        regulator.configure()
        devices.faults.add(read_injection("fault: stuck_at, pressure_pa: 30e3, chamber: link0/chamber1"))
        wait_for(lambda: cycles_in_real_time(regulator, 0.1, [0.0] * 3)[-1].pressure_pa[1] > 20e3)
        process = regulator.supervisor.process
        started_s = time.monotonic()
        regulator.close()
        assert time.monotonic() - started_s < 5.0
        assert process.wait(LIMIT_S) == 1
    said = capfd.readouterr().err
    assert NOT_EMPTY in said
    assert "MON" in said or "B" in said, "what was not confirmed is named"


@pytest.mark.process
@pytest.mark.parametrize("make", [itv, alicat], ids=["itv", "alicat"])
def test_a_set_point_that_comes_at_rest_is_gone_before_the_end(make, capfd):
    """In real time, by its front panel or its power-up set point: sent zero again, latched, seen empty."""
    with served(make()) as (devices, address):
        regulator = open_regulator(make(), address)
        regulator.configure()
        cycles_in_real_time(regulator, 0.3, [0.0] * 3)
        devices.valves[1].give(60e3)
        wait_for(lambda: cycles_in_real_time(regulator, 0.1, [0.0] * 3)[-1].faults)
        codes = {(fault.code, fault.source.split()[0]) for fault in regulator.latched}
        assert codes == {("rebooted", "link0/chamber1")}
        wait_for(lambda: cycles_in_real_time(regulator, 0.1, [0.0] * 3) and devices.pressure_pa.max() < 2e3)
        devices.valves[0].give(60e3)  # and once more, now that it is latched
        wait_for(lambda: devices.pressure_pa.max() > 5e3)
        regulator.close()
        assert devices.valves[0].demand_pa() == 0.0
        assert devices.pressure_pa.max() < 2.5e3
    assert capfd.readouterr().err == ""


@pytest.mark.process
def test_its_death_is_a_fault(tmp_path):
    with emulator(tmp_path, platform=platform_file(tmp_path, itv())) as served:
        regulator = open_regulator(itv(), str(served.device))
        regulator.configure()
        regulator.supervisor.process.kill()
        regulator.supervisor.process.wait(LIMIT_S)
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


def held(plan, descriptor, monkeypatch):
    """A supervisor with a plan for a descriptor, whose messages can be read from its process's `stderr`."""
    popen = partial(subprocess.Popen, stderr=subprocess.PIPE)
    monkeypatch.setattr("soro_hardware.supervisor_client.subprocess.Popen", popen)
    process = Supervisor()
    process.hold([plan], [descriptor])
    return process


def end_of(process):
    """Exit status and messages of a supervisor whose driver has gone."""
    status = process.process.wait(LIMIT_S)
    with process.process.stderr as messages:
        return status, messages.read().decode()


def heard_by(line, text, times):
    """Read a line until something has come so many times."""
    heard = b""
    while heard.count(text) < times:
        heard += os.read(line.master, 4096)
    return heard


def plan_of(timeout_s=0.02, **step):
    return VentPlan("/dev/test", ({"line": "0+", **step},), timeout_s, 20 * timeout_s, begin="\r\n")


@pytest.mark.process
def test_repeats_until_it_is_confirmed(line, monkeypatch):
    process = held(plan_of(send="SET 0\r\n", timeout_s=0.5), line.slave, monkeypatch)
    process.control.close()
    heard = heard_by(line, b"SET 0\r\n", 1)
    os.write(line.master, b"512\r\nUNKNOWN COMMAND\r\n0")  # not the answer, or not all of it
    heard += heard_by(line, b"SET 0\r\n", 1)
    os.write(line.master, b"0\r\n")
    status, text = end_of(process)
    assert status == 0
    assert heard.startswith(b"\r\n")  # ends what the driver may have started
    assert "the driver died; vented" in text


@pytest.mark.process
def test_says_what_it_could_not_vent(line, monkeypatch):
    process = held(plan_of(send="AS0\r", timeout_s=0.001), line.slave, monkeypatch)
    process.control.close()
    status, text = end_of(process)
    assert status == 1
    assert "/dev/test: not confirmed: 'AS0\\r'" in text
    assert "NOT ALL VENTED: open the dump valve" in text


@pytest.mark.process
def test_tells_a_driver_that_has_ended_in_order_from_one_that_died(line, monkeypatch):
    process = held(plan_of(send="AS0\r", timeout_s=0.001), line.slave, monkeypatch)
    process.dismiss(vented=False)
    status, text = end_of(process)
    assert status == 1
    assert NOT_EMPTY in text
    assert "died" not in text


@pytest.mark.process
def test_tells_silence_from_death(line, monkeypatch):
    """The driver may be alive and have lost its connection: then it sends nothing."""
    process = held(plan_of(send="AS0\r", timeout_s=0.001), line.slave, monkeypatch)
    process.watches(pressed=True)
    status, text = end_of(process)
    process.dismiss()
    assert status == 1
    assert "no set points for 0.3 s; NOT ALL VENTED" in text
    assert "died" not in text


@pytest.mark.process
def test_one_that_vents_is_not_taken_again(line, monkeypatch):
    """It shares the connection with the driver that comes back, and would end with it."""
    first = held(plan_of(send="SET 0\r\n", timeout_s=5.0), line.slave, monkeypatch)
    first.watches(pressed=True)
    heard_by(line, b"SET 0\r\n", 1)  # after 0.3 s of silence
    assert first.process.poll() is None, "it still waits for the answer"
    second = running(first)
    assert first.process.poll() is not None
    assert second is not first
    second.hold([plan_of(send="SET 0\r\n")], [line.slave])
    assert second.watches(pressed=True)
    second.dismiss()
    assert end_of(second) == (0, "")
    first.process.stderr.close()


@pytest.mark.process
def test_a_port_that_has_gone_is_named(line, monkeypatch):
    process = held(plan_of(send="SET 0\r\n"), line.slave, monkeypatch)
    os.close(line.master)
    process.control.close()
    status, text = end_of(process)
    line.master = os.open("/dev/null", os.O_RDONLY)
    assert status == 1
    assert "/dev/test: " in text


@pytest.mark.process
def test_keeps_the_drivers_lock_until_it_has_vented(line, monkeypatch):
    """Nobody else speaks to the valves in between; the driver itself may close and open its ports again."""
    port = SerialPort(line.path, 9600)
    process = held(plan_of(send="SET 0\r\n", timeout_s=5.0), port.fileno(), monkeypatch)
    port.close()
    port = SerialPort(line.path, 9600)
    process.hold([plan_of(send="SET 0\r\n", timeout_s=5.0)], [port.fileno()])
    process.control.close()
    # As by a kill, without a word to the lock; the number stays the port's, which closes it once more.
    with open(os.devnull) as nothing:
        os.dup2(nothing.fileno(), port.fileno())
    heard_by(line, b"SET 0\r\n", 1)
    with fails(HardwareError, device=line.path, code="open"):
        SerialPort(line.path, 9600)
    os.write(line.master, b"0\r\n")
    assert end_of(process)[0] == 0
    SerialPort(line.path, 9600).close()


@pytest.mark.process
def test_a_plan_that_cannot_be_handed_over_is_an_error_not_a_hope(line, monkeypatch):
    """Without it the process waits with nothing in its hands, and is alive all the same."""
    process = held(plan_of(send="SET 0\r\n"), line.slave, monkeypatch)
    with fails(HardwareError, device="supervisor", code="open"):
        process.hold([plan_of(send="x" * 2_000_000)], [line.slave])
    process.dismiss()
    process.process.stderr.close()


@pytest.mark.process
def test_lets_go_and_has_nothing_to_do(line, monkeypatch):
    process = held(plan_of(send="SET 0\r\n"), line.slave, monkeypatch)
    process.release()
    process.control.close()
    assert end_of(process) == (0, "")


@pytest.mark.process
@pytest.mark.timeout(120)
def test_an_arm_that_was_not_seen_empty_and_that_no_line_reaches_is_named(line, monkeypatch):
    """The lines have gone before the driver's end, or a start-up has failed."""
    process = held(plan_of(send="SET 0\r\n"), line.slave, monkeypatch)
    process.release()
    process.dismiss(vented=False)
    code, said = end_of(process)
    assert code == 1
    assert "has not seen the arm empty; NOT ALL VENTED: open the dump valve" in said


def test_a_device_that_never_stops_sending_does_not_keep_it_from_venting(monkeypatch):
    ours, theirs = socket.socketpair()
    step = {"send": "\x00", "doubles": 12, "low": 4.75, "high": 5.25}
    entry = {"name": "x", "begin": "", "steps": [step], "timeout_s": 0.02, "least_s": 0.0, "longest_s": 0.5}
    with monkeypatch.context() as flood, ours, theirs:
        flood.setattr(supervisor.os, "read", lambda descriptor, size: b"x" * size)
        theirs.sendall(b"x")  # readable
        assert not supervisor.vent_line(entry, ours.fileno())
        assert len(theirs.recv(1000)) > 5, "sent again and again"


def test_a_line_that_takes_no_more_is_tried_again(line, monkeypatch):
    """What the driver had sent last may still stand in its way."""
    os.set_blocking(line.master, False)
    write, refused = os.write, []

    def full_at_first(descriptor, data):
        if descriptor == line.slave and len(refused) < 3:
            refused.append(data)
            raise BlockingIOError
        return write(descriptor, data)

    write(line.master, b"0\r\n" * 3)
    monkeypatch.setattr(supervisor.os, "write", full_at_first)
    entry = {"name": "x", "begin": "\r\n", "least_s": 0.0, "longest_s": 0.3, "timeout_s": 0.02}
    supervisor.vent_line({**entry, "steps": [{"send": "SET 0\r\n", "line": "0+"}]}, line.slave)
    assert b"SET 0\r\n" in os.read(line.master, 4096)


@pytest.mark.parametrize("lost", range(8))
def test_readings_of_numbers_count_wherever_they_begin(lost):
    """A VEAB server's stream has no frames, and the driver may have read a part of a message."""
    step = {"doubles": 3, "low": 4.75, "high": 5.25}
    empty, full = struct.pack("<3d", 5.0, 5.05, 4.95), struct.pack("<3d", 8.0, 8.0, 8.0)
    assert supervisor.confirms(step, full[lost:] + empty)
    assert not supervisor.confirms(step, full[lost:] + empty[:-1])
    assert not supervisor.confirms(step, full[lost:] + full)


def test_numbers_of_a_line_must_be_within_bounds():
    step = {"line": r"A +(\S+) +[+]?0+(?:\.0+)?", "low": -2.0, "high": 2.0}
    assert supervisor.confirms(step, b"A +001.90 +000.00\r")
    assert supervisor.confirms(step, b"\r\nA -001.90 +000.00\r\n")
    assert not supervisor.confirms(step, b"A +030.00 +000.00\rA -001.90 +000.00\r"), (
        "one is of another request"
    )
    assert not supervisor.confirms(step, b"A +002.10 +000.00\r")
    assert not supervisor.confirms(step, b"A +001.90 +015.00\r")


def test_a_device_is_done_when_zero_and_an_empty_chamber_are_confirmed_in_one_round(line):
    """Its set point may be changed by another one while its chamber is still on its way down."""
    answers = iter([b"0\r\n", b"300\r\n", b"7\r\n", b"5\r\n", b"0\r\n", b"5\r\n"])
    sent = []

    def device():
        for answer in answers:
            sent.append(os.read(line.master, 100))
            os.write(line.master, answer)

    entry = {"name": "x", "begin": "", "least_s": 0.0, "longest_s": 5.0, "timeout_s": 0.3}
    thread = threading.Thread(target=device)
    thread.start()
    assert supervisor.vent_line({**entry, "steps": ITV_STEPS}, line.slave)
    thread.join()
    assert sent == [b"SET 0\r\n", b"MON\r\n"] * 3


@pytest.mark.parametrize("together", [True, False], ids=["in one piece", "in two"])
def test_what_a_device_says_late_is_no_answer_to_what_it_is_asked_now(line, together):
    """It stands still for two requests: the echo of a later zero must not pass for an empty chamber."""
    late = [b"0\r\n", b"300\r\n0\r\n300\r\n"] if together else [b"0\r\n300\r\n", b"0\r\n300\r\n"]
    ended = threading.Event()

    def device():
        requests = 0
        while not ended.is_set():
            if not select.select([line.master], [], [], 0.01)[0]:
                continue
            asked = os.read(line.master, 100)
            requests += 1
            if requests > 4:
                os.write(line.master, b"0\r\n" if asked.startswith(b"SET") else b"300\r\n")
            elif requests > 2:
                first, _, rest = late[requests - 3].partition(b"\n")
                os.write(line.master, first + b"\n")
                time.sleep(0.005)  # what follows comes while the next request is under way
                os.write(line.master, rest)

    entry = {"name": "x", "begin": "", "least_s": 0.0, "longest_s": 1.0, "timeout_s": 0.05}
    thread = threading.Thread(target=device)
    thread.start()
    try:
        assert not supervisor.vent_line({**entry, "steps": ITV_STEPS}, line.slave)
    finally:
        ended.set()
        thread.join()


def test_the_end_of_a_line_that_comes_apart_is_no_late_answer(line):
    def device():
        for answer in (b"0", b"5"):
            os.read(line.master, 100)
            os.write(line.master, answer + b"\r")
            time.sleep(0.005)
            os.write(line.master, b"\n")

    entry = {"name": "x", "begin": "", "least_s": 0.0, "longest_s": 1.0, "timeout_s": 0.5}
    thread = threading.Thread(target=device)
    thread.start()
    assert supervisor.vent_line({**entry, "steps": ITV_STEPS}, line.slave)
    thread.join()


def test_an_answer_of_bytes_counts_whole_and_between_others():
    step = {"bytes": "\xff\xff\x00[\x00-\x10]"}
    assert supervisor.confirms(step, b"late\xff\xff\x00\x10and more")
    assert not supervisor.confirms(step, b"\xff\xff\x00")


@pytest.mark.process
def test_numbers_are_sent_until_they_have_been_read_late_enough(monkeypatch):
    """Readings on their way may be older than the set points."""
    ours, theirs = socket.socketpair()
    ours.setblocking(False)
    step = {"send": "\x00\xe0\x3f", "doubles": 1, "low": 4.75, "high": 5.25}
    process = held(VentPlan("server", (step,), 0.01, 10.0, least_s=0.1), ours.fileno(), monkeypatch)
    ours.close()
    process.control.close()
    sent = []
    with theirs, contextlib.suppress(ConnectionResetError, BrokenPipeError):
        while chunk := theirs.recv(3):
            sent.append(chunk)
            theirs.send(struct.pack("<d", 5.0))
    assert end_of(process)[0] == 0
    assert len(sent) > 5, "confirmed at once, and sent on"
    assert set(sent) == {b"\x00\xe0\x3f"}


@pytest.mark.process
def test_client_survives_a_dead_process():
    process = Supervisor()
    process.wait_until_ready()
    process.process.kill()
    process.process.wait(LIMIT_S)
    assert not process.is_alive
    process.hold([], [])
    process.release()
    process.dismiss()
    process.dismiss()


@pytest.mark.process
def test_client_names_a_process_that_never_was_ready():
    process = Supervisor()
    process.process.kill()
    process.process.wait(LIMIT_S)
    with contextlib.suppress(OSError):
        process.control.recv(16)  # it may have been quicker
    with fails(HardwareError, device="supervisor", code="gone"):
        process.hold([], [])
    process.dismiss()


@pytest.mark.process
def test_client_names_a_process_that_is_not_ready_in_time(monkeypatch):
    process = Supervisor()
    assert select.select([process.control], [], [], LIMIT_S)[0]
    assert process.control.recv(16)  # which the client then misses
    monkeypatch.setattr("soro_hardware.supervisor_client.START_LIMIT_S", 0.05)
    with fails(HardwareError, device="supervisor", code="silent"):
        process.hold([], [])
    process.dismiss()


@pytest.mark.parametrize("family", FAMILIES)
def test_doctor_asks_for_a_dump_valve_where_the_supervisor_is_the_last_line(family):
    platform = load_platform(SHIPPED[family])
    found = examine(platform, "127.0.0.1:1", run_s=0.0)
    finding = next(finding for finding in found if finding.name == "device watchdog")
    needs = family in ("itv_rs232", "alicat", "veab_tcp", "vtem_modbus")
    assert finding.level == ("warn" if needs else "ok")
    assert ("a normally open dump valve is needed" in finding.do) is needs
