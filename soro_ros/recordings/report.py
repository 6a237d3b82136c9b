"""Figures of a run, and their table."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.markup import escape
from rich.table import Table

from soro_core.arrays import Array
from soro_core.control.laws.registry import find_law
from soro_core.control.pressures import actuation
from soro_lab.scene import Scene
from soro_ros.recordings import shadow_report
from soro_ros.recordings.events import Event
from soro_ros.recordings.recording import RunRecording, TopicSeries, read

# Length [s] of the windows that are compared: the start of the adaptation, and the end of the run.
WINDOW_S = 5.0
SETTLED_PART_OF_LENGTH = 0.05
# Time [s] that may be missing at either end of a window.
MISSING_S = 0.2
# A gap in a recording is this many times as long as its samples are usually apart.
USUAL = 20.0


@dataclass(frozen=True)
class Summary:
    """Figures of a run; NaN where the run was too short."""

    duration_s: float
    tip_error_first_rms_m: float
    tip_error_last_rms_m: float
    tip_error_last_max_m: float
    estimator_error_last_rms_m: float
    settling_s: float
    pressure_min_pa: float
    pressure_max_pa: float
    saturated_part: float
    frames_sent: int
    frames_lost: int
    lateness_p50_ms: float
    lateness_p99_ms: float
    overruns: int
    faults: tuple[str, ...]
    shadow: shadow_report.Differences | None = None
    saturated_last_part: float = 0.0
    force_error_last_rms_n: float = float("nan")
    force_estimate_error_last_rms_n: float = float("nan")
    configured_tip_error_last_rms_m: float = float("nan")
    verdict: str = ""
    reason: str = ""
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the figures by name; an unknown figure is None."""
        return {
            k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in asdict(self).items()
        }


def summarise(recording: RunRecording, scene: Scene) -> Summary | None:
    """Return the figures of a run, as `of_scene` gives it, or None if the controller never ran."""
    t, error = tip_error(recording, scene.duration_s)
    if t.size < 2:
        return None
    length = scene.loaded_robot.length
    first = window(t, scene.controller.reference.start_s)
    last = window(t, scene.duration_s - last_s(scene), last_s(scene))
    estimated = recording.estimated_tip
    estimator_error = (
        np.linalg.norm(estimated.at(t) - recording.true_tip.at(t), axis=1)
        if estimated.t.size
        else np.full(t.size, np.nan)
    )
    at_goal, of_estimate = force_errors(recording, t[last])
    loop = recording.diagnostics.get("regulator", recording.diagnostics.get("twin", {}))
    late = loop if scene.mode == "real_time" else {}  # lockstep has no schedule
    low, high = pressure_bounds(scene)
    command = recording.command
    command = command.at_times(in_control(recording, command.t, scene.duration_s))
    at_bound = (command.value <= low + 1.0) | (command.value >= high - 1.0)
    at_bound_last = at_bound[command.t >= scene.duration_s - last_s(scene)]
    reading = within(recording.reading, scene.duration_s).value
    reading = reading[np.isfinite(reading)]  # none of the chambers of a silent device
    again = enabled_again(recording, t)
    begin_s = float(t[again]) if again else 0.0
    settled = settling_time(t[again:] - begin_s, error[again:], SETTLED_PART_OF_LENGTH * length)
    return Summary(
        duration_s=float(t[-1]),
        tip_error_first_rms_m=_rms(error[first]),
        tip_error_last_rms_m=_rms(error[last]),
        tip_error_last_max_m=float(error[last].max()) if last.any() else float("nan"),
        estimator_error_last_rms_m=_rms(estimator_error[last]),
        settling_s=settled if _is_complete(float(t[-1]), recording.faults, scene) else float("nan"),
        pressure_min_pa=float(reading.min()) if reading.size else float("nan"),
        pressure_max_pa=float(reading.max()) if reading.size else float("nan"),
        saturated_part=_part(at_bound),
        saturated_last_part=_part(at_bound_last),
        frames_sent=int(loop.get("frames_sent", 0)),
        frames_lost=int(loop.get("frames_lost", 0)),
        lateness_p50_ms=float(late.get("lateness_p50_ms", "nan")),
        lateness_p99_ms=float(late.get("lateness_p99_ms", "nan")),
        overruns=int(late.get("overruns", 0)),
        faults=recording.faults,
        shadow=shadow_report.summarise(recording.shadow, scene.duration_s),
        force_error_last_rms_n=_rms(at_goal),
        force_estimate_error_last_rms_n=_rms(of_estimate),
        configured_tip_error_last_rms_m=_rms(configured_tip_error(recording, t[last])),
    )


