"""`soro doctor`: every check says what was found and what to do; on emulated devices; exit status, JSON."""

import json
import os
import resource
from pathlib import Path

import numpy as np
import pytest
import typer
from hardware_bench import Bench, emulator, platform, platform_file, single
from typer.testing import CliRunner

from soro_core.errors import ConfigError
from soro_core.hardware import doctor, load_platform
from soro_core.hardware.canopen import frames, probe
from soro_core.hardware.canopen.budget import cycle_bits, highest_rate_hz, serial_rate_hz
from soro_core.hardware.finding import Finding
from soro_core.hardware.transport.frame import Frame
from soro_ros.commands.doctor import doctor as command

TWELVE = [{"chamber": f"link{n // 3}/chamber{n % 3}", "node": n + 1} for n in range(12)]
QUADS = [{"chamber": f"link{n // 3}/chamber{n % 3}", "node": n // 4 + 1, "channel": n % 4} for n in range(12)]


def by_name(findings):
    return {finding.name: finding for finding in findings}


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
    assert "34 cycles/s, 200 are asked for" in finding.found
    assert list(probe.check_serial("/dev/pts/3", slow)) == [], "a pseudo-terminal has no baud rate"
    quick = platform(valves=TWELVE, transport={"kind": "slcan", "serial_baud": 1_000_000})
    assert next(iter(probe.check_serial("/dev/ttyUSB0", quick))).level == "ok"


def test_transmit_queue_of_a_kernel_interface():
    kernel = platform(valves=TWELVE, transport={"kind": "socketcan", "channel": "can0"})
    device = Bench(kernel).driver.device
    finding = probe.check_queue(10, kernel, device)
    assert (finding.level, finding.found) == ("warn", "10 frames, a cycle sends 14 at once")
    assert finding.do == "`sudo ip link set can0 txqueuelen 64`"
    assert probe.check_queue(64, kernel, device).level == "ok"


# Checks by themselves -----------------------------------------------------------------------------


def test_range_and_rate_of_the_line():
    assert doctor.check_range(platform()).level == "ok"
    assert doctor.check_update(platform(), 200.0).level == "ok"
    slow = doctor.check_update(platform(), 31.0)
    assert (slow.level, "31 times a second" in slow.found) == ("warn", True)


def test_a_device_without_watchdog_needs_a_dump_valve():
    assert doctor.check_watchdog(True).level == "ok"
    finding = doctor.check_watchdog(False)
    assert (finding.level, "hold their last set point" in finding.found) == ("warn", True)
    assert "normally open dump valve" in finding.do


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
    assert doctor.check_device(None)[0].level == "fail"
    assert doctor.check_device("127.0.0.1:29536") == [], "found out by opening it"
    assert doctor.check_device("can0") == []
    missing = doctor.check_device(str(tmp_path / "ttyACM0"))[0]
    assert (missing.level, "does not exist" in missing.found) == ("fail", True)
    assert doctor.check_device("/dev/null,/dev/zero") == [
        Finding("device", "ok", "/dev/null may be opened"),
        Finding("device", "ok", "/dev/zero may be opened"),
    ]


def test_a_forbidden_device_names_its_group(tmp_path):
    path = tmp_path / "ttyACM0"
    path.touch()
    finding = doctor.check_path(path, may_open=False)
    assert finding.level == "fail"
    assert "usermod -aG" in finding.do
    group = doctor._group(os.stat(path).st_gid)
    assert group in finding.do


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


# On emulated devices ------------------------------------------------------------------------------


def examine(bench):
    return by_name(
        probe.probe(
            bench.platform,
            bench.driver.device,
            bench.driver._link,
            bench.driver.clients(),
            None,
            iter(np.arange(0.0, 100.0, 0.1)).__next__,
        )
    )


@pytest.mark.parametrize("where", ["probe", "configure", "exchange"])
def test_the_devices_are_closed_when_the_examination_is_interrupted(monkeypatch, where):
    bench = Bench(platform())
    closed = []
    monkeypatch.setattr(doctor, "open_regulator", lambda *_: bench.driver)
    monkeypatch.setattr(bench.driver, "probe", lambda: iter(()))
    monkeypatch.setattr(bench.driver, "close", lambda: closed.append(True))
    monkeypatch.setattr(bench.driver, where, lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        list(doctor.examine(platform(), "can0", 0.02))
    assert closed == [True]


def test_healthy_bus():
    findings = examine(Bench(platform()))
    assert {finding.level for finding in findings.values()} == {"ok"}
    assert "profile 408, vendor 0x0, product 0x408, 10 Pa a count, init" in findings["node 2"].found


def test_looking_changes_no_node(arm):
    states = [node.state for node in arm.world.nodes]
    before = [node.valve.state for node in arm.world.nodes]
    arm.bus.take_log()
    examine(arm)
    writes = [line for line in arm.bus.take_log() if line[0] == ">" and line.split()[3] != "40"]
    assert writes == []
    assert [node.state for node in arm.world.nodes] == states
    assert [node.valve.state for node in arm.world.nodes] == before


QUICK = {"boot_timeout_s": 0.01, "sdo_timeout_s": 0.01, "sdo_retries": 0}


@pytest.mark.parametrize(
    ("what", "found", "do"),
    [
        ("absent", "no answer for 0.01 s", "terminators"),
        ("profile", "the device has profile 401, not 408", "canopen.mapping"),
        ("unit", "unit 0x33", "canopen.full_scale_pa"),
    ],
)
def test_a_bad_node_fails_with_what_to_do(what, found, do):
    bench = Bench(platform(canopen=QUICK))
    if what == "absent":
        bench.bus.swallow = {0x582}
    elif what == "profile":
        bench.world.nodes[1].dictionary.values[0x1000, 0] = 401
    else:
        bench.world.nodes[1].dictionary.values[0x6380, 2] = 0x33
    findings = examine(bench)
    assert findings["node 2"].level == "fail"
    assert found in findings["node 2"].found
    assert do in findings["node 2"].do
    assert findings["node 1"].level == findings["node 3"].level == "ok", "the others are asked too"


def test_wrong_product():
    findings = examine(Bench(single(canopen={"product_code": 7})))
    assert "product 0x408, the platform asks for 0x7" in findings["node 1"].found


def test_other_hosts_and_other_nodes_are_named():
    bench = Bench(platform())
    bench.bus.inject(frames.heartbeat(127, frames.NmtState.OPERATIONAL))
    bench.bus.inject(frames.heartbeat(9, frames.NmtState.PRE_OPERATIONAL))
    bench.bus.inject(frames.heartbeat(2, frames.NmtState.PRE_OPERATIONAL))
    bench.bus.inject(Frame(0x7E5, bytes(8)))
    findings = examine(bench)
    assert findings["other hosts"].level == "fail"
    assert findings["other nodes"].found == "not in the platform: 9 (pre-operational)"


def test_a_coupler_without_watchdog_is_told():
    scaling = {"kind": "fixed", "setpoint": {"pa_per_count": 10.0}, "reading": {"pa_per_count": 10.0}}
    coupler = platform(canopen={"mapping": {"device": "aventics_aes", "scaling": scaling}})
    bench = Bench(coupler)
    assert examine(bench)["watchdogs of the device"].level == "warn"
    assert bench.driver.device_watchdog is False
    assert Bench(platform()).driver.device_watchdog is True


# The command --------------------------------------------------------------------------------------


PATIENT = {"cycle_budget_s": 0.1, "canopen": {"heartbeat_consumer_s": 1.0, "stale_cycles": 100}}


@pytest.fixture
def run():
    app = typer.Typer()
    app.command()(command)

    def call(*arguments):
        wide = {"COLUMNS": "200", "NO_COLOR": "1", "TERM": "dumb"}
        return CliRunner().invoke(app, [str(a) for a in arguments], env=wide)

    return call


def test_doctor_on_an_emulator(run, tmp_path):
    path = platform_file(tmp_path, **PATIENT)
    with emulator(tmp_path, platform=path) as served:
        done = run(path, "--device", served.device, "--seconds", 0.2, "--json")
        assert done.exit_code == 0, done.output
        findings = {entry["name"]: entry for entry in json.loads(done.output)}
        assert findings["start-up"]["level"] == "ok"
        assert findings["node 3"]["level"] == "ok"
        assert abs(float(findings["offset of link0/chamber0"]["found"].split()[0])) < 0.5
        shown = run(path, "--device", served.device, "--seconds", 0)
        assert shown.exit_code == 0
        for text in ("bus budget", "625 bits a cycle", "node 1", "0 failed"):
            assert text in shown.output
        assert "start-up" not in shown.output, "looking only"


def test_doctor_with_an_offset_sensor(run, tmp_path):
    path = platform_file(tmp_path, **PATIENT)
    fault = "{fault: sensor_offset, chamber: link0/chamber1, offset_pa: 8000.0}"
    with emulator(tmp_path, "--fault", fault, platform=path) as served:
        done = run(path, "--device", served.device, "--seconds", 0.2, "--json")
    assert done.exit_code == 1
    findings = {entry["name"]: entry for entry in json.loads(done.output)}
    assert findings["offset of link0/chamber1"]["level"] == "fail"
    assert findings["offset of link0/chamber0"]["level"] == "ok"


def test_doctor_without_an_adapter(run, tmp_path):
    done = run(platform_file(tmp_path), "--device", tmp_path / "none")
    assert done.exit_code == 1
    assert "does not exist" in done.output
    assert "/dev/serial/by-id" in done.output
    bad = run("nowhere")
    assert isinstance(bad.exception, ConfigError)  # which `soro` tells as it tells all
    assert len(str(bad.exception).splitlines()) == 1


def test_two_programs_on_one_adapter(tmp_path):
    """The second one is refused; it would take the adapter off the bus."""
    from hardware_bench import driver

    with emulator(tmp_path, "--lockstep") as served, driver(load_platform("emulated_canopen"), served.device):
        findings = by_name(doctor.examine(load_platform("emulated_canopen"), str(Path(served.device)), 0.0))
    assert findings["adapter"].level == "fail"
    assert "in use by another program" in findings["adapter"].found
    assert findings["adapter"].do == "end that program"
