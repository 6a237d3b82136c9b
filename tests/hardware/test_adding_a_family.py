"""docs/adding_a_family.md, followed: the example family behind every command that takes a platform."""

import re
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

PAGE = (Path(__file__).parents[2] / "docs/adding_a_family.md").read_text(encoding="utf-8")


@pytest.fixture
def platform(tmp_path, monkeypatch):
    """The platform file of the page, with the family that its last code block names."""
    text, entry = (re.search(rf"```{kind}\n(.*?)```", PAGE, re.S).group(1) for kind in ("yaml", "python"))
    path = tmp_path / "line.yaml"
    path.write_text(text)
    with refused("family", "line"):
        load_platform(path)
    for name, family in eval("{" + entry + "}", {"Family": families.Family}).items():
        monkeypatch.setitem(families.FAMILIES, name, family)
    return load_platform(path)


def exchanged(regulator, cycles, setpoint_pa):
    for _ in range(cycles):
        result = regulator.exchange(np.full(regulator.n_chambers, setpoint_pa), time.monotonic_ns())
        time.sleep(0.002)
    return result


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
    root = Path(__file__).parents[2]
    for path in re.findall(r"`((?:soro_core|tests|benchmarks|config)/[\w/.]+)`", PAGE):
        assert (root / path).exists(), path
    for path in re.findall(r"\]\(([\w./]+)[#)]", PAGE):
        assert (root / "docs" / path).exists(), path
    assert yaml.safe_load(re.search(r"```yaml\n(.*?)```", PAGE, re.S).group(1))["family"] == "line"
