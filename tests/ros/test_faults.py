"""What a person or a fault can do to a running suite: valves vent, the bag is whole, the cause is named."""

import os
import signal

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from soro_core.bag import BagReader
from tests.ros.running import alive, child, end, only_run, patient_platform, run, start_run, wait_until

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
    if not bags:
        return False
    return true_pressures(runs[0] / "bag", whole=False).max(initial=0.0) > 10e3


@pytest.fixture
def running(alone, domain, tmp_path):
    """A real-time run on emulated valves, under control, its folder and its process."""
    changes = [
        "mode=real_time",
        "duration_s=120",
        "limits.command_age_s=0.5",
        "limits.reading_age_s=0.5",
        f"platform={patient_platform(tmp_path)}",
    ]
    folder = tmp_path / "runs"
    process = start_run(folder, *changes)
    try:
        wait_until(lambda: under_control(process, folder), 120, "control of the arm", every_s=0.5)
        yield process, folder
    finally:
        if process.poll() is None:
            end(process)


@pytest.mark.timeout(240)
def test_the_watchdog_vents_100_ms_after_the_last_command_as_shipped(domain, tmp_path):
    """In lockstep, with the shipped limits: the estimator loses its sensor, so no more commands come."""
    status, output, folder = run(tmp_path, "mode=lockstep", "twin.pose.drop=0.999")
    assert status == 1, output
    assert output.count("soro: regulator: vented: command lost: last one 105 ms old") == 1
    assert "vented; bag closed" in output
    assert true_pressures(folder / "bag")[-1].max() < VENTED_PA


@pytest.mark.timeout(240)
def test_ctrl_c_vents_closes_the_bag_and_says_so(running):
    process, folder = running
    names = ("regulator", "twin", "estimator", "controller", "recorder", "emulation")
    pids = [child(process.pid, name) for name in names]
    assert all(pids)
    status, _, err = end(process)
    assert status == 130, err
    assert "vented; bag closed" in err
    assert not any(alive(pid) for pid in pids)
    pressures = true_pressures(only_run(folder) / "bag")
    assert pressures.max() > 10e3
    assert pressures[-1].max() < VENTED_PA


@pytest.mark.timeout(240)
def test_a_killed_controller_vents_the_valves_and_ends_the_run_with_its_cause(running):
    process, folder = running
    os.kill(child(process.pid, "nodes.controller"), signal.SIGKILL)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert err.count("controller ended with status -9") + err.count("command lost") == 1
    assert "vented; bag closed" in err
    pressures = true_pressures(only_run(folder) / "bag")
    assert pressures.max() > 10e3
    assert pressures[-1].max() < VENTED_PA


@pytest.mark.timeout(240)
def test_a_killed_recorder_leaves_a_bag_to_repair_and_says_so(running):
    process, folder = running
    os.kill(child(process.pid, "nodes.recorder"), signal.SIGKILL)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert err.count("recorder ended with status -9") == 1
    assert f"vented; the bag is not closed: soro bag repair {only_run(folder) / 'bag'}" in err
    assert "Traceback" not in err


@pytest.mark.timeout(240)
def test_the_death_of_the_supervisor_vents_and_leaves_nothing_behind(running):
    process, folder = running
    names = ("regulator", "twin", "estimator", "controller", "recorder", "emulation")
    pids = [child(process.pid, name) for name in names]
    assert all(pids)
    process.kill()
    process.communicate(timeout=10)
    wait_until(lambda: not any(alive(pid) for pid in pids), 30, "end of all processes")
    assert true_pressures(only_run(folder) / "bag").max() > 10e3
