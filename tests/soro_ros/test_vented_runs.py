"""A run that trips is recorded until its arm is empty; one that a user vents goes on."""

import subprocess

import numpy as np
import pytest
import rclpy
from rclpy.node import Node

from soro_ros.recordings.recording import read
from soro_ros.view.live import Buttons
from tests.patience import COMPILED_S, patient_platform
from tests.soro_ros.running import ClockListener, end, only_run, run, start_run, summary, wait_until


@pytest.mark.process
def test_a_trip_is_recorded_until_the_chambers_are_empty(domain, tmp_path):
    """In lockstep, where the vent is a tick of the devices of its own."""
    platform = patient_platform(tmp_path, real_time=False)
    changes = (f"platform={platform}", "faults=[{at: 2.5, fault: burst, chamber: link0/chamber1}]")
    changes = ("mode=lockstep", "duration_s=8", *changes)
    # Its own Python waits at the end until the arm rests, as it does for a user.
    status, output, folder = run(tmp_path / "runs", *changes, popen=subprocess.Popen)
    assert status == 1, output
    recording = read(folder, "track_circle")
    (trip,) = (event for event in recording.events if event.kind == "trip")
    t, pressure = recording.reading.t, recording.reading.value
    pressed_s = t[np.any(np.abs(pressure) >= 5e3, axis=1)][-1]
    assert 2.5 < trip.t_s < pressed_s < trip.t_s + 1.0
    assert 1.99 <= t[-1] - pressed_s < 7.0  # lockstep may be faster than who watches it
    assert summary(folder)["verdict"] == "vented"


class Panel:
    """The buttons of the view of a run, and what they have answered; `ClockListener` has joined ROS."""

    def __init__(self) -> None:
        self._node, self.told = Node("panel", namespace="track_circle"), []
        self._buttons = Buttons(self._node, self.told.append)

    def press(self, button: str, answers: int = 1) -> list[str]:
        """Press a button and wait for its answers."""
        self.told.clear()
        self._buttons.press(button)
        self._buttons.work()

        def is_answered() -> bool:
            rclpy.spin_once(self._node, timeout_sec=0.05)
            self._buttons.work()
            return len(self.told) >= answers

        wait_until(is_answered, button, every_s=0.0)
        return list(self.told)

    def close(self) -> None:
        self._buttons.close()
        self._node.destroy_node()


@pytest.mark.process
@pytest.mark.parametrize("valves", [True, False], ids=["valves, enabled again", "direct, left vented"])
def test_a_vent_that_a_user_asks_for_is_an_event_and_not_the_end(domain, tmp_path, valves):
    """Vent, reset and enable by the buttons of the view, in lockstep, where no node is late.

    Simulated time does not wait for who presses: the run is far longer than it takes, and ends by Ctrl-C.
    """
    platform = patient_platform(tmp_path, real_time=False) if valves else ""
    changes = ("mode=lockstep", "duration_s=300", f"platform={platform}")
    clock, panel = ClockListener(), Panel()
    process = start_run(tmp_path / "runs", *changes)
    try:
        clock.wait(2.5, COMPILED_S)
        assert all("refused" not in line for line in panel.press("vent", answers=2))
        if valves:
            # The driver refuses it until it has the zero that the controller commands from the vent on.
            wait_until(lambda: "refused" not in panel.press("reset")[0], "a reset")
            wait_until(
                lambda: all("enabled" in line for line in panel.press("enable", answers=2)),
                "an arm at rest, to be enabled",
            )
        clock.wait_for(2.0)
        status, out, err = end(process)
    finally:
        process.kill()
        panel.close()
        clock.close()
    folder = only_run(tmp_path / "runs")
    found = summary(folder)
    assert (status, found["verdict"], found["faults"]) == (130, "vented", []), out + err
    assert found["reason"] == "interrupted"
    recording = read(folder, "track_circle")
    (vent,) = (event for event in recording.events if event.kind in ("vent", "trip"))
    assert (vent.kind, vent.text) == ("vent", "vented: vent requested")
    assert vent.t_s > 2.4  # from the first set point on
    pressed = np.any(recording.reading.value > 15e3, axis=1)
    assert np.any(pressed & (recording.reading.t > vent.t_s + 1.0)) == valves
