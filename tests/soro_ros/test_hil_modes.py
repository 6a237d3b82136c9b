"""`soro run` on valves that are there already: with a simulated arm, and with a real one and its shadow."""

import signal
import sys

import numpy as np
import pytest

from soro_ros.recordings.recording import read
from soro_ros.run import processes
from tests.patience import LIMIT_S, patient_platform
from tests.soro_ros.running import run, summary, wait_until

pytestmark = pytest.mark.process

PATIENT = ("limits.command_age_s=0.5", "limits.reading_age_s=0.5", "twin.payload_kg=0.0", "twin.refine=1")


@pytest.fixture
def valves(tmp_path):
    """Emulated valves as if they were real: nothing of the run starts them. Their platform and device."""
    (tmp_path / "devices").mkdir()
    platform = patient_platform(tmp_path / "devices")
    device, plant = tmp_path / "devices" / "adapter", tmp_path / "devices" / "plant"
    command = [sys.executable, "-m", "soro_hardware.emulation", str(platform)]
    command += ["--device-link", str(device), "--plant-link", str(plant)]
    child = processes.start("valves", command, tmp_path / "devices", priority=40)
    try:
        wait_until(lambda: "ready:" in child.log.read_text(), "ready")
        yield platform, device, plant
    finally:
        processes.stop(child, LIMIT_S)


def real(valves, *changes):
    platform, device, _ = valves
    return (f"platform={platform}", f"device={device}", "valves=real", "duration_s=1.5", *PATIENT, *changes)


@pytest.mark.real_time
def test_real_valves_with_a_simulated_arm(domain, alone, tmp_path, valves):
    status, output, folder = run(tmp_path / "runs", *real(valves))
    assert status == 0, output
    assert not (folder / "log" / "valves.log").exists()
    assert summary(folder)["faults"] == []
    assert summary(folder)["shadow"] is None
    recording = read(folder / "bag", "track_circle")
    # The arm is where the measured pressures of the real valves bring it.
    assert recording.reading.value.max() > 3e3
    assert np.ptp(recording.true_tip.value[:, :2], axis=0).max() > 1e-3
    assert recording.true_tip.t[-1] == pytest.approx(recording.reading.t[-1], abs=0.1)


@pytest.mark.real_time
def test_a_real_arm_with_its_shadow(domain, alone, tmp_path, valves, figure):
    _, _, plant = valves
    # The real arm is a second twin, stiffer than the model of controller and estimator.
    command = [sys.executable, "-m", "soro_ros.nodes.twin", "--ros-args", "-r", "__ns:=/track_circle"]
    command += ["-r", "__node:=arm", "-p", "pressures:=valves", "-p", f"plant_link:={plant}"]
    arm = processes.start(
        "arm", [*command, "-p", "stiffness_scale:=1.5", "-p", "refine:=1"], tmp_path / "devices"
    )
    try:
        status, output, folder = run(tmp_path / "runs", *real(valves, "arm=real"))
    finally:
        arm.process.send_signal(signal.SIGINT)
        arm.process.wait(LIMIT_S)
    assert status == 0, output
    assert "shadow: measured" in output
    assert "tip, measured to shadow, RMS / max" in output
    found = summary(folder)["shadow"]
    recording = read(folder / "bag", "track_circle")
    figure(f"shadow of an arm 1.5 times as stiff: {found['distance_rms_m'] * 1e3:.2f} mm RMS")
    assert found["samples"] > 100
    assert found["distance_rms_m"] > 0.5e-3
    assert found["bending_mean_rad"] < -0.005  # it bends less than its model
    # What is told is the distance of the true tip from the simulated one, but for the sensor's noise.
    truth, shadow = recording.true_tip, recording.shadow_tip
    far = np.linalg.norm(truth.at(shadow.t) - shadow.value, axis=1)
    told = np.interp(shadow.t, recording.shadow.t, recording.shadow.value[:, 0])
    moving = shadow.t > 0.5
    assert np.abs(told - far)[moving].mean() < 1e-3
