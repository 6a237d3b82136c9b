"""The loop of a scene in lockstep without ROS, judged as `soro run` judges a recording of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soro_lab.scene import Scene
from soro_ros.recordings import report
from soro_ros.recordings.recording import RunRecording
from soro_ros.recordings.verdict import Verdict, judge
from soro_ros.run.end import End
from soro_ros.study.closed_loop import run_in_process


@dataclass(frozen=True)
class Outcome:
    """RMS of the tip error of the last seconds, part of the length, and the verdict.

    `configured` is that error to the configured circle, where the law has chosen another one; else NaN.
    """

    error: float
    verdict: Verdict
    configured: float = np.nan

    @property
    def notes(self) -> str:
        """What controller and estimator say last."""
        return "; ".join(note.partition(": ")[2] for note in self.verdict.notes)


def outcome(scene: Scene) -> Outcome:
    """Run the loop of a scene and judge it."""
    return judged(*run_in_process(scene), scene)


def judged(recording: RunRecording, end: End, scene: Scene) -> Outcome:
    """Return the outcome of a run."""
    summary = report.summarise(recording, scene)
    verdict = judge(summary, scene, end, recording)
    if summary is None or end.status:
        return Outcome(np.inf, verdict)
    length = scene.loaded_robot.length
    return Outcome(
        summary.tip_error_last_rms_m / length, verdict, summary.configured_tip_error_last_rms_m / length
    )
