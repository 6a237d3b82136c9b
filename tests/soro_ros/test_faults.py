"""What a person or a fault can do to a running suite: valves vent, the bag is whole, the cause is named."""

import os
import signal
import time

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from soro_lab.bag import BagReader
from soro_lab.bag.mcap.records import MAGIC
from soro_ros.run.supervisor import SILENT_S
from tests.patience import COMPILED_S, LIMIT_S, patient_platform
from tests.soro_ros.running import (
    ClockListener,
    alive,
    child,
    end,
    only_run,
    run,
    start_run,
    summary,
    wait_until,
)

pytestmark = pytest.mark.process

VENTED_PA = 2e3


def true_pressures(bag, whole=True) -> np.ndarray:
    """True chamber pressures (n, 3) of a bag, or of one that is still being written."""
    with BagReader(bag, index=whole) as reader:
        assert not (whole and reader.problems)
        return np.array(
            [
                deserialize_message(m.data, JointState).effort
                for m in reader.messages({"/track_circle/truth/chambers"})
            ]
        )


def under_control(process, folder) -> bool:
    """Whether the run has come as far as moving the arm."""
    assert process.poll() is None, process.communicate()
    runs = list(folder.iterdir()) if folder.exists() else []
    bags = list(runs[0].glob("bag/*.mcap")) if runs else []
    if not bags or bags[0].stat().st_size < len(MAGIC):  # the recorder has not written yet
        return False
    return true_pressures(runs[0] / "bag", whole=False).max(initial=0.0) > 10e3


@pytest.fixture
def running(domain, tmp_path):
    """A run on emulated valves, under control, its folder and its process.

    In lockstep: nothing but what the test does can end it, however busy the machine is.
    """
    folder = tmp_path / "runs"
    platform = patient_platform(tmp_path, real_time=False)
    process = start_run(folder, "mode=lockstep", "duration_s=1000", f"platform={platform}")
    try:
        wait_until(lambda: under_control(process, folder), "control of the arm", COMPILED_S, every_s=0.2)
        yield process, folder
    finally:
        if process.poll() is None:
            end(process)


def test_the_watchdog_vents_100_ms_after_the_last_command_as_shipped(domain, tmp_path):
    """In lockstep, with the shipped limits: the estimator loses its sensor, so no more commands come."""
    platform = patient_platform(tmp_path, real_time=False)
    changes = ("mode=lockstep", "rate_hz=200", "twin.pose.drop=0.999", f"platform={platform}")
    status, output, folder = run(tmp_path / "runs", *changes)
    assert status == 1, output
    found = summary(folder)
    assert found["verdict"] == "vented"
    (fault,) = found["faults"]
    assert fault.startswith("regulator: ")
    assert "105 ms" in fault
    assert output.count(fault) == 1
    # The trip is what follows: why no command came any more is the reason.
    assert found["reason"].startswith("estimator: no estimate: no good sample for 0."), found["reason"]
    assert true_pressures(folder / "bag")[-1].max() < VENTED_PA


def test_ctrl_c_vents_closes_the_bag_and_says_so(running):
    process, folder = running
    names = ("regulator", "twin", "estimator", "controller", "recorder", "emulation")
    pids = [child(process.pid, name) for name in names]
    assert all(pids)
    status, _, err = end(process)
    assert status == 130, err
    assert summary(only_run(folder))["verdict"] == "vented"
    assert not any(alive(pid) for pid in pids)
    pressures = true_pressures(only_run(folder) / "bag")
    assert pressures.max() > 10e3
    assert pressures[-1].max() < VENTED_PA


def test_a_killed_controller_vents_the_valves_and_ends_the_run_with_its_cause(running):
    process, folder = running
    os.kill(child(process.pid, "nodes.controller"), signal.SIGKILL)
    _, err = process.communicate(timeout=2 * LIMIT_S)
    assert process.returncode == 1
    found = summary(only_run(folder))
    assert found["verdict"] == "vented"
    assert "controller" in found["reason"]
    assert err.count("status -9") == 1
    pressures = true_pressures(only_run(folder) / "bag")
    assert pressures.max() > 10e3
    assert pressures[-1].max() < VENTED_PA


def test_an_arm_goes_on_without_its_recorder_and_is_not_judged(domain, tmp_path):
    clock = ClockListener()
    process = start_run(tmp_path, "mode=lockstep", "platform=", "duration_s=10")
    try:
        wait_until(lambda: under_control(process, tmp_path), "a bag with something in it", COMPILED_S)
        os.kill(child(process.pid, "nodes.recorder"), signal.SIGKILL)
        clock.wait_for(1.0)
        _, err = process.communicate(timeout=2 * LIMIT_S)
    finally:
        process.kill()
        clock.close()
    assert process.returncode == 1
    found = summary(only_run(tmp_path))
    assert (found["verdict"], found["faults"]) == ("lost", [])
    assert "recorder ended with status -9" in found["reason"]
    assert f"soro bag repair {only_run(tmp_path) / 'bag'}" in err
    assert "Traceback" not in err


@pytest.mark.real_time
def test_an_arm_goes_on_beside_a_recorder_that_is_starved(domain, tmp_path):
    ages = ("limits.command_age_s=0.5", "limits.reading_age_s=0.5", "rate_hz=50", "twin.pose.rate_hz=50")
    process = start_run(tmp_path, "platform=", "duration_s=12", *ages)
    try:
        wait_until(lambda: under_control(process, tmp_path), "control of the arm", COMPILED_S, every_s=0.2)
        recorder = child(process.pid, "nodes.recorder")
        os.kill(recorder, signal.SIGSTOP)
        time.sleep(SILENT_S + 1.0)
        os.kill(recorder, signal.SIGCONT)
        _, err = process.communicate(timeout=2 * LIMIT_S)
    finally:
        process.kill()
    found = summary(only_run(tmp_path))
    assert (process.returncode, found["verdict"], found["faults"]) == (0, "good", []), err
    assert "recorder: no message on /diagnostics" in found["reason"]


def test_the_death_of_the_supervisor_vents_and_leaves_nothing_behind(running):
    process, folder = running
    names = ("regulator", "twin", "estimator", "controller", "recorder", "emulation")
    pids = [child(process.pid, name) for name in names]
    assert all(pids)
    process.kill()
    process.communicate(timeout=LIMIT_S)
    wait_until(lambda: not any(alive(pid) for pid in pids), "end of all processes")
    assert true_pressures(only_run(folder) / "bag").max() > 10e3
