"""`soro plot` and `soro report`: on whole recordings, on parts of them, and on what cannot be read."""

import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from matplotlib import pyplot
from PIL import Image
from rclpy.serialization import serialize_message
from rich.console import Console
from typer.testing import CliRunner

from soro_lab.bag import BagReader, BagWriter, Topic
from soro_lab.scene import load_scene
from soro_ros.cli import application
from soro_ros.commands import run
from soro_ros.conversion import messages
from soro_ros.pictures import panels
from soro_ros.pictures.picture import _axes, _tell, picture
from soro_ros.pictures.run_view import open_run
from soro_ros.recordings.events import Event, Said, clock, events_of, under_control
from soro_ros.recordings.recording import RunRecording, TopicSeries
from soro_ros.recordings.selection import fields_of
from soro_ros.run.end import End

BAGS = Path(__file__).parents[2] / "bags"
WHOLE = BAGS / "track_circle_lockstep_2s"
DIAGNOSTICS = Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
LATCH = Topic("/track_circle/chambers/latch", "diagnostic_msgs/msg/DiagnosticStatus")
APP = application()


def soro(*arguments):
    return CliRunner().invoke(APP, [str(one) for one in arguments])


def refused(*arguments):
    """The one line of a command that ends with 2."""
    result = soro(*arguments)
    assert result.exit_code == 2, result.output
    (line,) = result.output.splitlines()
    assert line.startswith("soro: ")
    return line


def copied(target, wanted=None, rename=None, extra=(), **options):
    """Write a bag of some topics of the whole recording, under other names, with more messages."""
    with BagReader(WHOLE) as reader, BagWriter(target, **options) as writer:
        rename = rename or (lambda name: name)
        topics = [t for t in reader.topics if wanted is None or t.name.endswith(tuple(wanted))]
        for topic in topics:
            writer.add_topic(
                Topic(rename(topic.name), topic.type, topic.definition, topic.definition_encoding)
            )
        for topic in (DIAGNOSTICS, LATCH):
            if topic.name in {name for _, name, _ in extra} - {t.name for t in topics}:
                writer.add_topic(topic)
        items = [(i.log_time_ns, rename(i.topic), i.data) for i in reader.messages({t.name for t in topics})]
        for log_ns, name, data in sorted([*items, *extra], key=lambda item: item[0]):
            writer.write(name, data, log_ns)
    return target


def status(log_ns, node, level, text, **values):
    """A message on /diagnostics, with a stamp of the wall clock."""
    one = DiagnosticStatus(level=level, name=f"/track_circle/{node}", message=text)
    one.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    array = DiagnosticArray(status=[one])
    array.header.stamp = messages.to_time(log_ns)
    return log_ns, "/diagnostics", bytes(serialize_message(array))


def log_of(topic, number):
    """Log time [ns] and stamp [ns] of a message of the whole recording."""
    with BagReader(WHOLE) as reader:
        items = list(reader.messages([f"/track_circle/{topic}"]))
    return items[number].log_time_ns


@pytest.fixture
def tripped(tmp_path):
    """A recording whose regulator trips at its reading 301, which is at 1.505 s of simulated time."""
    ok, error = DiagnosticStatus.OK, DiagnosticStatus.ERROR
    at = log_of("chambers/state", 300)
    extra = [
        status(at - 10, "regulator", ok, "active"),
        status(at, "regulator", error, "vented: no command for 0.1 s <b>"),
        status(at + 10**6, "regulator", error, "vented: no command for 0.2 s <b>"),
    ]
    bag = copied(tmp_path / "run" / "bag", extra=extra)
    shutil.copy(WHOLE / "scene.yaml", tmp_path / "run" / "scene_used.yaml")
    return bag.parent