def pressure_bounds(scene: Scene) -> tuple[float, float]:
    """Return the lowest and highest set point [Pa gauge] of the controller of a scene."""
    pressures, _ = scene.controller_node().known_pressures(scene.loaded_platform)
    return actuation.pressure_bounds(pressures, scene.loaded_robot)


def read_run(bag: Path, scene: Scene) -> RunRecording:
    """Read the bag of a run, as its scene says what it was."""
    return of_scene(read(bag, scene.name), scene)


def of_scene(recording: RunRecording, scene: Scene) -> RunRecording:
    """Return a recording with the faults of its scene; the true tip of a real arm is the measured one."""
    injected = (Event(fault.at, "injected", "scene", str(fault)) for fault in scene.faults)
    events = tuple(sorted((*recording.events, *injected)))
    tip = recording.measured_tip if scene.arm == "real" else recording.true_tip
    return replace(recording, events=events, true_tip=tip)


def tip_error(recording: RunRecording, duration_s: float) -> tuple[Array, Array]:
    """Return times (n,) [s] and distances (n,) [m] between the tip and its reference, while under control."""
    wanted, true = recording.wanted_tip, recording.true_tip
    if wanted.t.size < 2 or true.t.size < 2:
        return np.zeros(0), np.zeros(0)
    inside = in_control(recording, true.t, duration_s)
    t = true.t[inside]
    return t, np.asarray(np.linalg.norm(true.value[inside] - wanted.at(t), axis=1))


def configured_tip_error(recording: RunRecording, t: Array) -> Array:
    """Return distances (n,) [m] between the tip and that on the configured circle at some times (n,) [s].

    Until another elongation was chosen that is the reference; empty where none was before the last of them.
    """
    asked = recording.configured_tip
    if t.size == 0 or asked.t.size < 2 or asked.t[0] > t[-1]:
        return np.zeros(0)
    wanted = np.where((t < asked.t[0])[:, None], recording.wanted_tip.at(t), asked.at(t))
    return np.asarray(np.linalg.norm(recording.true_tip.at(t) - wanted, axis=1))


def force_errors(recording: RunRecording, t: Array) -> tuple[Array, Array]:
    """Return errors (n,) [N] of the force at the tip at some times (n,) [s].

    Returns
    -------
    at_goal : ndarray
        True force along the goal, less the goal; empty where there is no goal at all of these times.
    of_estimate : ndarray
        Distance between estimated and true force across the backbone at the tip, along which no pose shows a
        force; empty where one of them is not known at all of these times.
    """
    true, nothing = recording.true_force, np.zeros(0)
    wanted, estimated, axes = recording.wanted_force, recording.estimated_force, recording.tip_axis
    if not _covers(true, t):
        return nothing, nothing
    force, at_goal, of_estimate = true.at(t), nothing, nothing
    if _covers(wanted, t):
        goal = wanted.at(t)
        size = np.linalg.norm(goal, axis=1)
        at_goal = np.sum(force * goal, axis=1) / np.maximum(size, 1e-9) - size
    if _covers(estimated, t) and _covers(axes, t):
        away, axis = estimated.at(t) - force, axes.at(t)
        axis /= np.linalg.norm(axis, axis=1)[:, None]
        of_estimate = np.linalg.norm(away - np.sum(away * axis, axis=1)[:, None] * axis, axis=1)
    return at_goal, of_estimate


def _covers(series: TopicSeries, t: Array) -> bool:
    """Whether a series has samples from the first to the last of some times [s]."""
    if t.size == 0 or series.t.size < 2:
        return False
    return bool(series.t[0] <= t[0] + MISSING_S and series.t[-1] >= t[-1] - MISSING_S)


