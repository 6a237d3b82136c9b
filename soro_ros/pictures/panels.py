"""The panels of the pictures of a run: each draws one part of a recording into axes of matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from soro_core.arrays import Array
from soro_lab.scene import Scene
from soro_ros.recordings.events import Event
from soro_ros.recordings.recording import RunRecording, TopicSeries, has_stage
from soro_ros.recordings.report import USUAL, WINDOW_S, in_control, tip_error, within
from soro_ros.status_words import STAGES
from soro_ros.view.arm_shape import COLOURS

# Estimates of a law that belong to the matrix W of a learned force.
_WEIGHTS = ("/offset", "/by ")
# Lines in a panel that a legend names.
MOST_NAMES = 12
# Labels this close, as a part of the width, would lie over one another.
_CLOSE = 0.04
_EVENT_COLOURS = {
    "trip": "#b3392f",
    "vent": "#3d6c94",
    "injected": "#7b5ea7",
    "warning": "#e08e2b",
    "over": "#4f8a4c",
    "contact": "#8c564b",
}


@dataclass(frozen=True)
class View:
    """What the panels show.

    Attributes
    ----------
    recording : RunRecording
    scene : Scene or None
        None where it is not known.
    begin_s, end_s : float
        First and last time [s].
    kind : str
        Where `recording.true_tip` comes from: true, measured or estimated.
    """

    recording: RunRecording
    scene: Scene | None
    begin_s: float
    end_s: float
    kind: str

    def shown(self, series: TopicSeries) -> TopicSeries:
        """Return the samples in the time that is shown, broken where messages are missing."""
        if not series.t.size:
            return series
        inside = (series.t >= self.begin_s) & (series.t <= self.end_s)
        return broken(TopicSeries(series.t[inside], series.value[inside], series.names))

    def controlled(self, series: TopicSeries) -> TopicSeries:
        """Return the samples under control: what the law says behind a trip reaches no valve."""
        if not self.recording.wanted_tip.t.size:
            return series
        return series.at_times(in_control(self.recording, series.t, self.end_s))

    @property
    def error(self) -> tuple[Array, Array]:
        """Times (n,) [s] and distances (n,) [m] of the tip from its reference."""
        t, error = tip_error(self.recording, self.end_s)
        inside = t >= self.begin_s
        return t[inside], error[inside]


def broken(series: TopicSeries) -> TopicSeries:
    """Return a series with a NaN in each gap, so that no line is drawn over what was not recorded.

    A gap is many times as long as the samples are usually apart.
    """
    if series.t.size < 3:
        return series
    apart = np.diff(series.t)
    gaps = np.flatnonzero(apart > USUAL * np.median(apart)) + 1
    between = 0.5 * (series.t[gaps - 1] + series.t[gaps])
    value = np.insert(series.value, gaps, np.nan, axis=0)
    return TopicSeries(np.insert(series.t, gaps, between), value, series.names)


class Panel(NamedTuple):
    """One panel: its title, what it needs and whether that was recorded, and the function that draws it."""

    title: str
    topics: str
    known: Callable[[View], bool]
    draw: Callable[[Any, View], None]
    over_time: bool = True


def draw_path(axis: Any, view: View) -> None:
    """Draw the way of tip and reference, seen along the axis of the base."""
    whole, wanted = within(view.recording.true_tip, view.end_s), view.controlled(view.recording.wanted_tip)
    if wanted.t.size:
        axis.plot(*(broken(wanted).value[:, :2] * 1e3).T, color="0.6", lw=3, label="reference")
    true = view.controlled(whole)
    end_s = float(true.t[-1]) if true.t.size else view.end_s
    rest = whole.at_times(whole.t > end_s)
    if rest.t.size > 1:
        axis.plot(*(rest.value[:, :2] * 1e3).T, color="0.6", lw=0.8, ls=":", label="after control")
    axis.plot(*(broken(true).value[:, :2] * 1e3).T, color="C0", lw=0.8, label=f"{view.kind} tip")
    late = true.t >= end_s - WINDOW_S if end_s >= WINDOW_S else np.zeros(true.t.size, dtype=bool)
    if late.any():
        label = f"{view.kind} tip, last {WINDOW_S:g} s"
        axis.plot(*(true.value[late, :2] * 1e3).T, color="C3", lw=1.4, label=label)
    axis.set(xlabel="x [mm]", ylabel="y [mm]")
    axis.set_aspect("equal", adjustable="datalim")  # the way of a planar arm is a line


def draw_tip(axis: Any, view: View) -> None:
    """Draw the coordinates of tip and reference over time."""
    true, wanted = map(view.shown, (view.recording.true_tip, view.controlled(view.recording.wanted_tip)))
    for k, name in enumerate("xyz"):
        if wanted.t.size:
            axis.plot(wanted.t, wanted.value[:, k] * 1e3, color=f"C{k}", lw=2.5, alpha=0.35)
        axis.plot(true.t, true.value[:, k] * 1e3, color=f"C{k}", lw=0.9, label=f"{name}, {view.kind} tip")
    axis.set(ylabel="position [mm]")


def draw_error(axis: Any, view: View) -> None:
    """Draw the distance of the tip from its reference, and of its estimate from it."""
    t, error = view.error
    _line(axis, t, error * 1e3, color="C0", label=f"{view.kind} tip to reference")
    if view.recording.estimated_tip.t.size and view.kind != "estimated":
        off = np.linalg.norm(view.recording.estimated_tip.at(t) - view.recording.true_tip.at(t), axis=1)
        _line(axis, t, off * 1e3, color="C2", label=f"estimated tip to {view.kind} tip")
    axis.set(ylabel="distance [mm]", ylim=(0, None))


def _line(axis: Any, t: Array, value: Array, **style: Any) -> None:
    shown = broken(TopicSeries(t, value[:, None]))
    axis.plot(shown.t, shown.value[:, 0], lw=0.8, **style)


def draw_pressures(axis: Any, view: View) -> None:
    """Draw measured pressures, set points and limits."""
    reading, command = map(view.shown, (view.recording.reading, view.controlled(view.recording.command)))
    names = reading.names or command.names
    for series, measured in ((reading, True), (command, False)):
        for k, name in enumerate(series.names):
            colour = COLOURS[names.index(name) % len(COLOURS)] if name in names else "0.3"
            style = {"lw": 0.9, "label": f"{name} measured"} if measured else {"lw": 1.8, "alpha": 0.35}
            axis.plot(series.t, series.value[:, k] / 1e3, color=colour, **style)
    if view.scene is not None:
        for bound in (view.scene.limits.minimum_pa, view.scene.limits.maximum_pa):
            axis.axhline(bound / 1e3, color="0.3", ls="--", lw=0.8)
    axis.set(ylabel="gauge pressure [kPa]")


def _draw_strains(axis: Any, view: View, words: Sequence[str], label: str, factor: float) -> None:
    estimated, true = view.recording.estimated_state, view.recording.true_state
    chosen = [name for name in estimated.names or true.names if any(word in name for word in words)]
    for series, style in ((true, {"lw": 2.5, "alpha": 0.35}), (estimated, {"lw": 0.9})):
        shown = view.shown(series)
        for k, name in enumerate(chosen):
            if name in shown.names:
                values = shown.value[:, shown.names.index(name)] * factor
                named = {"label": name} if series is estimated or not estimated.t.size else {}
                axis.plot(shown.t, values, color=f"C{k % 10}", **style, **named)
    axis.set(ylabel=label)


def draw_estimates(axis: Any, view: View) -> None:
    """Draw the parameter estimates, each as a part of a value that its legend names."""
    series = view.controlled(view.recording.estimates)
    if not series.t.size:
        return
    weights = [k for k, name in enumerate(series.names) if any(part in name for part in _WEIGHTS)]
    if weights:  # the matrix W of a learned force: too many for a legend
        most = float(np.max(np.abs(series.value[:, weights]))) or 1.0
        force = axis.plot(series.t, series.value[:, weights] / most, color="0.6", lw=0.5)
        force[0].set_label(f"learned force, its {len(weights)} numbers; 1: the largest, {most:.3g}")
    for k, name in enumerate(series.names):
        if k in weights:
            continue
        factor, unit = (1e3, " g") if name.endswith("mass") else (1.0, "")
        values = factor * series.value[:, k]
        largest = float(np.max(np.abs(values)))
        if not largest:
            axis.plot(series.t, values, lw=1.0, label=f"{name}: 0{unit} all the time")
            continue
        # What starts from (almost) nothing, as an unknown load does, is shown against its largest value.
        starts = abs(values[0]) > 0.01 * largest
        scale, what = (abs(values[0]), "start") if starts else (largest, "largest value")
        label = f"{name}: {values[-1]:.3g}{unit} at the end; 1: its {what}, {scale:.3g}{unit}"
        axis.plot(series.t, values / scale, lw=1.0, label=label)
    low = min(0.0, float(axis.dataLim.y0))
    axis.set(ylabel="estimate, part of the value in its legend", ylim=(1.05 * low, None))


def draw_force(axis: Any, view: View) -> None:
    """Draw the force on the arm at its tip: estimated with twice its deviation, true, goal; stages."""
    recording = view.recording
    known = map(view.controlled, (recording.estimated_force, recording.force_doubt))
    estimated, doubt, true, wanted = map(view.shown, (*known, recording.true_force, recording.wanted_force))
    _shade_stages(axis, doubt)
    kinds: list[tuple[str, TopicSeries, dict[str, Any]]] = [
        ("true, of the twin", true, {"lw": 2.5, "alpha": 0.35}),
        ("wanted", wanted, {"lw": 0.9, "ls": "--"}),
        ("estimated", estimated, {"lw": 0.9}),
    ]
    for kind, series, style in kinds:
        if not series.t.size:
            continue
        for k, name in enumerate("xyz"):
            label = f"estimated, {name}" if kind == "estimated" else None
            axis.plot(series.t, 1e3 * series.value[:, k], color=f"C{k}", label=label, **style)
        if kind != "estimated":
            axis.plot([], [], color="0.3", label=kind, **style)
    for k, name in enumerate("xyz"):
        if estimated.t.size and (variance := 2 * name) in doubt.names:
            twice = 2e3 * np.sqrt(np.maximum(doubt.value[:, doubt.names.index(variance)], 0.0))
            middle = 1e3 * estimated.at(doubt.t)[:, k]
            label = None if k else "2 standard deviations of it"
            band = {"color": f"C{k}", "alpha": 0.12, "lw": 0, "label": label}
            axis.fill_between(doubt.t, middle - twice, middle + twice, **band)
    if estimated.t.size:  # what no pose shows, along the backbone, would hide all else
        low, high = np.nanmin(estimated.value), np.nanmax(estimated.value)
        room = 0.25 * (high - low) + 0.01
        axis.set(ylim=(1e3 * (low - room), 1e3 * (high + room)))
    axis.set(ylabel="force on the tip [mN]")


def draw_joint(axis: Any, view: View) -> None:
    """Draw the angle of a hinged body, and the torque of its drive on an axis of its own."""
    series = view.shown(view.recording.joint)
    axis.plot(series.t, np.degrees(series.value[:, 0]), color="C0", lw=1.0, label=f"{series.names[0]}, angle")
    axis.set(ylabel="angle [deg]")
    right = axis.twinx()
    right.plot(series.t, series.value[:, 1], color="C1", lw=1.0)
    axis.plot([], [], color="C1", lw=1.0, label="torque")
    right.set(ylabel="torque [N m]")


def _shade_stages(axis: Any, doubt: TopicSeries) -> None:
    """Shade the times of an outside force and of a contact."""
    for name, alpha in zip(STAGES[1:], (0.1, 0.22), strict=True):
        edges = np.flatnonzero(np.diff(has_stage(doubt, name).astype(int), prepend=0, append=0))
        for k, (begin, end) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
            label = None if k else name
            axis.axvspan(*doubt.t[[begin, end - 1]], color="C5", alpha=alpha, lw=0, zorder=0, label=label)


def is_pushed(view: View) -> bool:
    """Return whether a force is in the run: one that is true, wanted, or of a contact."""
    recording, doubt = view.recording, view.controlled(view.recording.force_doubt)
    return bool(
        recording.wanted_force.t.size or recording.true_force.value.any() or has_stage(doubt, "contact").any()
    )


def mark(axis: Any, events: Sequence[Event], begin_s: float, end_s: float) -> None:
    """Mark events by their numbers: lines at their times; those that are close together share a label.

    Parameters
    ----------
    axis : matplotlib axes
    events : sequence of Event
    begin_s, end_s : float
        Time [s] that the axes show.
    """
    labels: list[tuple[float, str, str]] = []
    for number, event in enumerate(events, 1):
        if not begin_s <= event.t_s <= end_s:
            continue
        colour = _EVENT_COLOURS[event.kind]
        axis.axvline(event.t_s, color=colour, lw=1.0, ls="--", zorder=0.5)
        if labels and event.t_s - labels[-1][0] < _CLOSE * (end_s - begin_s):
            labels[-1] = (labels[-1][0], f"{labels[-1][1]},{number}", colour)
        else:
            labels.append((event.t_s, str(number), colour))
    for t_s, text, colour in labels:
        place = {"ha": "center", "va": "bottom", "transform": axis.get_xaxis_transform()}
        axis.text(t_s, 1.0, text, color=colour, size=8, weight="bold", **place)


def lines_of(events: Sequence[Event], begin_s: float, end_s: float) -> list[str]:
    """Return a line for each event of a time, with the number that marks it.

    Parameters
    ----------
    events : sequence of Event
    begin_s, end_s : float
        The time [s].
    """
    return [
        f"{k}: {event.t_s:.2f} s, {event.node}: {event.text}"
        for k, event in enumerate(events, 1)
        if begin_s <= event.t_s <= end_s
    ]


def _has_strain(view: View, *words: str) -> bool:
    names = (*view.recording.estimated_state.names, *view.recording.true_state.names)
    return any(word in name for name in names for word in words)


PATH = Panel(
    "tip path, seen along the base's axis",
    "truth/tip, sensors/pose0 or arm/tip",
    lambda view: view.recording.true_tip.t.size > 1,
    draw_path,
    over_time=False,
)
ERROR = Panel("tip error", "a tip and arm/desired/tip", lambda view: view.error[0].size > 1, draw_error)
PRESSURES = Panel(
    "pressures (pale: set points; dashed: limits)",
    "chambers/state or chambers/command",
    lambda view: view.recording.reading.t.size + view.recording.command.t.size > 1,
    draw_pressures,
)
TIP = Panel("tip (pale: reference)", "a tip", lambda view: view.recording.true_tip.t.size > 1, draw_tip)
CURVATURES = Panel(
    "curvature, estimated (pale: true)",
    "arm/state or truth/state",
    lambda view: _has_strain(view, "bending", "torsion"),
    lambda axis, view: _draw_strains(axis, view, ("bending", "torsion"), "strain [1/m]", 1.0),
)
STRETCHES = Panel(
    "elongation and shear, estimated (pale: true)",
    "arm/state or truth/state",
    lambda view: _has_strain(view, "elongation", "shear"),
    lambda axis, view: _draw_strains(axis, view, ("elongation", "shear"), "strain [%]", 100.0),
)
ESTIMATES = Panel(
    "what the law has learned",
    "controller/estimates",
    lambda view: view.recording.estimates.t.size > 1,
    draw_estimates,
)
FORCE = Panel(
    "force at the tip, with 2 deviations (pale: true; dashed: goal)",
    "arm/wrench or truth/wrench",
    lambda view: view.recording.estimated_force.t.size + view.recording.true_force.t.size > 1,
    draw_force,
)
JOINT = Panel(
    "joint: angle, and torque of its drive (right)",
    "bodies/NAME/joint",
    lambda view: view.recording.joint.t.size > 1,
    draw_joint,
)
ALL = (PATH, ERROR, PRESSURES, TIP, CURVATURES, STRETCHES, ESTIMATES, FORCE)


def panels_of(view: View) -> tuple[Panel, ...]:
    """Return the panels of a recording: all, and that of a joint where there is one."""
    return (*ALL, JOINT) if view.recording.joint.t.size else ALL
