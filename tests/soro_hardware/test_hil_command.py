"""`soro hil` as a user calls it, on an emulator given as if it were a device: bytes, processes, files."""

import json
import os
import sys

import pytest
from hardware_bench import ONE_VALVE, emulator, platform_file
from typer.testing import CliRunner

from soro_core.errors import ConfigError
from soro_hardware.emulation.faults.fault_types import read_injection
from soro_hardware.emulation.sockets.control import ControlClient
from soro_ros.commands import hil


@pytest.fixture(scope="module")
def device(tmp_path_factory):
    """A platform of one valve, its device, and where it takes faults."""
    folder = tmp_path_factory.mktemp("devices")
    described = platform_file(folder, valves=ONE_VALVE)
    with emulator(folder, "--lockstep", "--control", str(folder / "control"), platform=described) as served:
        yield described, str(served.device), folder / "control"


def call(folder, *arguments):
    """Exit status, output and the report of a command."""
    done = CliRunner().invoke(hil.app, [*arguments, "--lockstep", "--folder", str(folder)])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    (report,) = folder.glob("*/report.json")
    assert {file.name for file in report.parent.iterdir()} == {"report.json", "report.md", "report.png"}
    return done.exit_code, done.output, json.loads(report.read_text())


def pressurise(folder, described, address, *more):
    options = ("--steps", "5,8kPa", "--hold", "600ms", "--yes")
    return call(folder, "first-pressure", described, "--device", address, *options, *more)


@pytest.mark.process
def test_first_pressure_ends_in_a_report(device, tmp_path):
    described, address, control = device
    status, output, report = pressurise(tmp_path / "healthy", described, address)
    assert status == 0, output
    assert report["passed"] is True
    assert [hold["setpoint_pa"] for hold in report["holds"]] == [5e3, 8e3]
    client = ControlClient(control)
    client.inject(read_injection("fault: stuck_closed, chamber: link0/chamber0"))
    status, output, report = pressurise(tmp_path / "closed", described, address)
    client.inject(read_injection("fault: clear"))
    client.close()
    assert status == 1, output
    assert report["passed"] is False
    failed = [finding for finding in report["findings"] if finding["level"] == "fail"]
    assert [finding["name"] for finding in failed] == ["link0/chamber0: rises"]
    assert "does not rise" in (tmp_path / "closed").glob("*/report.md").__next__().read_text()


@pytest.mark.slow
def test_latency_ends_in_a_report(device, tmp_path):
    described, address, _ = device
    options = ("--repeat", "4", "--hold", "0.3s", "--yes")
    status, output, report = call(tmp_path, "latency", described, "--device", address, *options)
    assert status == 0, output
    (chamber,) = report["chambers"]
    assert chamber["steps"] == 8
    assert chamber["dead_s"] == pytest.approx(0.005, abs=0.002)
    assert chamber["lag_s"] == pytest.approx(0.052, rel=0.1)
    assert "dead time" in output
    assert "[ms]" in output


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["first-pressure", "emulated_canopen"], "--device: got ''; allowed: the path or address"),
        (["latency", "emulated_canopen", "--yes"], "--device: got ''"),
        (["first-pressure", "emulated_canopen", "--pose", "/x"], "--robot: got ''"),
        (
            ["first-pressure", "emulated_canopen", "--ask", "--yes", "--robot", "six_link"],
            "--yes: got '--ask'",
        ),
        (["first-pressure", "emulated_canopen", "--steps", "5;10"], "--steps: got '5;10'"),
        (
            ["first-pressure", "emulated_canopen", "--device", "/x", "--steps", "95kPa"],
            "--steps: got '95kPa'; allowed: a pressure from 0 Pa to 90000 Pa, like 5,10,20kPa",
        ),
        (["first-pressure", "emulated_canopen", "--steps", "10,5kPa"], "--steps: got '10,5kPa'"),
        (["first-pressure", "emulated_canopen", "--steps", "nan"], "--steps: got 'nan'"),
        (
            ["first-pressure", "emulated_canopen", "--device", "/x", "--robot", "six_link", "--pose", "/x"],
            "chambers: got",
        ),
        (
            ["first-pressure", "emulated_canopen", "--robot", "tue_three_bellow"],
            "--robot: got 'tue_three_bellow'; allowed: with --pose TOPIC or --ask",
        ),
        (
            ["first-pressure", "emulated_canopen", "--robot", "six_link", "--ask", "--pose", "/x"],
            "--ask: got '--pose'",
        ),
        (
            [
                *("first-pressure", "emulated_canopen", "--device", "/x"),
                *("--robot", "tue_three_bellow", "--pose", "/a b"),
            ],
            "--pose: got '/a b'; allowed: the name of a topic",
        ),
    ],
)
def test_wrong_use_is_one_line(arguments, says, tmp_path):
    done = CliRunner().invoke(hil.app, [*arguments, "--folder", str(tmp_path)])
    assert isinstance(done.exception, ConfigError)
    assert says in str(done.exception)
    assert not list(tmp_path.iterdir())


def test_an_answer_is_a_line_and_nobody_says_no(monkeypatch):
    read, write = os.pipe()
    with os.fdopen(read) as source:
        monkeypatch.setattr(sys, "stdin", source)
        assert hil.typed_answer() is None
        os.write(write, b"y\n")
        hil.show_question("too early?")
        assert hil.typed_answer() is None
        os.write(write, b"y\n")
        assert hil.typed_answer() == "y\n"
        os.close(write)
        assert hil.typed_answer() == "n"
