"""The loop of a scene in lockstep without ROS, judged as `soro run` judges a recording of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from soro_core.arrays import Array
from soro_core.config import with_changes
from soro_core.errors import SoroError
from soro_core.loop import Tick
from soro_core.twin import Twin
from soro_lab.scene import Scene
from soro_lab.scene.loop import loop_of
from soro_ros.recordings import report
from soro_ros.recordings.events import NodeStatus
from soro_ros.recordings.recording import EMPTY, RunRecording, TopicSeries
from soro_ros.recordings.verdict import Verdict, judge
from soro_ros.run.end import End
from soro_ros.topics.diagnostics import NO_COMMAND, NO_ESTIMATE, add_prefix


@dataclass(frozen=True)
class Outcome:
    """RMS of the tip error of the last seconds, part of the length, and the verdict."""

    error: float
    verdict: Verdict

    @property
    def notes(self) -> str:
        """What controller and estimator say last."""
        return "; ".join(note.partition(": ")[2] for note in self.verdict.notes)


def ticks_of(scene: Scene) -> Iterator[Tick[Any, Any]]:
    """Run the loop of a scene in lockstep, without ROS."""
    changes: dict[str, Any] = {"pressures": "regulators", "plant_link": ""}
    if scene.loaded_platform:
        changes["regulator"] = scene.loaded_platform.regulator
    twin = Twin(scene.loaded_robot, with_changes(scene.twin_node(), **changes))
    ticks = round(scene.duration_s * scene.rate_hz)
    return loop_of(scene).run(twin, ticks, twin.dt, before_s=-twin.dt)


def outcome(scene: Scene) -> Outcome:
    """Run the loop of a scene and judge it."""
    return judged(*recorded(scene), scene)


def judged(recording: RunRecording, end: End, scene: Scene) -> Outcome:
    """Return the outcome of a run."""
    summary = report.summarise(recording, scene)
    verdict = judge(summary, scene, end, recording)
    if summary is None or end.status:
        return Outcome(np.inf, verdict)
    return Outcome(summary.tip_error_last_rms_m / scene.loaded_robot.length, verdict)


def recorded(scene: Scene) -> tuple[RunRecording, End]:
    """Run the loop of a scene; return what a recording of it has, and how it ended."""
    ticks: list[Tick[Any, Any]] = []
    end = End()
    try:
        for tick in ticks_of(scene):
            ticks.append(tick)
    except SoroError as error:  # the plant of a lost arm has no step any more
        end = End(1, str(error))
    return _recorded(ticks, scene), end


def _recorded(ticks: list[Tick[Any, Any]], scene: Scene) -> RunRecording:
    """Return ticks as the recording of a run has them."""
    t = np.array([tick.t_s for tick in ticks])
    names = scene.loaded_robot.chamber_names

    def series(values: list[Array], columns: tuple[str, ...] = ()) -> TopicSeries:
        return TopicSeries(t, np.array(values), columns)

    said, last = [], {"controller": "", "estimator": ""}
    for tick in ticks:
        command, estimate = tick.command.status, tick.estimate.status
        now = {
            "controller": add_prefix(NO_COMMAND, command.message) or command.note,
            "estimator": add_prefix(NO_ESTIMATE, estimate.message) or estimate.note,
        }
        changed = [(node, text) for node, text in now.items() if text != last[node]]
        said += [NodeStatus(tick.t_s, node, int(bool(text)), text) for node, text in changed]
        last = now
    return RunRecording(
        true_tip=series([tick.seen.tip[:3, 3] for tick in ticks]),
        estimated_tip=series([tick.estimate.tip_pose[:3, 3] for tick in ticks]),
        wanted_tip=series([tick.command.tip_reference[:3, 3] for tick in ticks]),
        command=series([tick.command.setpoint_pa for tick in ticks], names),
        reading=series([tick.seen.reading_pa for tick in ticks], names),
        estimates=EMPTY,
        diagnostics={},
        faults=(),
        estimated_state=series([tick.estimate.q for tick in ticks]),
        said=tuple(said),
    )
