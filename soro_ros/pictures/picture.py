"""Pictures of a run: panels side by side."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soro_lab.scene import Scene
from soro_ros.conversion.units import shown_in
from soro_ros.pictures import panels
from soro_ros.pictures.panels import MOST_NAMES, Panel, View, mark
from soro_ros.recordings import shadow_report
from soro_ros.recordings.recording import RunRecording
from soro_ros.recordings.report import law_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from soro_ros.recordings.events import Event
    from soro_ros.recordings.selection import FieldSeries

# Distance of a legend from its axes, which leaves room for the numbers and the name of the axis [inches].
_LEGEND_IN = 0.5
# Letters of a name two of which stand beside each other.
_SHORT = 30
# Events that stand below a picture.
_MOST_EVENTS = 8
# Height of a row of their text [in].
_ROW_IN = 0.16
_RUN = (panels.PATH, panels.ERROR, panels.PRESSURES, panels.ESTIMATES)


def draw(recording: RunRecording, scene: Scene, file: Path) -> None:
    """Draw a run: tip and reference, error, pressures, parameter estimates, and a force if there is one.

    Parameters
    ----------
    recording : RunRecording
        Of `soro_ros.recordings.report.read_run`.
    scene : Scene
    file : Path
        File of the picture.
    """
    from matplotlib import pyplot

    ends_s = [float(one.t[-1]) for one in (recording.reading, recording.true_tip) if one.t.size]
    end_s = max(ends_s, default=scene.duration_s)  # behind control, when the arm rests
    view = View(recording, scene, 0.0, end_s, "measured" if scene.arm == "real" else "true")
    what = "real arm" if scene.arm == "real" else f"payload {_payload(scene)}"
    title = f"{scene.name}: {Path(scene.robot).name}, {what}, {law_of(scene)}"
    chosen = (*_RUN, panels.FORCE) if panels.is_pushed(view) else _RUN
    if recording.joint.t.size:
        chosen = (*chosen, panels.JOINT)
    figure = picture(chosen, view, title)
    figure.savefig(file, dpi=110)
    pyplot.close(figure)


def _payload(scene: Scene) -> str:
    """Return the payload, and each later one with its time."""
    changes = scene.twin.payload_changes
    later = zip(changes.payload_kg, changes.at_s, strict=True)
    return ", ".join(
        [f"{scene.twin.payload_kg * 1e3:g} g", *(f"{mass * 1e3:g} g from {t:g} s" for mass, t in later)]
    )


def picture(chosen: Sequence[Panel], view: View, title: str) -> Figure:
    """Return panels in two columns, a last odd one as wide as both, with the events of the run.

    Those of a shadow stand below them.

    Parameters
    ----------
    chosen : sequence of Panel
        At least one.
    view : View
    title : str
    """
    beside = view.recording.shadow.t.size > 0
    columns = min(2, len(chosen))
    rows = -(-len(chosen) // columns) + beside
    figure, axes = _axes(rows, columns, (6 * columns, 5 * rows))
    even = len(chosen) - len(chosen) % columns
    for axis, panel in zip(axes.flat, chosen[:even], strict=False):
        fill(axis, panel, view)
    if even < len(chosen):
        row = even // columns
        for axis in axes[row]:
            axis.remove()
        fill(figure.add_subplot(axes[row, 0].get_gridspec()[row, :]), chosen[-1], view)
    if beside:
        draw_shadow(axes[-1], view)
    figure.suptitle(title)
    _tell(figure, panels.lines_of(view.recording.events, view.begin_s, view.end_s), 75 * columns)
    return figure


def _axes(rows: int, columns: int, size_in: tuple[float, float], **options: bool) -> tuple[Figure, Any]:
    """Return a figure that needs no window, and its axes (rows, columns)."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(
        rows, columns, figsize=size_in, layout="constrained", squeeze=False, **options
    )
    return figure, axes


