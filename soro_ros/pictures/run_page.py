"""The page of a recorded run, in the order in which a reader asks."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from html import escape
from typing import Any

import numpy as np
import yaml

from soro_lab.bag import BagReader
from soro_lab.reporting.drawing import png, style
from soro_lab.reporting.html import PAGE, Cell, bullets, picture, table, words
from soro_ros.host.versions import versions
from soro_ros.pictures import panels
from soro_ros.pictures.picture import draw_shadow, fill
from soro_ros.pictures.run_view import OpenRun, title_of
from soro_ros.recordings.report import Summary, rows, summarise
from soro_ros.recordings.verdict import judge

_CHAPTERS = (
    ("figures", "Figures"),
    ("events", "Events"),
    ("pictures", "Pictures"),
    ("recorded", "What was recorded"),
    ("scene", "Scene"),
    ("versions", "Versions"),
)
_WIDTH, _HEIGHT = 9.0, 3.4  # of a picture [inches]


def page(run: OpenRun, notes: Sequence[str] = ()) -> str:
    """Return the page as HTML.

    Parameters
    ----------
    run : OpenRun
    notes : sequence of str
        What is damaged, or not known.
    """
    summary = summarise(run.bag, run.scene) if run.scene is not None else None
    own = {
        "figures": _figures(run, summary),
        "events": _events(run),
        "pictures": _pictures(run),
        "recorded": _recorded(run),
        "scene": _scene(run),
        "versions": _versions(run),
    }
    parts = [*_begin(run, summary, notes)]
    for key, title in _CHAPTERS:
        parts += [f'<h2 id="{key}">{escape(title)}</h2>', *own[key]]
    return PAGE.substitute(title=escape(title_of(run)), body="\n".join(parts))


def _begin(run: OpenRun, summary: Summary | None, notes: Sequence[str]) -> Iterator[str]:
    yield f"<h1>{escape(title_of(run))}</h1>"
    yield words(f"Bag: {run.bag}. Shown: {run.view.begin_s:g} to {run.view.end_s:.2f} s.", kind="soft")
    word, reason = _verdict(run, summary)
    text = word[:1].upper() + word[1:] + (f": {reason}" if reason else "")
    yield f'<div class="verdict{" good" if word == "good" else ""}">{escape(text)}</div>'
    if notes:
        yield bullets(notes)
    yield "<nav>" + "".join(f'<a href="#{key}">{escape(title)}</a>' for key, title in _CHAPTERS) + "</nav>"


def _verdict(run: OpenRun, summary: Summary | None) -> tuple[str, str]:
    """Return the verdict that `soro run` wrote, or one of the recording alone."""
    try:
        written = json.loads((run.folder / "summary.json").read_text(encoding="utf-8"))
        return str(written["verdict"]), str(written["reason"])
    except (OSError, ValueError, KeyError, TypeError):
        pass
    if run.scene is None:
        return "not judged", "no scene says what was wanted"
    found = judge(summary, run.scene, 0, "")
    return found.word, found.reason


def _figures(run: OpenRun, summary: Summary | None) -> Iterator[str]:
    judged = None if summary is None or run.scene is None else rows(summary, run.scene)
    known = _plain_figures(run) if judged is None else judged
    yield table(("", ""), [(Cell(name), Cell(value)) for name, value in known])


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


def _events(run: OpenRun) -> Iterator[str]:
    events = run.view.recording.events
    if not events:
        yield words("None: no trip, no warning, no injected fault.")
        return
    yield table(
        ("", "#time [s]", "kind", "node", "what it said"),
        [
            (
                Cell(str(k)),
                Cell(f"{event.t_s:.2f}", is_number=True),
                Cell(event.kind, is_bad=event.kind == "trip"),
                Cell(event.node),
                Cell(event.text),
            )
            for k, event in enumerate(events, 1)
        ],
    )


def _pictures(run: OpenRun) -> Iterator[str]:
    import matplotlib as mpl
    from matplotlib.figure import Figure

    for panel in panels.ALL:
        if not panel.known(run.view):
            yield words(f"Not recorded: {panel.topics} ({panel.title}).", kind="soft")
            continue
        with mpl.rc_context(style()):
            height = _HEIGHT if panel.over_time else 4.6
            figure = Figure(figsize=(_WIDTH, height), layout="constrained")
            fill(figure.subplots(), panel, run.view)
            # Pale and full lines of one colour need more of them.
            yield picture(png(figure, 256), panel.title)
    if run.view.recording.shadow.t.size:
        with mpl.rc_context(style()):
            figure = Figure(figsize=(_WIDTH, 2 * _HEIGHT), layout="constrained")
            draw_shadow(figure.subplots(2, 1), run.view)
            yield picture(png(figure, 256), "real arm and its shadow")
    if run.view.recording.events:
        yield words("Dashed lines: events, by their number above.", kind="soft")


def _recorded(run: OpenRun) -> Iterator[str]:
    with BagReader(run.bag) as reader:
        spans: dict[str, tuple[int, int, int]] = {}  # first and last log time, longest gap [ns]
        for item in reader.messages():
            now = item.log_time_ns
            first, last, gap = spans.get(item.topic, (now, now, 0))
            spans[item.topic] = (first, now, max(gap, now - last))
        lines = [
            (
                Cell(topic.name),
                Cell(topic.type),
                Cell(str(count), is_number=True),
                *_rate(count, *spans.get(topic.name, (0, 0, 0))),
            )
            for topic, count in zip(reader.topics, reader.counts, strict=True)
        ]
        total = reader.message_count
        seconds = (reader.end_ns - reader.start_ns) * 1e-9
    yield words(
        f"{total} messages in {seconds:.2f} s by the clock of the recorder, "
        "which in lockstep is not that of the run. Gap: longest time between two messages.",
        kind="soft",
    )
    lost = run.view.recording.diagnostics.get("recorder", {})
    if lost:
        yield words(f"Lost: {lost.get('lost', '?')}, dropped: {lost.get('dropped', '?')}, by the recorder.")
    yield table(("topic", "type", "#messages", "#rate [Hz]", "#gap [ms]"), lines)


def _rate(count: int, first_ns: int, last_ns: int, gap_ns: int) -> tuple[Cell, Cell]:
    if last_ns == first_ns:
        return Cell("–", is_number=True), Cell("–", is_number=True)
    rate = (count - 1) / (last_ns - first_ns) * 1e9
    return Cell(f"{rate:.1f}", is_number=True), Cell(f"{gap_ns * 1e-6:.0f}", is_number=True)


def _scene(run: OpenRun) -> Iterator[str]:
    if run.scene_file is None:
        yield words("Not beside the bag.")
        return
    yield words(
        f"{run.scene_file}, every key:" if run.scene is not None else f"{run.scene_file}:", kind="soft"
    )
    text = (
        yaml.safe_dump(run.scene.to_dict(), sort_keys=False)
        if run.scene is not None
        else run.scene_file.read_text(encoding="utf-8", errors="replace")
    )
    yield f"<details><summary>Show</summary><pre>{escape(text)}</pre></details>"


def _versions(run: OpenRun) -> Iterator[str]:
    with BagReader(run.bag) as reader:
        about: dict[str, Any] = {}
        if reader.metadata is not None:
            about = {"ROS": reader.metadata.ros_distro, **reader.metadata.custom_data}
            about["bag format"] = f"rosbag2, version {reader.metadata.version}"
    now = versions()
    yield table(
        ("", "when it was recorded", "when this page was made"),
        [
            (Cell(name), Cell(str(about.get(name) or "–")), Cell(now.get(name, "–")))
            for name in dict.fromkeys((*about, *now))
        ],
    )
