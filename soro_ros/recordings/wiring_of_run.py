"""What the measurement of the probe finds in a whole run: wiring, chambers and base of the arm."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from soro_core.adaptation.config import mass_prior
from soro_core.control.probing.findings import FAIL, judge_answers
from soro_core.control.probing.wiring import HeldState, WiringModel
from soro_core.errors import ModelError
from soro_core.model.discretised import discretised
from soro_lab.scene import Scene
from soro_ros.recordings.causes import NO_ANSWERS, Answers
from soro_ros.recordings.recording import RunRecording

# Number of windows of a run, the length of each [s], and their fewest samples.
_WINDOWS, _WINDOW_S, _SAMPLES = 40, 0.2, 8


def wiring_answers(recording: RunRecording, scene: Scene) -> Answers:
    """Return what the answers to all pressures of a run say; nothing where they are those of its file."""
    robot = scene.loaded_robot
    if recording.estimated_state.t.size < _SAMPLES or recording.reading.names != robot.chamber_names:
        return NO_ANSWERS
    arm = discretised(robot, scene.controller_node().model)
    states = list(_held_states(recording))
    if len(states) < _WINDOWS // 2 or states[0].q.size != arm.n_q:
        return NO_ANSWERS
    model = WiringModel(arm, mass_prior(arm)[2])
    try:
        found, _ = judge_answers(model, robot.chamber_names, states, whole_run=True)
    except (ModelError, np.linalg.LinAlgError):
        return NO_ANSWERS
    return Answers(found[0].text, found[0].step, found[0].level == FAIL) if found else NO_ANSWERS


def _held_states(recording: RunRecording) -> Iterator[HeldState]:
    """Yield the means over windows of a run."""
    state, reading = recording.estimated_state, recording.reading
    for begin_s in np.linspace(0.0, state.t[-1] - _WINDOW_S, _WINDOWS):
        inside = (state.t >= begin_s) & (state.t < begin_s + _WINDOW_S)
        pressed = (reading.t >= begin_s) & (reading.t < begin_s + _WINDOW_S)
        q, t, pressure = state.value[inside], state.t[inside], reading.value[pressed]
        if len(q) < _SAMPLES or not len(pressure) or not np.isfinite(pressure).all():
            continue
        # A parabola: its slope in the middle, and its curvature.
        bent, slope, _ = np.polyfit(t - t.mean(), q, 2)
        yield HeldState(q.mean(axis=0), slope, 2.0 * bent, pressure.mean(axis=0))
