"""The verdict on a run: good, poor, lost, vented or refused, and why."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from soro_core.loop import AT_LIMIT_PART
from soro_hardware.hil.judge import TRIP_STEPS
from soro_lab.scene import Scene
from soro_ros.recordings.causes import end_of_commands, probable_cause
from soro_ros.recordings.events import warnings_at
from soro_ros.recordings.evidence import evidence_of
from soro_ros.recordings.recording import RunRecording
from soro_ros.recordings.report import MISSING_S, WINDOW_S, Summary, is_short
from soro_ros.run.end import End

# Words of a trip by which no command came; those of trips by which nodes or devices are late, with the keys
# of their limits and the largest values of these.
_NO_COMMANDS = "command lost"
_LATE = {
    _NO_COMMANDS: "limits.command_age_s, at most 0.5",
    "readings lost": "limits.reading_age_s, at most 0.5",
    "stale_reading": "stale_s and stale_cycles of the platform file; a scene without valves has none, "
    "--set platform=",
}

_DEACTIVATED = "deactivated"
# Time that a report of a node may be late on a busy machine [s].
_ARRIVES_S = 1.0


@dataclass(frozen=True)
class Verdict:
    """The verdict in one word, its reason in one line, which `good` does not need, and what the nodes say.

    The word is good, poor, lost, vented or refused.
    """

    word: str
    reason: str = ""
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.word}: {self.reason}" if self.reason else self.word


# From the best to the worst.
_WORDS = ("good", "poor", "lost", "vented", "refused")


def worst(verdicts: Mapping[str, Verdict]) -> Verdict:
    """Return the verdict on several arms, that of the worst of them; what all of them say is said once."""
    word = max((one.word for one in verdicts.values()), key=_WORDS.index)
    if len(set(verdicts.values())) == 1:
        return next(iter(verdicts.values()))
    reasons = [f"{arm}: {one}" for arm, one in verdicts.items() if one.word != "good"]
    notes = [f"{arm}: {note}" for arm, one in verdicts.items() for note in one.notes]
    return Verdict(word, "; ".join(reasons), tuple(notes))


def judge(summary: Summary | None, scene: Scene, end: End, recording: RunRecording | None = None) -> Verdict:
    """Judge a run by its end and its figures.

    Parameters
    ----------
    summary : Summary or None
        Figures of the run; None without a recording.
    scene : Scene
        Limits of the verdict.
    end : End
        Its warnings stand behind the reason.
    recording : RunRecording, optional
        What shows the cause of a bad run, and what the nodes said.
    """
    said = later = dict(end.said)
    if recording is not None:
        end_s = min(scene.duration_s, _trip_s(recording))
        if end.status == 0 and summary is not None:  # before a trip commands may have ended for the reason
            end_s = min(end_s, summary.duration_s)
        said, later = (warnings_at(recording.said, end_s + wait_s) for wait_s in (0.0, _ARRIVES_S))
    if end.status == 2:
        found = Verdict("refused", end.error)
    elif not end.has_begun:
        found = Verdict("vented", f"nothing has moved, the run never began: {end.error or 'interrupted'}")
    elif end.status != 0 or (summary is not None and summary.faults):
        found = Verdict("vented", _why_vented(summary, end, (said, later)))
    elif end.recording_failure:
        found = Verdict("lost", f"not judged, because the recording has no end: {end.recording_failure}")
    elif recording is not None and not recording.wanted_tip.t.size:  # it comes with each command of the law
        controller = said.get("controller", "")
        why = end_of_commands(controller, said.get("estimator", "")) or (
            controller and f"controller: {controller}"
        )
        found = Verdict("lost", "; ".join(filter(None, ("the law has given no command", why))))
    elif recording is not None and (left := _left_vented(recording, scene)):
        found = Verdict("vented", left)
    else:
        found = _followed(summary, scene, recording)
    more = [line for line in end.warnings if line not in found.reason]
    reason = "; ".join(filter(None, (found.reason, *more)))
    notes: tuple[str, ...] = ()
    if recording is not None:
        notes = (*(_requested(recording) if end.status == 0 else ()), *_touched(recording))
    if summary is None or is_short(summary):  # an estimate that has just begun is no finding
        said = {node: text for node, text in said.items() if "NIS" not in text}
    return replace(found, reason=reason, notes=(*found.notes, *notes, *_notes(said)))


def _followed(summary: Summary | None, scene: Scene, recording: RunRecording | None) -> Verdict:
    """Judge how well the arm followed its reference to the end."""
    if scene.faults:
        return Verdict("good")
    if summary is None:
        return Verdict("good", "not judged: no tip was recorded")
    if is_short(summary):  # chambers are still filled, and the load is not known yet
        return Verdict("good", notes=(f"too short to be judged: how well it follows takes {WINDOW_S:g} s",))
    last = f"the last {WINDOW_S:g} s"
    limits, length, error = scene.verdict, scene.loaded_robot.length, summary.tip_error_last_rms_m
    lost: list[str] = []
    poor: list[str] = []
    if not math.isfinite(error):
        lost.append(f"the tip was not known throughout {last}")
    for part, found in ((limits.tip_error_part, lost), (limits.good_part, poor)):
        if error > part * length:
            found.append(
                f"tip error {1e3 * error:.1f} mm RMS in {last}, {error / length:.1%} of the "
                f"length, more than {100 * part:g}% ({1e3 * part * length:.1f} mm)"
            )
    asked = summary.configured_tip_error_last_rms_m
    if asked > limits.good_part * length:
        poor.append(
            f"the tip is {1e3 * asked:.1f} mm RMS ({asked / length:.1%}) off the configured circle in {last}"
        )
    # Fingers that close by some of their chambers keep the others empty.
    poor_part = AT_LIMIT_PART if limits.at_bound_part < 1.0 else 1.0
    for what, part, most, found in (
        ("", summary.saturated_part, limits.at_bound_part, lost),
        (f" of {last}", summary.saturated_last_part, poor_part, poor),
    ):
        if part > most:
            found.append(f"{part:.0%} of the set points{what} at a bound, more than {100 * most:g}%")
    if not (lost or poor):
        return Verdict("good")
    reason = "; ".join(lost or poor)
    if recording is not None:
        cause, step = probable_cause(evidence_of(recording, scene, summary))
        reason += f"; probable cause: {cause}; next: {step}"
    return Verdict("lost" if lost else "poor", reason)


def _why_vented(summary: Summary | None, end: End, warnings: Sequence[Mapping[str, str]]) -> str:
    """Return the first cause of a vent: what ended the commands says it, not the limiter that missed them.

    On a busy machine it may arrive behind the trip: `warnings` are those at the trip and those soon after.
    """
    trips = "; ".join(summary.faults) if summary is not None else ""
    if _NO_COMMANDS in (trips or end.error):
        ends = (end_of_commands(said.get("controller", ""), said.get("estimator", "")) for said in warnings)
        # A run that a trip ends is deactivated, and says so.
        why = next((why for why in ends if why and not why.endswith(_DEACTIVATED)), "")
        return why or (end.error if _NO_COMMANDS not in end.error else "") or trips or end.error
    return trips or end.error or "interrupted"


def _left_vented(recording: RunRecording, scene: Scene) -> str:
    """Return that the arm was vented on request until the end; empty if it was not."""
    asked = [event.t_s for event in recording.events if event.kind == "vent"]
    ended_s = float(recording.wanted_tip.t[-1]) if recording.wanted_tip.t.size else 0.0
    if not asked or ended_s > scene.duration_s - MISSING_S:
        return ""
    return f"on request at {asked[-1]:.2f} s, and not enabled again"


def _requested(recording: RunRecording) -> tuple[str, ...]:
    """Return a line for each vent that someone asked for."""
    return tuple(f"vented on request at {one.t_s:.2f} s" for one in recording.events if one.kind == "vent")


def _touched(recording: RunRecording) -> tuple[str, ...]:
    """Return a line on when the arm touched what no press wanted it to, by what the estimator says."""
    end_s = float(recording.wanted_tip.t[-1]) if recording.wanted_tip.t.size else 0.0
    events = [event for event in recording.events if event.kind == "contact"]
    ends_s = [*(event.t_s for event in events[1::2]), end_s]
    found = [
        (event, until_s)
        for event, until_s in zip(events[::2], ends_s, strict=False)
        if not np.any(np.abs(recording.wanted_force.t - event.t_s) < MISSING_S)
    ]
    if not found:
        return ()
    first, lasted_s = found[0][0], sum(until_s - event.t_s for event, until_s in found)
    often = f", in {len(found)} contacts" if len(found) > 1 else ""
    return (f"the arm {first.text} at {first.t_s:.2f} s, for {lasted_s:.2f} s in all{often}",)


def _trip_s(recording: RunRecording) -> float:
    """Return the time of the first trip under control [s]; infinite without one."""
    trips = (event.t_s for event in recording.events if event.kind == "trip" and event.t_s >= 0.0)
    return min(trips, default=math.inf)


def _notes(said: Mapping[str, str]) -> tuple[str, ...]:
    """Return what the nodes say, those of controller and estimator first."""
    first = sorted(said, key=lambda node: (node not in ("controller", "estimator"), node))
    return tuple(f"{node}: {said[node].removeprefix(f'{node}: ')}" for node in first)


def advice(verdict: Verdict, scene: Scene) -> str:
    """Return what a user can do about a vented run, in one line; empty if that is not known."""
    keys = next((keys for word, keys in _LATE.items() if word in verdict.reason), "")
    if verdict.word == "vented" and scene.valves == "real":  # no limit is raised beside them
        step = next((step for word, step in TRIP_STEPS.items() if word in verdict.reason), "")
        check = f"soro doctor {scene.platform} checks the valves without pressure"
        return "next: " + ("; ".join((step, check)) if step and not keys else check)
    if scene.mode != "real_time" or scene.faults or not keys:
        return ""
    return (
        "a node or a device was late: is the machine busy? --set mode=lockstep has no deadlines; else allow "
        f"more: {keys} (docs/real_time.md)"
    )


def with_verdict(summary: Summary, verdict: Verdict) -> Summary:
    """Return the figures with the verdict on them."""
    return replace(summary, verdict=verdict.word, reason=verdict.reason, notes=verdict.notes)


def write(
    folder: Path,
    summary: Summary | None,
    verdict: Verdict,
    arms: Mapping[str, tuple[Summary | None, Verdict]] | None = None,
    bodies: Mapping[str, Mapping[str, Any]] | None = None,
) -> None:
    """Write ``summary.json`` with the figures, if any, and the verdict.

    Parameters
    ----------
    folder : Path
        Folder of the run.
    summary : Summary or None
        Figures of the run.
    verdict : Verdict
    arms : mapping of str to tuple, optional
        Figures and verdict of each arm by its name, where there are several.
    bodies : mapping of str to mapping, optional
        Figures of each body by its name.
    """
    figures = _figures(summary, verdict)
    if bodies:
        figures["bodies"] = dict(bodies)
    if arms:
        figures["arms"] = {name: _figures(*one) for name, one in arms.items()}
    (folder / "summary.json").write_text(json.dumps(figures, indent=2))


def _figures(summary: Summary | None, verdict: Verdict) -> dict[str, Any]:
    if summary is not None:
        return with_verdict(summary, verdict).to_dict()
    return {"verdict": verdict.word, "reason": verdict.reason, "notes": list(verdict.notes)}
