"""The page of a recorded run, in the order in which a reader asks."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import yaml

from soro_core.jobs.versions import versions
from soro_lab.reporting.drawing import png, style
from soro_lab.reporting.html import Block, Bullets, Cell, Chapter, Folded, Page, Picture, Table, Words
from soro_ros.pictures import panels
from soro_ros.pictures.picture import draw_shadow, fill
from soro_ros.pictures.run_view import OpenRun, title_of
from soro_ros.recordings.recording import Spans
from soro_ros.recordings.report import Summary, rows, summarise
from soro_ros.recordings.verdict import Verdict, judge, with_verdict
from soro_ros.run.end import End

_WIDTH, _HEIGHT = 9.0, 3.4  # of a picture [inches]


def page_of(run: OpenRun, spans: Spans, notes: Sequence[str] = ()) -> Page:
    """Return the page.

    Parameters
    ----------
    run : OpenRun
    spans : Spans
        Of every message of its bag.
    notes : sequence of str
        What is damaged, or not known.
    """
    summary = summarise(run.recording, run.scene) if run.scene is not None else None
    verdict = _verdict(run, summary)
    if summary is not None:
        summary = with_verdict(summary, verdict)
    return Page(
        title_of(run),
        f"Bag: {run.reader.path}. Shown: {run.view.begin_s:g} to {run.view.end_s:.2f} s.",
        str(verdict),
        verdict.word == "good",
        [Bullets(lines)] if (lines := [*verdict.notes, *notes]) else [],
        [
            Chapter("figures", "Figures", [_figures(run, summary)]),
            Chapter("events", "Events", [_events(run)]),
            Chapter("pictures", "Pictures", [*_pictures(run)]),
            Chapter("recorded", "What was recorded", [*_recorded(run, spans)]),
            Chapter("scene", "Scene", [*_scene(run)]),
            Chapter("versions", "Versions", [_versions(run)]),
        ],
    )


def _verdict(run: OpenRun, summary: Summary | None) -> Verdict:
    """Return the verdict that `soro run` wrote, or one of the recording alone."""
    try:
        written = json.loads((run.folder / "summary.json").read_text(encoding="utf-8"))
        notes = tuple(map(str, written.get("notes", ())))  # a run of before has none
        return Verdict(str(written["verdict"]), str(written["reason"]), notes)
    except (OSError, ValueError, KeyError, TypeError):
        pass
    if run.scene is None:
        return Verdict("not judged", "no scene says what was wanted")
    return judge(summary, run.scene, End(), run.recording)


def _figures(run: OpenRun, summary: Summary | None) -> Table:
    judged = None if summary is None or run.scene is None else rows(summary, run.scene)
    return Table(("", ""), _plain_figures(run) if judged is None else judged)


def _plain_figures(run: OpenRun) -> list[tuple[str, str]]:
    """Return what can be said without a scene."""
    view = run.view
    found = [("time", f"{view.end_s - view.begin_s:.2f} s")]
    _, error = view.error
    if error.size:
        rms, most = 1e3 * np.sqrt(np.mean(error**2)), 1e3 * error.max()
        found.append((f"{view.kind} tip to reference, RMS / max", f"{rms:.2f} / {most:.2f} mm"))
    for name, series in (("measured", view.recording.reading), ("set", view.recording.command)):
        if np.isfinite(series.value).any():
            low, high = np.nanmin(series.value) / 1e3, np.nanmax(series.value) / 1e3
            found.append((f"{name} pressures", f"{low:.1f} to {high:.1f} kPa"))
    return found


def _events(run: OpenRun) -> Block:
    events = run.view.recording.events
    if not events:
        return Words("None: no trip, no warning, no injected fault.")
    return Table(
        ("", "#time [s]", "kind", "node", "what it said"),
        [
            (
                str(k),
                Cell(f"{event.t_s:.2f}", is_number=True),
                Cell(event.kind, is_bad=event.kind == "trip"),
                event.node,
                event.text,
            )
            for k, event in enumerate(events, 1)
        ],
    )


def _pictures(run: OpenRun) -> Iterator[Block]:
    import matplotlib as mpl
    from matplotlib.figure import Figure

    for panel in panels.panels_of(run.view):
        if not panel.known(run.view):
            yield Words(f"Not recorded: {panel.topics} ({panel.title}).", kind="soft")
            continue
        with mpl.rc_context(style()):
            height = _HEIGHT if panel.over_time else 4.6
            figure = Figure(figsize=(_WIDTH, height), layout="constrained")
            fill(figure.subplots(), panel, run.view)
            # Pale and full lines of one colour need more of them.
            yield Picture(png(figure, 256), panel.title)
    if run.view.recording.shadow.t.size:
        with mpl.rc_context(style()):
            figure = Figure(figsize=(_WIDTH, 2 * _HEIGHT), layout="constrained")
            draw_shadow(figure.subplots(2, 1), run.view)
            yield Picture(png(figure, 256), "real arm and its shadow")
    if run.view.recording.events:
        yield Words("Dashed lines: events, by their number above.", kind="soft")


def _recorded(run: OpenRun, spans: Spans) -> Iterator[Block]:
    reader = run.reader
    lines = [
        (
            topic.name,
            topic.type,
            Cell(str(count), is_number=True),
            *_rate(count, *spans.of.get(topic.name, (0, 0, 0))),
        )
        for topic, count in zip(reader.topics, reader.counts, strict=True)
    ]
    seconds = (reader.end_ns - reader.start_ns) * 1e-9
    yield Words(
        f"{reader.message_count} messages in {seconds:.2f} s by the clock of the recorder. "
        "Gap: longest time between two messages.",
        kind="soft",
    )
    lost = run.view.recording.diagnostics.get("recorder", {})
    if lost:
        yield Words(f"Lost: {lost.get('lost', '?')}, dropped: {lost.get('dropped', '?')}, by the recorder.")
    yield Table(("topic", "type", "#messages", "#rate [Hz]", "#gap [ms]"), lines)


def _rate(count: int, first_ns: int, last_ns: int, gap_ns: int) -> tuple[Cell, Cell]:
    if last_ns == first_ns:
        return Cell("–", is_number=True), Cell("–", is_number=True)
    rate = (count - 1) / (last_ns - first_ns) * 1e9
    return Cell(f"{rate:.1f}", is_number=True), Cell(f"{gap_ns * 1e-6:.0f}", is_number=True)


def _scene(run: OpenRun) -> Iterator[Block]:
    if run.scene_file is None:
        yield Words("Not beside the bag.")
        return
    yield Words(
        f"{run.scene_file}, every key:" if run.scene is not None else f"{run.scene_file}:", kind="soft"
    )
    text = (
        yaml.safe_dump(run.scene.to_dict(), sort_keys=False)
        if run.scene is not None
        else run.scene_file.read_text(encoding="utf-8", errors="replace")
    )
    yield Folded(text)


def _versions(run: OpenRun) -> Table:
    about: dict[str, Any] = {}
    if (metadata := run.reader.metadata) is not None:
        about = {"ROS": metadata.ros_distro, **metadata.custom_data}
        about["bag format"] = f"rosbag2, version {metadata.version}"
    now = versions()
    return Table(
        ("", "when it was recorded", "when this page was made"),
        [(name, str(about.get(name) or "–"), now.get(name, "–")) for name in dict.fromkeys((*about, *now))],
    )
