"""The part of a report on the recordings: how long, how dense, what was left out, what was held out."""

from __future__ import annotations

from typing import Any

from soro_lab.identification.arm.cases.case import Whole
from soro_lab.identification.arm.stages import ArmIdentification
from soro_lab.identification.recording import Recording
from soro_lab.identification.recording.streams import Stream


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
