"""Commands and nodes where packages are missing: one line that says what to install, and exit status 2."""

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from soro_core import extras

ROOT = Path(__file__).resolve().parent.parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
BOARD = tomllib.loads((ROOT / "board/pyproject.toml").read_text())["project"]
NODES = (
    *("regulator", "estimator", "controller", "exciter", "twin", "shadow", "recorder", "player"),
    *("hand", "markers", "viewer"),
)

# Commands that need no extra.
ALONE = {"fit", "reach", "place-sensors", "gains", "identify", "identify-fem", "log", "new", "scenes"}
ALONE |= {"design", "fem"}

# What a module is to the import system where its package is not installed.
HIDE = "import json, sys\nfor name in json.loads({hidden!r}):\n    sys.modules[name] = None\n"

# Runs command lines one after the other; prints [status, stderr] of each.
RUN = """
import contextlib, io
from soro_ros import cli

def status_of(line):
    said = io.StringIO()
    sys.argv = line
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        try:
            if line[0] == "soro":
                cli.main()
            else:
                __import__("soro_ros.nodes." + line[0]).main()
        except SystemExit as end:
            return [end.code, said.getvalue()]

print(json.dumps([status_of(line) for line in json.loads(sys.argv[1])]))
"""


def modules(*names):
    return [module for name in names for module in extras.PACKAGES[name]]


def run(hidden, code, *arguments):
    code = HIDE.format(hidden=json.dumps(hidden)) + code
    return subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False, cwd=ROOT
    )


def said(hidden, lines):
    done = run(hidden, RUN, json.dumps(lines))
    assert done.returncode == 0, done.stderr
    return dict(zip((" ".join(line) for line in lines), json.loads(done.stdout), strict=True))


def commands(bag):
    """A command line of every subcommand, and the extras that it needs."""
    canopen = "emulated_canopen"
    return {
        ("soro", "run", "track_circle"): {"ros", "hardware"},
        ("soro", "run", "track_circle", "--set", "platform="): {"ros"},
        ("soro", "run", "track_circle", "--view"): {"ros", "hardware", "view"},
        ("soro", "excite", "track_circle"): {"ros", "hardware"},
        ("soro", "play", bag): {"ros"},
        ("soro", "plot", bag, "--film", f"{bag}/film.png"): {"ros"},
        ("soro", "plot", bag): {"ros"},
        ("soro", "report", bag): {"ros"},
        ("soro", "replay", bag): {"ros"},
        ("soro", "view", bag): {"ros", "view"},
        ("soro", "bag", "info", bag): {"ros"},
        ("soro", "bag", "repair", bag): {"ros"},
        ("soro", "bag", "convert", bag, "tables"): {"ros"},
        ("soro", "emulate", "itv_serial"): {"hardware"},
        ("soro", "emulate", "vtem_modbus"): {"hardware"},
        ("soro", "doctor", canopen): {"hardware"},
        ("soro", "doctor", "itv_serial"): {"hardware"},
        ("soro", "doctor", "vtem_modbus"): {"hardware"},
        ("soro", "hil", "latency", canopen, "--device", "/dev/null"): {"hardware"},
        ("soro", "hil", "first-pressure", canopen): {"hardware"},
        ("soro", "board", "soro_board", "--check"): {"board"},
        ("soro", "vent"): {"ros"},
        ("soro", "grasp"): {"ros"},
        ("soro", "reset"): {"ros"},
        ("soro", "enable"): {"ros"},
        ("soro", "move", "to", "0", "0", "66"): {"ros"},
        ("soro", "press", "50mN", "1", "0", "0"): {"ros"},
        ("soro", "fault", "twin", "--clear"): {"ros"},
        ("soro", "trade", "track_circle", "--dask", "localhost:1"): {"dask"},
        ("soro", "study", "track_circle", "--vary", "absent.yaml"): {"parquet"},
    }


@pytest.mark.process
@pytest.mark.parametrize(
    "absent", [("hardware", "ros", "board", "dask", "view", "parquet"), ("ros",), ("hardware", "view")]
)
def test_a_command_without_its_extra_ends_with_one_line_that_names_it(absent, tmp_path):
    cases = {line: need & set(absent) for line, need in commands(str(tmp_path)).items() if need & set(absent)}
    answers = said(modules(*absent), [list(line) for line in cases])
    for line, need in cases.items():
        status, text = answers[" ".join(line)]
        extra = "all" if need >= {"hardware", "ros"} else ",".join(sorted(need))
        assert (status, text.count("\n")) == (2, 1), (line, text)
        assert f"'soro[{extra}]'" in text, (line, text)


