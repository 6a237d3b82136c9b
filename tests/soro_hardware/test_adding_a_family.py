"""docs/adding_a_family.md, followed: the example family behind every command that takes a platform."""

import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from hardware_bench import wait_for
from served_bench import served

from soro_hardware import doctor, families, load_platform, open_regulator
from soro_hardware.port import FAULT_CODES
from tests.refused import refused
from tests.ros_domain import free_domain

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/adding_a_family.md").read_text(encoding="utf-8")
SORO = [sys.executable, "-m", "soro_ros.cli"]


def installed(folder, entry):
    """A package as pip would install it into a folder: its module, and its metadata with an entry point."""
    folder.mkdir()
    shutil.copy(ROOT / "docs/line_family.py", folder)
    metadata = folder / "line_family-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: line_family\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(entry)
    return folder


@pytest.fixture
def path(tmp_path):
    """The platform file of the page."""
    path = tmp_path / "line.yaml"
    path.write_text(re.search(r"```yaml\n(.*?)```", PAGE, re.S).group(1))
    return path


@pytest.fixture
def package(tmp_path):
    """The folder with the package of the page, and the entry point that its TOML block states."""
    (line,) = re.search(r"```toml\n(.*?)```", PAGE, re.S).group(1).splitlines()[1:]
    return installed(tmp_path / "packages", "[soro.families]\n" + line.replace('"', "") + "\n")


@pytest.fixture
def platform(path, package, monkeypatch):
    with refused("family", "line", names=tuple(families.FAMILIES)):
        load_platform(path)
    monkeypatch.syspath_prepend(str(package))
    return load_platform(path)


@pytest.mark.process
def test_soro_runs_an_arm_on_it(path, package, tmp_path):
    paths = os.pathsep.join([str(package), os.environ.get("PYTHONPATH", "")])
    command = [
        *SORO,
        "run",
        "track_circle",
        "--set",
        f"platform={path}",
        "--set",
        "duration_s=2",
        "--set",
        "controller.probe_at_enable=off",  # it takes seconds, and knows no family
        "--no-figure",
    ]
    with free_domain() as number:
        done = subprocess.run(
            [*command, "--folder", str(tmp_path / "runs")],
            env={**os.environ, "PYTHONPATH": paths, "ROS_DOMAIN_ID": str(number)},
            capture_output=True,
            text=True,
            check=False,
            timeout=200,
        )
    (run,) = (tmp_path / "runs").iterdir()
    summary = json.loads((run / "summary.json").read_text())
    assert done.returncode == 0, done.stdout + done.stderr
    assert summary["faults"] == []


@pytest.mark.parametrize(
    ("value", "says"), [("line_family:Line", "does not load"), ("line_family:LinePlatform", "is no")]
)
def test_a_package_whose_family_is_none_is_one_line(path, tmp_path, monkeypatch, value, says):
    monkeypatch.syspath_prepend(str(installed(tmp_path / "packages", f"[soro.families]\nline = {value}\n")))
    with refused("family", "line", names=("canopen_408", value, says)):
        load_platform(path)


def exchanged(regulator, cycles, setpoint_pa):
    for _ in range(cycles):
        result = regulator.exchange(np.full(regulator.n_chambers, setpoint_pa), time.monotonic_ns())
        time.sleep(0.002)
    return result


@pytest.mark.process
def test_platform_file_emulator_driver_watchdog_and_doctor(platform):
    assert platform.device == "192.168.4.7:4000"
    with served(platform) as (devices, address):
        regulator = open_regulator(platform, address)
        regulator.configure()
        wait_for(lambda: exchanged(regulator, 10, 40e3).pressure_pa.min() > 30e3)
        result = exchanged(regulator, 1, 40e3)
        assert {fault.code for fault in result.faults} <= set(FAULT_CODES)
        # The host falls silent: the device vents by itself, as `device_watchdog` says.
        wait_for(lambda: devices.pressure_pa.max() < 5e3)
        regulator.close()
        findings = {finding.name: finding for finding in doctor.examine(platform, address, run_s=0.1)}
        assert findings["start-up"].level == "ok"
        assert findings["device watchdog"].level == "ok"
    gone = {finding.name: finding for finding in doctor.examine(platform, address, run_s=0.1)}
    assert gone["start-up"].level == "fail"


def test_every_file_and_name_of_the_page_exists():
    for path in re.findall(r"`((?:soro_hardware|tests|benchmarks|config)/[\w/.]+)`", PAGE):
        assert (ROOT / path).exists(), path
    for path in re.findall(r"\]\(([\w./]+)[#)]", PAGE):
        assert (ROOT / "docs" / path).exists(), path
    assert yaml.safe_load(re.search(r"```yaml\n(.*?)```", PAGE, re.S).group(1))["family"] == "line"
