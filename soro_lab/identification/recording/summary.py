"""A recording in a few lines of text."""

from __future__ import annotations

import numpy as np

from soro_lab.identification.recording.recording import Recording
from soro_lab.identification.recording.streams import Bend, Curvature, Imu, Series, Stream


def summary(recording: Recording) -> str:
    """Return a line a stream (rate, duration, range, faults), then what the reader has assumed."""
    faults = {each.stream: str(each) for each in recording.faults}
    names = [stream.name for stream in recording.streams]
    lines = [f"{recording.name}: {len(recording.shapes)} streams of shape in the frame {recording.frame}"]
    lines += [f"  {line(stream)}; {faults.get(stream.name, 'no faults')}" for stream in recording.streams]
    lines += [f"  {name}: {text}" for name, text in faults.items() if name not in names]
    if recording.is_stated:
        lines.append("  pressures are stated levels: none were recorded")
    return "\n".join([*lines, *(f"  {note}" for note in recording.notes)])


def line(stream: Stream) -> str:
    """Return name, place, rate, duration and range of a stream."""
    place = getattr(stream, "place", None)
    link = getattr(stream, "link", None)
    where = f" ({place})" if place is not None else f" (link {link})" if link is not None else ""
    if isinstance(stream, Bend):
        where = f" (link {link}, towards {_axis(stream.towards)})"
    if len(stream.t) < 2:
        return f"{stream.name}{where}: {len(stream.t)} samples"
    duration = float(stream.t[-1] - stream.t[0])
    rate = (len(stream.t) - 1) / duration
    return f"{stream.name}{where}: {rate:.1f} Hz for {duration:.1f} s, {_moved(stream)}"


def _moved(stream: Stream) -> str:
    low, high = stream.motion().min(axis=0), stream.motion().max(axis=0)
    if stream.name == "duty":
        return f"{100 * low.min():.0f} to {100 * high.max():.0f} % of full power"
    if isinstance(stream, Series):
        return f"{1e-3 * low.min():.1f} to {1e-3 * high.max():.1f} kPa"
    largest = float((high - low).max())
    if isinstance(stream, Curvature):
        return f"range {largest:.3g} 1/m"
    if isinstance(stream, Bend):
        return f"range {np.degrees(largest):.3g} deg"
    if isinstance(stream, Imu):
        return f"range {largest:.3g} rad/s"
    return f"range {1e3 * largest:.3g} mm"


def _axis(towards: float) -> str:
    known = {0.0: "x", 90.0: "y"}
    degrees = round(float(np.degrees(towards)), 3)
    return known.get(degrees, f"{degrees:g} deg from x")
