"""A run that trips is recorded until its arm is empty; one that a user vents goes on."""

import subprocess

import numpy as np
import pytest

from soro_ros.recordings.recording import read
from tests.patience import COMPILED_S, LIMIT_S, patient_platform
from tests.soro_ros.running import SORO, ClockListener, only_run, run, start_run, summary, wait_until


def empty_for_s(reading) -> float:
    """Time [s] for which every chamber reads less than 5 kPa at the end of a recording."""
    pressed = np.any(np.abs(reading.value) >= 5e3, axis=1)
    assert pressed.any()
    return float(reading.t[-1] - reading.t[pressed][-1])


@pytest.mark.process
@pytest.mark.parametrize("valves", [True, False], ids=["valves", "direct"])
def test_a_trip_is_recorded_until_the_chambers_are_empty(domain, tmp_path, valves):
    """In lockstep too, where the vent is a tick of the devices of its own."""
    if valves:
        platform = patient_platform(tmp_path, real_time=False)
        changes = (f"platform={platform}", "faults=[{at: 3.0, fault: burst, chamber: link0/chamber1}]")
    else:
        changes = (
            "platform=",
            "limits.over_pressure_pa=45e3",
            "limits.maximum_pa=44e3",
            "limits.monitors={}",
        )
    status, output, folder = run(tmp_path / "runs", "mode=lockstep", "duration_s=8", *changes)
    assert status == 1, output
    recording = read(folder, "track_circle")
    (trip,) = (event for event in recording.events if event.kind == "trip")
    assert trip.t_s < 8.0
    assert 0.99 <= empty_for_s(recording.reading)
    assert (
        recording.reading.t[-1] < trip.t_s + 6.0
    )  # a vent and a rest; lockstep is faster than who watches it
    assert summary(folder)["verdict"] == "vented"


def soro(*words: str) -> subprocess.CompletedProcess:
    """A command of a user in another terminal."""
    return subprocess.run([*SORO, *words], capture_output=True, text=True, timeout=2 * LIMIT_S)


@pytest.mark.process
@pytest.mark.parametrize("valves", [True, False], ids=["valves, enabled again", "direct, left vented"])
def test_a_vent_that_a_user_asks_for_is_an_event_and_not_the_end(domain, tmp_path, valves):
    """Vent, reset and enable on a run; in lockstep, where no node is late."""
    duration_s = 90.0 if valves else 20.0
    platform = patient_platform(tmp_path, real_time=False) if valves else ""
    changes = ("mode=lockstep", f"duration_s={duration_s:g}", f"platform={platform}")
    clock = ClockListener()
    process = start_run(tmp_path / "runs", *changes)
    try:
        clock.wait(3.0, COMPILED_S)
        vented = soro("vent")
        assert vented.returncode == 0, vented
        if valves:
            assert soro("reset").returncode == 0
            wait_until(lambda: soro("enable").returncode == 0, "an arm at rest, to be enabled")
        out, err = process.communicate(timeout=4 * LIMIT_S)
    finally:
        process.kill()
        clock.close()
    folder = only_run(tmp_path / "runs")
    found = summary(folder)
    assert (process.returncode, found["verdict"]) == ((0, "good") if valves else (1, "vented")), out + err
    assert found["faults"] == []
    recording = read(folder, "track_circle")
    (vent,) = (event for event in recording.events if event.kind in ("vent", "trip"))
    assert (vent.kind, vent.text) == ("vent", "vented: vent requested")
    assert f"vented on request at {vent.t_s:.2f} s" in found["notes"]
    assert recording.reading.t[-1] > duration_s  # to its end, and until the arm is empty
    pressed = np.any(recording.reading.value > 15e3, axis=1)
    assert np.any(pressed & (recording.reading.t > vent.t_s + 1.0)) == valves
    if not valves:
        assert found["reason"] == f"on request at {vent.t_s:.2f} s, and not enabled again"