def in_control(recording: RunRecording, t: Array, duration_s: float) -> NDArray[np.bool_]:
    """Return which times are under control: until the first trip, not while vented on request.

    Parameters
    ----------
    recording : RunRecording
    t : ndarray (n,)
        Times [s].
    duration_s : float
        End of the scene [s].
    """
    wanted = recording.wanted_tip.t
    trips = (event.t_s for event in recording.events if event.kind == "trip" and event.t_s >= 0.0)
    end_s = min(duration_s, float(wanted[-1]) if wanted.size else 0.0, *trips)
    inside = (t >= 0.0) & (t <= end_s)
    if wanted.size > 1:
        apart = np.diff(wanted)
        lost = apart > max(MISSING_S, USUAL * float(np.median(apart)))
        inside &= ~lost[np.clip(np.searchsorted(wanted, t) - 1, 0, apart.size - 1)]
    return np.asarray(inside)


def enabled_again(recording: RunRecording, t: Array) -> int:
    """Return the index of the first time [s] under control after the last vent on request; 0 without one."""
    vented_s = max((event.t_s for event in recording.events if event.kind == "vent"), default=np.inf)
    # Set points may come for a while after the vent: control begins anew behind the gap.
    begins = np.flatnonzero((np.diff(t) > MISSING_S) & (t[1:] > vented_s)) + 1
    return int(begins[-1]) if begins.size else 0


def last_s(scene: Scene) -> float:
    """Return the length of the window at the end of a run [s]: a short run is judged as a whole."""
    return min(WINDOW_S, scene.duration_s)


def window(t: Array, begin_s: float, length_s: float = WINDOW_S) -> NDArray[np.bool_]:
    """Return which times are in a window; none if they do not cover it.

    Parameters
    ----------
    t : ndarray (n,)
        Times [s].
    begin_s, length_s : float
        Begin and length of the window [s].
    """
    end_s = begin_s + length_s
    if t[0] > begin_s + MISSING_S or t[-1] < end_s - MISSING_S:
        return np.zeros(t.size, dtype=bool)
    return np.asarray((t >= begin_s) & (t <= end_s))


def settling_time(t: Array, error: Array, bound: float) -> float:
    """Return the time from which the error stays below a bound.

    Parameters
    ----------
    t, error : ndarray (n,)
        Times [s] and errors [m].
    bound : float
        Bound [m].

    Returns
    -------
    float
        Time [s]; 0 if no error is beyond the bound; NaN if the last one is.
    """
    above = np.flatnonzero(error >= bound)
    if above.size == 0:
        return 0.0
    return float(t[above[-1] + 1]) if above[-1] + 1 < t.size else float("nan")


def _is_complete(lasted_s: float, faults: tuple[str, ...], scene: Scene) -> bool:
    """Return whether a run was complete; the settling time of an interrupted run is unknown."""
    return not faults and lasted_s >= scene.duration_s - MISSING_S


def table(summary: Summary, scene: Scene, said: str = "") -> Table:
    """Return the figures as a table for the terminal.

    Parameters
    ----------
    summary : Summary
    scene : Scene
    said : str
        What the terminal has said already: why a run has vented does not stand in the table then.
    """
    shown = Table(title=title_of(scene), show_header=False)
    is_said = summary.verdict == "vented" and said != "" and summary.reason in said
    for name, value in rows(summary, scene):
        if not (is_said and name in ("reason", "trips")):
            shown.add_row(name, escape(value))
    return shown


def is_short(summary: Summary) -> bool:
    """Whether a run has ended before its figures mean anything: while the chambers are still filled."""
    return summary.duration_s < WINDOW_S - MISSING_S


def title_of(scene: Scene) -> str:
    """Return what a run was, in one line; files without their folders."""
    robot, platform = Path(scene.robot).name, Path(scene.platform).name or "the twin"
    real = "real " if scene.arm == "real" else ""
    return f"{scene.name}: {real}{robot} on {platform}, {scene.mode}"


def law_of(scene: Scene) -> str:
    """Return the name of the law, and whether it adapts itself to the arm, if it can."""
    law, adapts = scene.controller.law, "on" if scene.controller.adapt else "off"
    return f"{law}, adaptation {adapts}" if find_law(law).can_adapt else law


