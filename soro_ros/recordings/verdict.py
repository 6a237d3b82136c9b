"""The verdict on a run: good, lost, vented or refused, and why."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from soro_lab.scene import Scene
from soro_ros.recordings.report import WINDOW_S, Summary

Word = Literal["good", "lost", "vented", "refused"]

# Words of trips by which nodes or devices are late.
_LATE = ("command lost", "stale_reading")


@dataclass(frozen=True)
class Verdict:
    """The verdict in one word, and its reason in one line; `good` needs none."""

    word: Word
    reason: str = ""

    def __str__(self) -> str:
        return f"{self.word}: {self.reason}" if self.reason else self.word


def judge(
    summary: Summary | None,
    scene: Scene,
    status: int,
    failure: str,
    warnings: Sequence[str] = (),
    recording_failure: str = "",
) -> Verdict:
    """Judge a run by its exit status and its figures.

    Parameters
    ----------
    summary : Summary or None
        Figures of the run; None without a recording.
    scene : Scene
        Limits of the verdict.
    status : int
        Exit status so far: 2 if the run was refused, another value but 0 if it ended early.
    failure : str
        Why the run ended early.
    warnings : sequence of str
        What happened meanwhile to nodes that only look on; they stand behind the reason.
    recording_failure : str
        Why the recording has no end; empty where it has one.

    Returns
    -------
    Verdict
    """
    found = _judged(summary, scene, status, failure, recording_failure)
    more = [line for line in warnings if line not in found.reason]
    return replace(found, reason="; ".join(filter(None, (found.reason, *more))))


def _judged(
    summary: Summary | None, scene: Scene, status: int, failure: str, recording_failure: str
) -> Verdict:
    if status == 2:
        return Verdict("refused", failure)
    if status != 0 or (summary is not None and summary.faults):
        trips = "; ".join(summary.faults) if summary is not None else ""
        return Verdict("vented", trips or failure or "interrupted")
    if recording_failure:
        return Verdict("lost", f"not judged, because the recording has no end: {recording_failure}")
    if scene.faults:
        return Verdict("good")
    if summary is None:
        return Verdict("good", "not judged: no tip was recorded")
    if summary.duration_s < WINDOW_S:
        return Verdict("good", f"too short to be judged, under {WINDOW_S:g} s")
    limits, lost = scene.verdict, []
    length = scene.loaded_robot.length
    error, most = summary.tip_error_last_rms_m, limits.tip_error_part * length
    if not math.isfinite(error):
        lost.append(f"the tip was not known throughout the last {WINDOW_S:g} s")
    elif error > most:
        lost.append(
            f"tip error {1e3 * error:.1f} mm RMS in the last {WINDOW_S:g} s, more than "
            f"{limits.tip_error_part:.0%} of the length ({1e3 * most:.1f} mm)"
        )
    if summary.saturated_part > limits.at_bound_part:
        lost.append(
            f"{summary.saturated_part:.0%} of the set points at a bound, more than {limits.at_bound_part:.0%}"
        )
    return Verdict("lost", "; ".join(lost)) if lost else Verdict("good")


def advice(verdict: Verdict, scene: Scene) -> str:
    """Return what a user can do about a verdict, in one line; empty if that is not known.

    Parameters
    ----------
    verdict : Verdict
    scene : Scene
    """
    if scene.mode != "real_time" or scene.faults or not any(word in verdict.reason for word in _LATE):
        return ""
    return "a node was late: is the machine busy? --set mode=lockstep has no deadlines (docs/real_time.md)"


def with_verdict(summary: Summary, verdict: Verdict) -> Summary:
    """Return the figures with the verdict on them."""
    return replace(summary, verdict=verdict.word, reason=verdict.reason)


def write(folder: Path, summary: Summary | None, verdict: Verdict) -> None:
    """Write ``summary.json`` with the figures, if any, and the verdict.

    Parameters
    ----------
    folder : Path
        Folder of the run.
    summary : Summary or None
        Figures of the run.
    verdict : Verdict
        The verdict.
    """
    alone = {"verdict": verdict.word, "reason": verdict.reason}
    text = json.dumps(alone, indent=2) if summary is None else with_verdict(summary, verdict).to_json()
    (folder / "summary.json").write_text(text)