def test_a_whole_recording_has_every_panel(tmp_path):
    result = soro("plot", WHOLE, "--out", tmp_path / "all.png")
    assert result.exit_code == 0, result.output
    assert result.output.splitlines() == [str(tmp_path / "all.png")]
    with Image.open(tmp_path / "all.png") as image:
        assert image.size == (1320, 2200)
    run = open_run(WHOLE)
    assert all(panel.known(run.view) for panel in panels.ALL)
    figure = picture(panels.ALL, run.view, "title")
    pressures = figure.axes[panels.ALL.index(panels.PRESSURES)]
    measured = {line.get_label(): line for line in pressures.lines}
    expected = run.view.recording.reading
    expected = run.view.shown(expected)
    assert measured["link0/chamber1 measured"].get_ydata() == pytest.approx(expected.value[:, 1] / 1e3)
    pyplot.close(figure)


def test_what_is_missing_is_named_and_parts_are_one_run(tmp_path):
    bag = copied(tmp_path / "bag", ["chambers/state"], split_bytes=1_100_000, split_ns=2 * 10**8)
    assert len(list(bag.glob("*.mcap"))) > 1
    result = soro("plot", bag)
    assert result.exit_code == 0, result.output
    assert (bag / "plot.png").exists()
    for words in ("no scene", "arm/desired/tip", "arm/state", "controller/estimates"):
        assert words in result.output
    view = open_run(bag).view
    assert view.recording.reading.t.size == 839
    assert view.begin_s == 0.0
    assert view.end_s == pytest.approx(4.19, abs=0.02)  # until the arm rests with empty chambers


def test_a_trip_is_marked_at_its_time_in_simulated_time(tripped):
    view = open_run(tripped).view
    reading = view.recording.reading
    (trip,) = [event for event in view.recording.events if event.kind == "trip"]
    # the recorder noted the topics of this tick some milliseconds apart
    assert trip.t_s == pytest.approx(reading.t[300], abs=0.02)
    assert trip.node == "regulator"
    figure = picture((panels.PRESSURES,), view, "title")
    marks = [line for line in figure.axes[0].lines if set(line.get_xdata()) == {trip.t_s}]
    assert len(marks) == 1
    assert "vented: no command for 0.1 s" in figure.get_supxlabel()
    pyplot.close(figure)


@pytest.mark.parametrize("columns", [1, 2])
def test_a_long_event_is_told_whole_below_the_picture(columns):
    said = "estimator: " + ", ".join(f"link{k}/pose: NIS 5.0, allowed 3.9" for k in range(12))
    figure, _ = _axes(1, columns, (6 * columns, 5))
    _tell(figure, [said] * 10, 75 * columns)
    figure.draw_without_rendering()
    assert " ".join(figure.get_supxlabel().split()) == " ".join([said] * 8 + ["and 2 more"])
    box = figure._supxlabel.get_window_extent()
    assert box.x1 < figure.bbox.x1
    assert figure.bbox.y0 <= box.y0 < box.y1 < min(axis.bbox.y0 for axis in figure.axes)


def test_no_line_is_drawn_over_a_gap():
    t = np.delete(np.arange(0.0, 2.0, 0.005), np.s_[100:200])
    shown = panels.broken(TopicSeries(t, np.column_stack([t, -t])))
    (gap,) = np.flatnonzero(np.isnan(shown.value[:, 0]))
    assert shown.t[gap - 1 : gap + 2] == pytest.approx([0.495, 0.7475, 1.0])
    assert np.delete(shown.value, gap, axis=0) == pytest.approx(np.column_stack([t, -t]))
    assert panels.broken(TopicSeries(t[:100], t[:100, None])).t == pytest.approx(t[:100])


@pytest.mark.parametrize(
    ("said", "kinds"),
    [
        ([(1, 0, "active"), (2, 2, "vented: x"), (3, 0, "active")], ["trip", "over"]),
        ([(1, 1, "late 5 ms"), (2, 1, "late 7 ms"), (3, 0, "active")], ["warning"]),
        ([(1, 2, "vented: x"), (2, 2, "vented: y")], ["trip", "trip"]),
        ([(1, 2, "vented: vent requested"), (2, 0, "active")], ["vent", "over"]),
        ([(1, 2, "vented: vent requested; link0/chamber0 still at 40.0 kPa")], ["trip"]),
        ([(1, 0, "starting"), (2, 0, "active")], []),
    ],
)
def test_changes_are_events(said, kinds):
    found = events_of(
        (Said(at * 10**9, "node", level, text) for at, level, text in said), lambda at: at / 1e9
    )
    assert [event.kind for event in found] == kinds


