"""`soro doctor`: every check says what was found and what to do; on emulated devices; exit status, JSON."""

import json
from pathlib import Path

import numpy as np
import pytest
import typer
from hardware_bench import PATIENT, Bench, emulator, platform, platform_file, single
from typer.testing import CliRunner

from soro_core.errors import ConfigError
from soro_hardware import doctor, load_platform
from soro_hardware.canopen import frames, probe
from soro_hardware.transport.frame import Frame
from soro_ros.commands.doctor import doctor as command


def by_name(findings):
    return {finding.name: finding for finding in findings}


# On emulated devices ------------------------------------------------------------------------------


def examine(bench):
    return by_name(
        probe.probe(
            bench.platform,
            bench.driver.device,
            bench.driver.link,
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


def test_a_coupler_without_watchdog_fails():
    scaling = {"kind": "fixed", "setpoint": {"pa_per_count": 10.0}, "reading": {"pa_per_count": 10.0}}
    coupler = platform(canopen={"mapping": {"device": "aventics_aes", "scaling": scaling}})
    bench = Bench(coupler)
    assert examine(bench)["watchdogs of the device"].level == "warn"
    finding = by_name(doctor.examine(coupler, str(Path("none")), 0.0))["device watchdog"]
    assert finding.level == "fail"
    assert "`" not in finding.do, "no key of the platform file helps"
    assert "dump valve" in finding.do


def test_times_of_the_watchdogs_are_found():
    healthy = examine(Bench(platform()))["watchdogs of the device"]
    assert (healthy.level, healthy.found) == ("ok", "heartbeat consumer 100 ms and set point deadline 50 ms")


# The command --------------------------------------------------------------------------------------


@pytest.fixture
def run():
    app = typer.Typer()
    app.command()(command)

    def call(*arguments):
        wide = {"COLUMNS": "200", "NO_COLOR": "1", "TERM": "dumb"}
        return CliRunner().invoke(app, [str(a) for a in arguments], env=wide)

    return call


@pytest.mark.process
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


@pytest.mark.process
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


def test_the_limits_of_a_scene_count_in_place_of_the_defaults(run, tmp_path):
    """A platform of up to 60 kPa: the default limits are beyond it, those of the scene are not."""
    path, scene = platform_file(tmp_path, range={"maximum_pa": 60e3}), tmp_path / "scene.yaml"

    def found(maximum_pa, *options):
        scene.write_text(f"robot: tue_three_bellow\nlimits: {{maximum_pa: {maximum_pa}}}\n")
        done = run(path, "--device", tmp_path / "none", "--json", *options)
        return next(entry for entry in json.loads(done.output) if entry["name"] == "pressure range")

    alone = found(60e3)
    assert (alone["level"], "the default limits allow 90 kPa" in alone["found"]) == ("warn", True)
    assert "--scene" in alone["do"]
    assert found(60e3, "--scene", scene)["level"] == "ok"
    beyond = found(70e3, "--scene", scene)
    assert (beyond["level"], "the limits of the scene allow 70 kPa" in beyond["found"]) == ("warn", True)


@pytest.mark.process
def test_two_programs_on_one_adapter(tmp_path):
    """The second one is refused; it would take the adapter off the bus."""
    from hardware_bench import driver

    with emulator(tmp_path, "--lockstep") as served, driver(load_platform("emulated_canopen"), served.device):
        findings = by_name(doctor.examine(load_platform("emulated_canopen"), str(Path(served.device)), 0.0))
    assert findings["adapter"].level == "fail"
    assert "in use by another program" in findings["adapter"].found
    assert findings["adapter"].do == "end that program"