def _tell(figure: Figure, lines: Sequence[str], width: int) -> None:
    """Write the first lines below a picture, in rows of at most `width` letters."""
    if lines:
        more = [f"and {len(lines) - _MOST_EVENTS} more"] if len(lines) > _MOST_EVENTS else []
        shown = [*lines[:_MOST_EVENTS], *more]
        told = "\n".join(textwrap.fill(line, width, subsequent_indent="    ") for line in shown)
        figure.set_figheight(figure.get_figheight() + _ROW_IN * told.count("\n"))
        figure.supxlabel(told, x=0.01, ha="left", fontsize="small")


def picture_of_fields(
    fields: Sequence[FieldSeries], begin_s: float | None, end_s: float | None, events: Sequence[Event] = ()
) -> Figure:
    """Return chosen fields over time, one above the other: a panel for each unit of each topic.

    Parameters
    ----------
    fields : sequence of FieldSeries
        At least one.
    begin_s, end_s : float or None
        Time [s] that is shown; None for all.
    events : sequence of Event
        What is marked.
    """
    groups: dict[tuple[str, str], list[FieldSeries]] = {}
    for field in fields:
        groups.setdefault((field.topic, field.unit), []).append(field)
    figure, axes = _axes(len(groups), 1, (10, 3.6 * len(groups)), sharex=True)
    for axis, ((topic, unit), members) in zip(axes.flat, groups.items(), strict=True):
        symbol, factor = shown_in(unit) if unit else ("", 1.0)
        for field in members:
            step = "steps-post" if field.holds else "default"
            axis.plot(field.t, factor * field.value, lw=0.9, label=field.path, drawstyle=step)
        many = f" ({len(members)} lines)" if len(members) > MOST_NAMES else ""
        axis.set_title(f"{topic}{many}", pad=14 if events else None)
        axis.set(ylabel=f"[{symbol}]" if symbol else "", xlim=(begin_s, end_s))
        axis.grid(alpha=0.3)
        legend(axis)
    for axis in axes.flat:  # the limits that all of them share are known now
        mark(axis, events, *axis.get_xlim())
    axes[-1, 0].set_xlabel("time [s]")
    _tell(figure, panels.lines_of(events, *axes[-1, 0].get_xlim()), 120)
    return figure


def draw_shadow(axes: Sequence[Any], view: View) -> None:
    """Draw the differences of a real arm from its shadow into two axes."""
    tolerance_m = view.scene.shadow.tolerance_m if view.scene is not None else 0.0
    shadow_report.draw(axes, view.recording.shadow, tolerance_m)
    for axis in axes:
        style(axis, view)


def fill(axis: Any, panel: Panel, view: View) -> None:
    """Draw a panel into axes, with title, events and a legend below, where it lies over no data.

    Parameters
    ----------
    axis : matplotlib axes
    panel : Panel
    view : View
    """
    panel.draw(axis, view)
    axis.set_title(panel.title, pad=14 if panel.over_time and view.recording.events else None)
    if panel.over_time:
        style(axis, view)
    else:
        axis.grid(alpha=0.3)
        legend(axis)


def style(axis: Any, view: View) -> None:
    """Give axes over time their limits, grid, events and legend."""
    axis.set_xlabel("time [s]")
    axis.set_xlim(view.begin_s, view.end_s)
    axis.grid(alpha=0.3)
    mark(axis, view.recording.events, view.begin_s, view.end_s)
    legend(axis)


def legend(axis: Any) -> None:
    """Name the lines of axes below them, unless they are too many."""
    handles, names = axis.get_legend_handles_labels()
    if 0 < len(names) <= MOST_NAMES:
        from matplotlib.transforms import ScaledTranslation

        below = axis.transAxes + ScaledTranslation(0.0, -_LEGEND_IN, axis.figure.dpi_scale_trans)
        columns = 2 if max(map(len, names)) <= _SHORT else 1
        place = {
            "loc": "upper center",
            "bbox_to_anchor": (0.5, 0.0),
            "bbox_transform": below,
            "ncols": columns,
            "fontsize": "small",
        }
        axis.legend(handles, names, **place)
