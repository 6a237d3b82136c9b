"""`soro new`: files of an arm that run at once; wrong use is one line."""

import re
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest

from soro_core import SoftArm, load_robot, reachable
from soro_core.errors import ConfigError
from soro_lab.scaffold import files
from soro_lab.scene import check_scene, load_scene
from tests.patience import LIMIT_S
from tests.refused import refused_keys
from tests.soro_ros.in_process import tip_error_rms_m
from tests.soro_ros.running import run, summary, wait_until

ARMS = {
    "one": ("--length", "80mm", "--mass", "30g"),
    "planar": ("--planar", "--length", "60mm", "--radius", "15mm", "--mass", "20g"),
    "two": ("--links", "2", "--length", "90mm,70mm", "--mass", "40g,25g", "--mounting", "hanging"),
}
# What the controller of an arm has to learn.
LOADED = {"one": {"twin.payload_kg": 0.01}}


@pytest.mark.process
@pytest.mark.parametrize("name", ARMS)
def test_a_new_arm_runs_at_once_from_another_folder(soro, domain, tmp_path, monkeypatch, name):
    """Its error in one process, whose numbers are those of the nodes (`test_closed_loop.py`)."""
    status, out, _ = soro("new", name, *ARMS[name], "--out", str(tmp_path / "made"))
    assert status == 0
    assert len(out.splitlines()) == 7
    tip = np.array(re.search(r"soro move to (\S+) (\S+) (\S+)$", out, re.M).groups(), float) / 1e3
    shutil.move(tmp_path / "made", tmp_path / "mine")
    monkeypatch.chdir(tmp_path)
    file = f"mine/{name}_scene.yaml"
    scene = load_scene(file, {"mode": "lockstep", **LOADED.get(name, {})})
    check_scene(scene, file)
    arm = SoftArm(load_robot(f"mine/{name}_robot.yaml"))
    assert np.linalg.norm(reachable(arm).tip_m - tip, axis=1).min() < 0.05 * arm.length
    assert tip_error_rms_m(scene, 1.0, 6.0) < 0.02 * load_robot(f"mine/{name}_robot.yaml").length
    if name != "planar":  # nodes of arms of one and of two links: `test_whole_way.py`, `test_closed_loop.py`
        return
    status, output, folder = run(tmp_path / "runs", "mode=lockstep", "duration_s=0.5", scene=file)
    assert status == 0, output
    assert (summary(folder)["verdict"], summary(folder)["faults"]) == ("good", [])


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (("My-Arm",), "ARM"),
        (("arm", "--length", "80"), "--length"),
        (("arm", "--length", "80mm,60mm", "--links", "3"), "--length"),
        (("arm", "--mass", "30 apples"), "--mass"),
        (("arm", "--mass", "80kg"), "--mass"),
        (("arm", "--chambers", "2.5"), "--chambers"),
        (("arm", "--pressure-range", "90,0kPa"), "--pressure-range"),
        (("arm", "--platform", "hydraulic"), "--platform"),
        (("arm", "--mounting", "leaning"), "--mounting"),
        (("arm", "--planar", "--chambers", "3"), "--chambers"),
    ],
)
def test_wrong_use_is_one_line_and_leaves_nothing(soro, tmp_path, arguments, key):
    status, out, err = soro("new", *arguments, "--out", str(tmp_path / "made"))
    assert (status, out) == (2, "")
    (line,) = err.splitlines()
    assert refused_keys(line) == [key]
    assert list(tmp_path.iterdir()) == []


def test_existing_files_need_force(soro, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert soro("new", "arm", "--length", "80mm").status == 0
    status, _, err = soro("new", "arm", "--length", "90mm")
    assert status == 2
    (line,) = err.splitlines()
    assert refused_keys(line) == ["--out"]
    assert "--force" in line
    assert load_robot("arm/arm_robot.yaml").length == 0.08
    assert soro("new", "arm", "--length", "90mm", "--force").status == 0
    assert load_robot("arm/arm_robot.yaml").length == 0.09


def test_what_takes_long_is_said_before_it_begins(soro, tmp_path, monkeypatch):
    """The first use of the model compiles it, for minutes on a busy machine."""

    def ended(robot):
        raise ConfigError("model", "links", robot.name, "an end of the search")

    monkeypatch.setattr(files, "first_reference", ended)
    status, out, err = soro("new", "arm", "--length", "80mm", "--out", str(tmp_path / "made"))
    assert (status, len(err.splitlines())) == (2, 1)
    assert out == "arm: looking for a motion that its pressures hold, by the model; then come its files\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.process
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_leaves_no_folder(tmp_path, number):
    command = [sys.executable, "-m", "soro_ros.cli", "new", "arm", "--length", "80mm"]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    wait_until(lambda: any(tmp_path.glob(".soro_new_*")), "the half-made folder", every_s=0.001)
    process.send_signal(number)
    _, err = process.communicate(timeout=LIMIT_S)
    assert (process.returncode, list(tmp_path.iterdir())) == (130, []), err
    assert "Traceback" not in err


def test_numbers_that_let_the_arm_fall_are_a_line(soro, tmp_path):
    soft = ("--length", "200mm", "--radius", "10mm", "--bending-stiffness", "3Nmm/rad")
    status, _, err = soro("new", "soft", *soft, "--out", str(tmp_path))
    assert status == 0
    (line,) = err.splitlines()
    assert "--mounting hanging" in line