def test_a_latch_and_its_opening_are_events(tmp_path):
    at = log_of("chambers/state", 300)
    closed = DiagnosticStatus(level=DiagnosticStatus.ERROR, message="vented: x")
    opened = DiagnosticStatus(level=DiagnosticStatus.OK, message="open")
    extra = [(at, LATCH.name, bytes(serialize_message(closed)))]
    extra += [(at + 10**8, LATCH.name, bytes(serialize_message(opened)))]
    bag = copied(tmp_path / "bag", ["chambers/state"], extra=extra)
    found = open_run(bag).view.recording.events
    assert [(event.kind, event.node, event.text) for event in found] == [
        ("trip", "latch", "vented: x"),
        ("over", "latch", "open"),
    ]


def test_a_latch_is_drawn_in_steps_to_the_end_and_pressure_in_kpa(tmp_path, monkeypatch):
    at = log_of("chambers/state", 300)
    status = DiagnosticStatus(level=DiagnosticStatus.ERROR, message="vented: x")
    status.values = [KeyValue(key="latched", value="true"), KeyValue(key="cause", value="x")]
    bag = copied(
        tmp_path / "bag",
        ["chambers/state", "arm/desired/tip"],
        extra=[(at, LATCH.name, bytes(serialize_message(status)))],
    )
    reading, figures = open_run(bag).view.recording.reading, []
    monkeypatch.setattr(pyplot, "close", figures.append)
    result = soro("plot", bag, "-t", "*/chambers/*", "--out", tmp_path / "all.png")
    monkeypatch.undo()
    assert result.exit_code == 0, result.output
    latch, pressure = sorted(figures[0].axes, key=lambda axis: len(axis.lines[0].get_xdata()))
    level, latched = latch.lines[:2]
    assert [line.get_label() for line in latch.lines[:2]] == ["level", "latched"]
    assert (level.get_drawstyle(), list(latched.get_ydata())) == ("steps-post", [1.0, 1.0])
    assert latched.get_xdata() == pytest.approx([reading.t[300], reading.t[-1]], abs=0.02)
    assert pressure.get_ylabel() == "[kPa]"
    assert pressure.lines[0].get_ydata() == pytest.approx(reading.value[:, 0] / 1e3)
    pyplot.close(figures[0])


def test_what_the_law_says_behind_a_trip_and_warnings_that_follow_are_not_shown():
    t = np.arange(0.0, 2.0, 0.01)
    series = TopicSeries(t, np.ones((t.size, 3)), ("a", "b", "c"))
    events = (
        Event(0.5, "warning", "estimator", "late"),
        Event(1.0, "trip", "latch", "vented: x"),
        Event(1.5, "warning", "estimator", "late"),
    )
    recording = RunRecording(series, series, series, series, series, series, {}, (), events=events)
    view = panels.View(recording, None, 0.0, 2.0, "true")
    assert view.controlled(series).t[-1] == pytest.approx(1.0)
    assert view.error[0][-1] == pytest.approx(1.0)
    assert under_control(events, 2.0) == events[:2]
    assert under_control(events[:1], 0.4) == ()


def test_the_same_words_of_latch_and_diagnostics_are_one_event():
    said = [Said(10**9, "latch", 2, "vented: x"), Said(10**9 + 5, "regulator", 2, "vented: x")]
    assert len(events_of(said, lambda at: at / 1e9)) == 1


def test_log_times_become_times_of_the_run():
    epoch = 1_795_000_000 * 10**9  # at half the speed of the wall, recorded out of order
    time_of = clock([epoch + 4 * 10**9, epoch, epoch + 2 * 10**9], [3 * 10**9, 10**9, 2 * 10**9], 10**9)
    times = [time_of(epoch + round(at * 1e9)) for at in (-1.0, 0.0, 1.0, 3.0, 5.0)]
    assert times == pytest.approx([-1.0, 0.0, 0.5, 1.5, 3.0], abs=1e-9)


