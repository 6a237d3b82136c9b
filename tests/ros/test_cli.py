"""The command line: wrong use and wrong files are one line that names file and key, and exit status 2."""

import re
import subprocess

import pytest

from soro_core.errors import ConfigError
from soro_ros.commands.run import run
from soro_ros.processes import Child
from tests.ros.running import SORO

GOOD = "robot: tue_three_bellow\nrate_hz: 200\n"


def soro(*arguments: str) -> tuple[int, str, str]:
    done = subprocess.run([*SORO, *arguments], capture_output=True, text=True, timeout=60, check=False)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize(
    "arguments", [(), ("run",), ("play",), ("emulate",), ("trade",), ("bag",), ("bag", "info")]
)
def test_every_command_explains_itself(arguments):
    status, out, _ = soro(*arguments, "--help")
    assert status == 0
    assert "Usage" in out


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("robt: x\n", "robt: got 'an unknown key'; allowed: name, robot, platform, mode"),
        ("rate_hz: .nan\n", "rate_hz: got nan; allowed: input should be"),
        ("rate_hz: fast\n", "rate_hz: got 'fast'; allowed: input should be a valid number"),
        ("duration_s: -1\n", "duration_s: got -1; allowed: input should be greater than 0"),
        ("mode: warp\n", "mode: got 'warp'; allowed: input should be 'real_time' or 'lockstep'"),
        ("mode: lockstep\nmode: lockstep\n", "stands twice"),
        ("twin: {seed: 3}\n", "no seed under twin"),
        (
            "platform: emulated_canopen\ntwin: {regulator: {tau_s: 0.1}}\n",
            "no regulator under twin beside a platform, whose emulation.regulator counts",
        ),
        (
            "twin: {payload_kg: 0.02, integrator: trapezoidal, valve: {supply_pa: 200e3}}\n",
            "twin.valve: got {'supply_pa': 200000.0}; allowed: none beside air: lag, only beside air: states",
        ),
        ("twin: {pose: {rate_hz: 90}}\n", "a pose rate that divides rate_hz"),
        (
            "twin: {regulator: {tau: 0.05}}\n",
            "twin.regulator.tau: got 'an unknown key'; allowed: delay_s, tau_s",
        ),
        (
            "limits: {maximum_pa: 120e3, over_pressure_pa: 125e3, burst_pressure_pa: 130e3}\n",
            "limits.maximum_pa: got 120000.0; allowed: input should be less than 100000: the platform",
        ),
        (
            "limits: {minimum_pa: 0.0, maximum_pa: 4e+4, over_pressure_pa: 3e+4, burst_pressure_pa: 9e+4}\n",
            "limits: allowed: over_pressure_pa must be above maximum_pa",
        ),
        (
            "controller: {gains: {k_p: [1, x]}}\n",
            "controller.gains.k_p[1]: got 'x'; allowed: input should be a valid",
        ),
        ("model: autos\n", "model: got 'autos'; allowed: auto, or a mapping of keys: error, budget_us"),
        ("model: 3\n", "model: got 3; allowed: auto, or a mapping of keys: "),
        (
            "model: {integrator: euler}\n",
            "model.integrator: got 'euler'; allowed: input should be 'trapezoidal'",
        ),
        (
            "twin: {integrator: euler}\n",
            "twin.integrator: got 'euler'; allowed: input should be 'trapezoidal'",
        ),
        (
            "model: {basis: chebyshev, order: 2}\n",
            "model: got 'basis chebyshev, order 2'; allowed: what the robot can have (tue_three_bellow: ",
        ),
        (
            "model: {basis: chebyshev, order: 2, method: exact}\ntwin: {refine: 1}\n",
            "links[0].damping: got 'losses of each coordinate'",
        ),
        ("- a\n- b\n", "allowed: a mapping of keys to values"),
        (
            "robot: [\n",
            "line 2, column 1: expected the node content, but found '<stream end>'\"; allowed: valid YAML",
        ),
    ],
)
def test_a_wrong_scene_is_one_line(tmp_path, text, says):
    file = tmp_path / "scene.yaml"
    file.write_text(text)
    status, _, err = soro("run", str(file), "--folder", str(tmp_path / "runs"))
    assert status == 2
    assert says in err
    assert str(file) in err
    assert len(err.strip().splitlines()) == 1
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (
            ("run", "no_such_scene"),
            "no_such_scene: got 'no scenes file of that name'; allowed: a path ending in .yaml, or one of",
        ),
        (("run", "missing.yaml"), "missing.yaml: got 'no such file'"),
        (("run", "track_circle", "--set", "nonsense"), "--set: got 'nonsense'; allowed: KEY=VALUE"),
        (("run", "track_circle", "--set", "controller.law=pid"), "controller.law: got 'pid'; allowed:"),
        (
            ("run", "track_circle", "--set", "robot=silicone_rod"),
            "scene track_circle: robot: got 'silicone_rod, which has no chambers'",
        ),
        (
            ("run", "track_circle", "--set", "robot=no_such_robot"),
            "no_such_robot: got 'no robots file of that name'",
        ),
        (
            ("run", "track_circle", "--set", "platform=no_such"),
            "no_such: got 'no platforms file of that name'",
        ),
        (
            ("run", "track_circle", "--valves", "real"),
            "emulated_canopen: device: got ''; allowed: --device, or transport.device in the platform file",
        ),
        (
            ("run", "track_circle", "--device", ""),
            "soro run: --device: got ''; allowed: the path or address of the valves",
        ),
        (
            ("run", "track_circle", "--arm", "real"),
            "track_circle.yaml: allowed: no arm: real without valves: real",
        ),
        (("doctor", "no_such"), "soro: no_such: got 'no platforms file of that name'"),
        (("emulate", "no_such"), "soro: no_such: got 'no platforms file of that name'"),
    ],
)
def test_wrong_use_names_what_is_wrong(tmp_path, arguments, says):
    options = ("--folder", str(tmp_path / "runs")) if arguments[0] == "run" else ()
    status, _, err = soro(*arguments, *options)
    assert status == 2, err
    assert says in err
    assert "Traceback" not in err