def test_the_command_lines_are_of_every_subcommand_that_needs_an_extra():
    from soro_ros.cli import application

    app = application()
    names = {command.name or command.callback.__name__ for command in app.registered_commands}
    names |= {group.name for group in app.registered_groups}
    assert names == {line[1] for line in commands("bag")} | ALONE


@pytest.mark.process
def test_a_new_arm_is_written_without_any_extra(tmp_path):
    lines = [
        ["soro", "new", f"arm{k}", "--platform", platform, "--out", str(tmp_path)]
        for k, platform in enumerate(("emulated", "itv", "vtem"))
    ]
    answers = said(modules("hardware", "ros", "board", "dask"), lines).values()
    assert {status for status, _ in answers} == {0}
    assert all("not installed" not in text for _, text in answers)  # a first start says that it compiles
    assert len(list(tmp_path.glob("*_scene.yaml"))) == 3


@pytest.mark.process
def test_a_node_without_ros_ends_with_one_line():
    for name, (status, text) in said(modules("ros"), [[name] for name in NODES]).items():
        assert status == 2, name
        assert text == "soro: the package rclpy is not installed: pip install 'soro[ros]'\n", name


@pytest.mark.process
def test_beside_a_ros_of_its_own_only_the_package_is_named(tmp_path):
    pytest.importorskip("rclpy", reason="the ROS part is not installed on this platform")
    ((status, text),) = said(["mcap"], [["soro", "bag", "info", str(tmp_path)]]).values()
    assert (status, text) == (2, "soro: the package mcap is not installed: pip install mcap\n")


@pytest.mark.process
def test_on_a_board_without_the_model_only_the_package_is_named():
    ((status, text),) = said(["numba", "smbus2"], [["soro", "board", "soro_board", "--check"]]).values()
    assert (status, text) == (2, "soro: the package smbus2 is not installed: pip install smbus2\n")


@pytest.mark.process
def test_the_model_imports_without_any_extra():
    code = """
from importlib import import_module
packages = ["soro_core", "soro_lab.identification"]
packages += ["soro_core." + name for name in
             "robot model integrate control estimation pneumatics safety twin loop".split()]
for package in map(import_module, packages):
    for name in getattr(package, "__all__", ()):
        getattr(package, name)
"""
    done = run(modules("hardware", "ros", "board", "dask"), code)
    assert done.returncode == 0, done.stderr


@pytest.mark.process
def test_the_server_of_a_board_needs_no_more_than_its_own_package_brings():
    code = (
        "from soro_hardware.board.pi.server import main\n"
        "sys.exit(main(['config/platforms/soro_board.yaml', '--check']))"
    )
    brought = {"numpy", "pydantic", "yaml"}
    done = run([name for name in extras.EXTRA_OF if name not in brought], code)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "smbus2" in done.stderr


def requirements(project):
    """Each requirement by its name, with the extra that it is of."""
    groups = {"": project["dependencies"], **project.get("optional-dependencies", {})}
    return {re.split(r"[^\w-]", line)[0]: (extra, line) for extra, lines in groups.items() for line in lines}


def test_the_packages_named_are_those_of_the_project():
    wheels = ("ros-jazzy-rclpy", "ros-jazzy-common-interfaces")
    declared = {
        name: extra
        for name, (extra, _) in requirements(PROJECT).items()
        if extra in extras.PACKAGES and name not in wheels
    }
    of_ros = {name for name in extras.PACKAGES["ros"] if name == "rclpy" or "_" in name}
    named = {
        extras.INDEX_NAMES.get(package, package): extra
        for package, extra in extras.EXTRA_OF.items()
        if package not in of_ros
    }
    assert declared == named


def test_the_package_of_the_board_asks_for_the_same_releases():
    ours = {name: line for name, (_, line) in requirements(PROJECT).items()}
    for name, (_, line) in requirements(BOARD).items():
        assert line == ours[name]
    for key in ("requires-python", "license"):
        assert BOARD[key] == PROJECT[key]