def test_any_number_of_any_topic(tmp_path):
    said = []
    found = fields_of(
        WHOLE, ["*/chambers/state", "/diagnostics"], ["effort.*0", "*regulator.frames_sent"], said.append
    )
    assert [(f.topic, f.path) for f in found] == [
        ("/diagnostics", "/track_circle/regulator.frames_sent"),
        ("/track_circle/chambers/state", "effort.link0/chamber0"),
    ]
    reading = open_run(WHOLE).view.recording.reading
    assert found[1].t == pytest.approx(reading.t)
    assert found[1].value == pytest.approx(reading.value[:, 0])
    assert found[1].unit == "pa"
    inside = found[0].t[(found[0].value > 0)]
    assert inside.size
    assert np.all(inside < 30)
    result = soro(
        "plot", WHOLE, "-t", "*/arm/tip", "-f", "pose.pose.position.?", "--out", tmp_path / "tip.svg"
    )
    assert result.exit_code == 0, result.output
    assert "pose.pose.position.z" not in result.output
    assert (tmp_path / "tip.svg").stat().st_size > 10_000


def test_chosen_fields_show_the_trip_too(tripped, monkeypatch):
    figures = []
    monkeypatch.setattr(pyplot, "close", figures.append)
    result = soro("plot", tripped, "-t", "*/chambers/state", "-f", "effort.*0", "--out", tripped / "one.png")
    monkeypatch.undo()
    assert result.exit_code == 0, result.output
    (figure,) = figures
    (trip,) = [event for event in open_run(tripped).view.recording.events if event.kind == "trip"]
    assert [line for line in figure.axes[0].lines if set(line.get_xdata()) == {trip.t_s}]
    assert "vented: no command for 0.1 s" in figure.get_supxlabel()
    pyplot.close(figure)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["-t", "/nothing"], "no topic '/nothing'"),
        (["-t", "*/chambers/state", "-f", "position.*"], "effort.link0/chamber0"),
        (["-f", "*"], "at most 400"),
        (["--out", "plot.gif"], ".png"),
        (["--out", "layout.xml"], ".png, .svg, .pdf"),
        (["--start", "5"], "--start: got 5.0"),
        (["--start", "1", "--end", "0.5"], "--end: got 0.5"),
        (["--out", "/no/such/folder/x.png"], "a folder that exists"),
        (["-t", "*/chambers/command", "-t", "*/arm/*", "-f", "nothing"], " more"),
        (["--arm", "left"], "track_circle"),
    ],
)
def test_wrong_use_is_one_line(options, words):
    assert words in refused("plot", WHOLE, *options)


def test_several_arms_are_named_and_chosen(tmp_path):
    bag = copied(
        tmp_path / "bag", ["chambers/state"], rename=lambda name: name.replace("track_circle", "left")
    )
    with BagReader(bag) as reader:
        items = [(item.log_time_ns, item.data) for item in reader.messages()]
        topic = reader.topics[0]
    both = tmp_path / "both"
    with BagWriter(both) as writer:
        for name in ("left", "right"):
            writer.add_topic(Topic(f"/{name}/chambers/state", topic.type, topic.definition))
            for log_ns, data in items[:50]:
                writer.write(f"/{name}/chambers/state", data, log_ns)
    assert "left, right" in refused("plot", both)
    assert soro("plot", both, "--arm", "right", "--out", tmp_path / "right.png").exit_code == 0


@pytest.mark.parametrize("command", ["plot", "report"])
def test_what_cannot_be_read_is_one_line(tmp_path, command):
    assert "no such file" in refused(command, tmp_path / "nothing")
    empty = tmp_path / "empty"
    empty.mkdir()
    assert "not a bag" in refused(command, empty)
    garbage = tmp_path / "garbage.mcap"
    garbage.write_bytes(bytes(range(256)) * 40)
    assert "garbage.mcap" in refused(command, garbage)
    with BagReader(WHOLE) as reader:
        topic = reader.topic("/track_circle/chambers/state")
    short = tmp_path / "short"
    with BagWriter(short) as writer:
        writer.add_topic(topic)
        writer.write(topic.name, b"\x00\x01\x00\x00\x05", 1)
    assert "/track_circle/chambers/state" in refused(command, short)