def test_a_missing_device_is_told_before_anything_starts(tmp_path):
    missing = tmp_path / "ttyACM0"
    status, _, err = soro("run", "track_circle", "--device", str(missing), "--folder", str(tmp_path / "runs"))
    assert status == 1
    assert err.startswith(f"soro: {missing} does not exist: plug the adapter in")
    assert "starting" not in err
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("twin.air=1e-3", "twin.air: got 0.001; allowed: input should be"),  # a number, as in a file
        ("rate_hz=[", '--set rate_hz: got "line 1, column 2: expected the node'),
    ],
)
def test_changes_are_read_as_files_are(change, says):
    with pytest.raises(ConfigError, match=re.escape(says)):
        run("track_circle", [change])


def test_help_keeps_units_and_has_no_broken_lines():
    _, out, _ = soro("hil", "first-pressure", "--help")
    assert "[kPa gauge]" in out
    _, out, _ = soro("emulate", "--help")
    assert "ports stand in it with commas between them. Give that" in out  # a whole line of the terminal


def test_of_an_ended_node_its_errors_are_told(tmp_path):
    log = tmp_path / "node.log"
    child = Child("node", None, log)
    log.write_text("[INFO] [1.5] [run.node]: configuring\n[ERROR] [1.6] [run.node]: no device\n")
    assert child.last_words() == "no device"
    log.write_text("[INFO] [1.5] [run.node]: configuring\nkilled\n")
    assert child.last_words() == "[INFO] [1.5] [run.node]: configuring | killed"
    log.write_text("")
    assert child.last_words() == "it said nothing"


def test_a_platform_for_other_chambers_says_which(tmp_path):
    status, _, err = soro(
        "run", "track_circle", "--set", "platform=emulated_canopen_4ch", "--folder", str(tmp_path)
    )
    assert status == 2
    assert "emulated_canopen_4ch: valves: got '12 valves: link1/chamber0, which the robot has not'" in err
    assert "allowed: one valve for each chamber of robot tue_three_bellow: link0/chamber0, " in err
    assert len(err.strip().splitlines()) == 1
