"""All numbers of a report, as plain lists and dictionaries: what report.json has, and what the page shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from soro_lab.identification.arm.cases.case import Whole
from soro_lab.identification.arm.cases.physical import Unphysical
from soro_lab.identification.arm.judge import Error, unit_of
from soro_lab.identification.arm.report.found import (
    correlation_of,
    frames_of,
    laws_of,
    numbers_of,
    profiles_of,
    undetermined_of,
)
from soro_lab.identification.arm.report.repeats import repeats
from soro_lab.identification.arm.report.traces import ShapeTrace
from soro_lab.identification.arm.report.verdict import verdict_of
from soro_lab.identification.arm.robot_yaml import combined
from soro_lab.identification.arm.search.profile import Profile
from soro_lab.identification.arm.stages import ArmIdentification
from soro_lab.identification.recording import Recording
from soro_lab.identification.recording.streams import Stream

Content = dict[str, Any]

# A run counts as written off if its samples have less than this weight in the fit on average, if more than
# this share of them is beyond three expected errors, or if its error is so many times that of the middle run.
_WEIGHT, _BEYOND, _TIMES = 0.5, 0.2, 3.0


@dataclass(frozen=True)
class ReportContent:
    """What a report is about.

    Attributes
    ----------
    found : ArmIdentification
        The identified arm and its errors.
    accept : float
        Largest RMS error on held-out sections, in ranges moved.
    profiles : tuple of Profile
        The cost along single numbers.
    unphysical : tuple of Unphysical
        Fitted values that no arm has.
    out : str
        The robot file that is written.
    """

    found: ArmIdentification
    accept: float
    profiles: tuple[Profile, ...]
    unphysical: tuple[Unphysical, ...]
    out: str


def content_of(result: ReportContent, traces: Sequence[ShapeTrace]) -> Content:
    """Return all numbers of a report."""
    found = result.found
    runs = _runs(traces)
    content: Content = {
        "robot": found.robot.name,
        "file": result.out,
        "data": data_of(found),
        "errors": [*_errors(found.fitted, "fitted"), *_errors(found.held_out, "held out")],
        "runs": runs,
        "laws": laws_of(found),
        "numbers": numbers_of(found, result.unphysical),
        "correlation": correlation_of(found),
        "profiles": profiles_of(result.profiles),
        "undetermined": undetermined_of(found),
        "combinations": [{**asdict(each), "name": each.name} for each in combined(found)],
        "unphysical": [{**asdict(each), "numbers": list(each.numbers)} for each in result.unphysical],
        "repeats": [{**asdict(each), "unit": _unit(traces, each.shape)} for each in repeats(traces)],
        "frames": frames_of(found),
        "residuals": [_residuals(traces, name) for name in dict.fromkeys(t.shape for t in traces)],
    }
    written_off = [f"{run['run']}, {run['shape']}" for run in runs if run["written_off"]]
    return {
        "verdict": verdict_of(found, result.accept, result.out, result.unphysical, written_off),
        **content,
    }


def standardised(trace: ShapeTrace) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return measured minus predicted in expected errors (n, k)."""
    return np.asarray(trace.differences / trace.expected)


def _runs(traces: Sequence[ShapeTrace]) -> list[Content]:
    rows: list[Content] = []
    for trace in traces:
        width = trace.stream.motion().reshape(len(trace.stream.t), -1).shape[1]
        size = np.linalg.norm(trace.differences[:, :width], axis=1)
        beyond = np.abs(standardised(trace)).max(axis=1) > 3.0
        rows.append(
            {
                "run": trace.run,
                "shape": trace.shape,
                "unit": unit_of(trace.stream),
                "samples": len(size),
                "rms": float(np.sqrt(np.mean(size**2))),
                "worst": float(size.max()),
                "worst_at_s": float(trace.stream.t[int(np.argmax(size))]),
                "beyond_three": float(beyond.mean()),
                "weight": float(trace.weights.mean()),
            }
        )
    for row in rows:
        same = [other["rms"] for other in rows if other["shape"] == row["shape"]]
        # Of two runs the middle is their mean, which one bad run lifts: the smaller one counts.
        middle = float(np.sort(same)[(len(same) - 1) // 2])
        why = [
            text
            for bad, text in (
                (row["weight"] < _WEIGHT, f"its samples count {100 * row['weight']:.0f} % in the fit"),
                (row["beyond_three"] > _BEYOND, "many samples are beyond three expected errors"),
                (len(same) > 1 and row["rms"] > _TIMES * middle, "its error is far above that of other runs"),
            )
            if bad
        ]
        row["written_off"], row["why"] = bool(why), "; ".join(why)
    return rows


def _errors(errors: Sequence[Error], part: str) -> list[Content]:
    return [
        {
            "run": e.case,
            "shape": e.shape,
            "part": part,
            "unit": e.unit,
            "rms": e.rms,
            "worst": e.worst,
            "turn_rms": None if np.isnan(e.turn_rms) else e.turn_rms,
            "samples": e.samples,
            "beyond_three": e.written_off,
        }
        for e in errors
    ]


def _unit(traces: Sequence[ShapeTrace], shape: str) -> str:
    return unit_of(next(trace.stream for trace in traces if trace.shape == shape))


def _residuals(traces: Sequence[ShapeTrace], shape: str) -> Content:
    """What is left of one shape, in expected errors, beside the normal distribution."""
    rows = np.concatenate([standardised(t).ravel() for t in traces if t.shape == shape])
    return {
        "shape": shape,
        "mean": float(rows.mean()),
        "deviation": float(rows.std()),
        "beyond_three": float(np.mean(np.abs(rows) > 3.0)),
        "samples": len(rows),
    }


def data_of(found: ArmIdentification) -> list[dict[str, Any]]:
    """Return an entry for each recording."""
    return [_entry(case.recording, found) for case in found.problem.cases if isinstance(case, Whole)]


def _entry(recording: Recording, found: ArmIdentification) -> dict[str, Any]:
    first, last = recording.span

    def sections(cases: tuple[Whole, ...]) -> list[list[float]]:
        inside = [case.judged for case in cases if case.recording is recording]
        return [[max(float(a), first), min(float(b), last)] for parts in inside for a, b in parts]

    faults = {fault.stream: fault for fault in recording.faults}
    return {
        "run": recording.name,
        "start_s": first,
        "duration_s": last - first,
        "frame": recording.frame,
        "streams": [
            {
                "stream": stream.name,
                "samples": len(stream.t),
                "rate_hz": _rate(stream),
                "left_out": faults[stream.name].left_out if stream.name in faults else 0,
                "why": str(faults.get(stream.name, "no faults")),
            }
            for stream in recording.streams
        ],
        "fitted_s": sections(found.fit_cases),
        "held_out_s": sections(found.held_cases),
        "stated_levels": recording.is_stated,
        "notes": list(recording.notes),
    }


def _rate(stream: Stream) -> float | None:
    if len(stream.t) < 2:
        return None
    return float((len(stream.t) - 1) / (stream.t[-1] - stream.t[0]))