class Page(HTMLParser):
    """Addresses and table cells of a page."""

    def __init__(self, text):
        super().__init__()
        self.addresses, self.cells, self.tags = [], [[]], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.addresses += [value for name, value in attributes if name in ("src", "href")]
        if tag == "tr":
            self.cells.append([])
        if tag == "td":
            self.cells[-1].append("")

    def handle_data(self, data):
        if self.cells[-1]:
            self.cells[-1][-1] += data.strip()


@pytest.mark.slow
def test_the_page_of_a_run_stands_alone(tripped):
    note = "estimator: pose: NIS 5.0"
    verdict = {"verdict": "vented", "reason": "regulator: vented: no command", "notes": [note]}
    (tripped / "summary.json").write_text(json.dumps(verdict))
    result = soro("report", tripped)
    assert result.exit_code == 0, result.output
    text = (tripped / "report.html").read_text()
    page = Page(text)
    assert all(address.startswith(("data:image/png;base64,", "#")) for address in page.addresses)
    assert not re.search(r"https?://|@import|url\(", text)
    assert text.count("<img ") == len(panels.ALL)
    assert "Vented: regulator: vented: no command" in text
    events = [row for row in page.cells if "trip" in row]
    assert [row[-1] for row in events] == ["vented: no command for 0.1 s <b>"]
    assert "b" not in page.tags
    with BagReader(tripped / "bag") as reader:
        for topic, count in zip(reader.topics, reader.counts, strict=True):
            (row,) = [row for row in page.cells if row[:1] == [topic.name]]
            assert row[1:3] == [topic.type, str(count)]
    rows = {row[0]: row[1:] for row in page.cells if row}
    assert rows["measured pressures"][0].endswith("kPa")
    assert [rows[name][0] for name in ("verdict", "reason", "notes")] == ["vented", verdict["reason"], note]
    assert f"<li>{note}</li>" in text
    assert "controller:" in text
    assert rows["numpy"][1] == np.__version__


@pytest.fixture
def readings(monkeypatch):
    """Every opening of a bag, and every pass through its messages."""
    found = []
    opened, passed = BagReader.__init__, BagReader.messages
    monkeypatch.setattr(BagReader, "__init__", lambda *given: (found.append("opened"), opened(*given))[1])
    monkeypatch.setattr(BagReader, "messages", lambda *given: (found.append("passed"), passed(*given))[1])
    return found


@pytest.mark.slow
def test_a_page_reads_its_bag_once(tmp_path, readings):
    result = soro("report", WHOLE, "--out", tmp_path / "page.html")
    assert result.exit_code == 0, result.output
    assert readings == ["opened", "passed"]


def test_the_end_of_a_run_reads_its_bag_once(tmp_path, readings):
    shutil.copytree(WHOLE, tmp_path / "bag")
    scene = load_scene(WHOLE / "scene.yaml")
    run._report(scene, tmp_path, End(0, ""), True, Console(quiet=True))
    assert readings == ["opened", "passed"]
    assert (tmp_path / "run.png").exists()


def test_a_page_without_a_scene_says_so(tmp_path):
    bag = copied(tmp_path / "bag", ["chambers/state", "arm/tip"])
    result = soro("report", bag, "--out", tmp_path / "page.html")
    assert result.exit_code == 0, result.output
    text = (tmp_path / "page.html").read_text()
    assert "Not judged" in text
    assert "Not recorded: arm/state or truth/state" in text
    assert "measured pressures" in text


def test_a_damaged_bag_is_drawn_as_far_as_it_goes(tmp_path):
    bag = copied(tmp_path / "bag", ["chambers/state", "arm/state"])
    (file,) = bag.glob("*.mcap")
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 2 + 100])
    result = soro("plot", bag)
    assert "damaged" in result.output or result.exit_code == 2
    assert result.exit_code in (0, 2)
    assert "Traceback" not in result.output