def rows(summary: Summary, scene: Scene) -> list[tuple[str, str]]:
    """Return the figures with their names, as texts."""
    start, last = scene.controller.reference.start_s, f"last {last_s(scene):g} s"
    adapting = " (while adapting)" if (law := law_of(scene)).endswith(", adaptation on") else ""
    return [
        *_verdict(summary),
        ("law", law),
        ("under control", f"{summary.duration_s:.2f} of {scene.duration_s:g} s"),
        (f"tip error RMS, {start:g} to {start + WINDOW_S:g} s{adapting}", _mm(summary.tip_error_first_rms_m)),
        (f"tip error RMS, {last}", _mm(summary.tip_error_last_rms_m)),
        *_configured(summary, last),
        (f"tip error max, {last}", _mm(summary.tip_error_last_max_m)),
        (f"estimator's tip error RMS, {last}", _mm(summary.estimator_error_last_rms_m)),
        *_forces(summary, last),
        (f"settling to {SETTLED_PART_OF_LENGTH:.0%} of the length", _settling(summary, scene)),
        (
            "measured pressures",
            _or_dash(f"{summary.pressure_min_pa / 1e3:.1f} to {summary.pressure_max_pa / 1e3:.1f} kPa"),
        ),
        *([] if is_short(summary) else [("set points at a bound", _at_bound(summary, last))]),
        ("frames sent / lost", f"{summary.frames_sent} / {summary.frames_lost}"),
        *_timing(summary, scene),
        *shadow_report.rows(summary.shadow),
        *_injected(scene),
        ("trips", "; ".join(summary.faults) or "none"),
    ]


def _verdict(summary: Summary) -> list[tuple[str, str]]:
    """Return the rows of the verdict, if there is one: its word, its reason, and what the nodes say."""
    found = ("verdict", summary.verdict), ("reason", summary.reason), ("notes", "\n".join(summary.notes))
    return [row for row in found if row[1]]


def _configured(summary: Summary, last: str) -> list[tuple[str, str]]:
    """Return the row of the configured circle, where the law has chosen another elongation for it."""
    value = summary.configured_tip_error_last_rms_m
    return [(f"the same to the configured circle, {last}", _mm(value))] if np.isfinite(value) else []


def _forces(summary: Summary, last: str) -> list[tuple[str, str]]:
    """Return the rows of the force at the tip, where it is known."""
    found = (
        (f"force error RMS, {last}", summary.force_error_last_rms_n),
        (f"estimator's force error RMS, {last}", summary.force_estimate_error_last_rms_n),
    )
    return [(name, f"{1e3 * value:.1f} mN") for name, value in found if np.isfinite(value)]


def _at_bound(summary: Summary, last: str) -> str:
    return f"{summary.saturated_part:.1%} ({last}: {summary.saturated_last_part:.1%})"


def _injected(scene: Scene) -> list[tuple[str, str]]:
    """Return the row of the faults that the scene injected, if there are any."""
    text = "; ".join(f"{fault} at {fault.at:g} s" for fault in scene.faults)
    return [("injected faults", text)] if text else []


def _settling(summary: Summary, scene: Scene) -> str:
    """Return the settling time as text; a run that was vented or interrupted has none."""
    if not _is_complete(summary.duration_s, summary.faults, scene):
        return "- (not run to its end)"
    if not np.isfinite(summary.settling_s):
        return "not within the run"
    return f"{summary.settling_s:.2f} s" if summary.settling_s > 0.0 else "never beyond it"


def _timing(summary: Summary, scene: Scene) -> list[tuple[str, str]]:
    """Return the rows of lateness and overruns; lockstep has no schedule."""
    if scene.mode == "lockstep":
        return []
    late = _or_dash(f"{summary.lateness_p50_ms:.2f} / {summary.lateness_p99_ms:.2f} ms")
    return [("loop lateness p50 / p99", late), ("overruns", str(summary.overruns))]


def within(series: TopicSeries, duration_s: float) -> TopicSeries:
    """Return the samples of a series from 0 to `duration_s` [s]."""
    return series.at_times((series.t >= 0.0) & (series.t <= duration_s))


def _part(flags: NDArray[np.bool_]) -> float:
    return float(flags.mean()) if flags.size else 0.0


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def _or_dash(text: str) -> str:
    return "-" if "nan" in text else text


def _mm(metres: float) -> str:
    return f"{metres * 1e3:.2f} mm" if np.isfinite(metres) else "-"
