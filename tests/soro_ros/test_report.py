"""The report of a run: what it does not know it does not say."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from matplotlib.figure import Figure
from rclpy.serialization import serialize_message

from soro_core.config import find_config, read_yaml, with_changes
from soro_lab.bag import BagReader, BagWriter, Topic
from soro_lab.scene import load_scene
from soro_ros.pictures import panels, picture
from soro_ros.recorder.recorded_topics import recorded_topics
from soro_ros.recordings import recording, report
from soro_ros.recordings.learned import keep_learned
from soro_ros.recordings.recording import EMPTY, RunRecording, TopicSeries
from soro_ros.ticks.control_report import ControlReport

WHOLE = Path(__file__).parents[2] / "bags" / "track_circle_lockstep_2s"


def rows(ends_s: float, diagnostics=None, trips=(), **changes) -> dict[str, str]:
    """The table of a recording that ends at a time, with a tip error of 2 mm."""
    names, values = report.table(*summary_of(ends_s, diagnostics, trips, **changes)).columns
    return dict(zip(names.cells, values.cells, strict=True))


def summary_of(ends_s: float, diagnostics=None, trips=(), **changes):
    scene = load_scene("track_circle", {key.replace("__", "."): value for key, value in changes.items()})
    t = np.arange(0.0, ends_s, 0.005)
    wanted, true = (
        TopicSeries(t, np.zeros((t.size, 3))),
        TopicSeries(t, np.full((t.size, 3), [2e-3, 0.0, 0.0])),
    )
    half = TopicSeries(t, np.full((t.size, 3), [1e-3, 0.0, 0.0]))
    differences = TopicSeries(t, np.tile([3e-3, 3e-3, 0.0, 0.0, 0.02, -0.01], (t.size, 1)))
    recording = RunRecording(true, true, wanted, EMPTY, EMPTY, EMPTY, diagnostics or {}, trips, half)
    if changes.get("arm") == "real":
        recording = replace(recording, shadow=differences)
    return report.summarise(report.of_scene(recording, scene), scene), scene


def recorded(t: np.ndarray, true: TopicSeries, wanted: TopicSeries) -> RunRecording:
    """A run with as many lines in its picture as there can be."""
    chambers = TopicSeries(
        t, np.full((t.size, 12), 40e3), tuple(f"link{n // 3}/chamber{n % 3}" for n in range(12))
    )
    estimates = TopicSeries(t, np.full((t.size, 3), 0.02), ("tip_mass", "stiffness", "damping"))
    differences = TopicSeries(t, np.tile([3e-3, 3e-3, 0.0, 0.0, 0.02, -0.01], (t.size, 1)))
    return RunRecording(true, true, wanted, chambers, chambers, estimates, {}, (), true, differences)


LEARNS = """
from soro_core.control.laws import LawOptions
from soro_core.control.laws.composite import Composite

class Own(Composite):
    Options = LawOptions
"""


@pytest.mark.parametrize("is_kept", [True, False])
def test_only_what_a_run_can_start_from_is_kept(tmp_path, is_kept):
    (tmp_path / "own.py").write_text(LEARNS)
    scene = load_scene(
        "track_circle", {"controller.law": "composite" if is_kept else f"{tmp_path}/own.py:Own"}
    )
    t = np.arange(0.0, 1.0, 0.1)
    series = TopicSeries(t, np.full((t.size, 1), 0.01), ("tip_mass",))
    bag = RunRecording(EMPTY, EMPTY, EMPTY, EMPTY, EMPTY, series, {}, (), deviations=series)
    assert bool(keep_learned(tmp_path, bag, scene)) == is_kept


@pytest.mark.parametrize("ends_s", [20.0, 5.0], ids=["complete", "vented"])
def test_legends_of_the_picture_lie_over_no_data(monkeypatch, tmp_path, ends_s):
    t = np.arange(0.0, ends_s, 0.02)
    tip = TopicSeries(t, 0.02 * np.stack([np.cos(t), np.sin(t), 0 * t], axis=1))
    pages = []
    monkeypatch.setattr("matplotlib.pyplot.close", pages.append)
    scene = with_changes(load_scene("track_circle"), robot="/home/me/arm_robot.yaml")
    picture.draw(recorded(t, tip, tip), scene, tmp_path / "run.png")
    assert pages[0].get_suptitle().startswith("track_circle: arm_robot.yaml, payload 20 g")
    legends = [axis.get_legend() for axis in pages[0].axes]
    assert len(legends) == 6
    for axis, legend in zip(pages[0].axes, legends, strict=True):
        for other in pages[0].axes:
            assert not legend.get_window_extent().overlaps(other.get_window_extent())
        assert axis.get_window_extent().height > 200
        inside = pages[0].bbox
        assert inside.x0 <= legend.get_window_extent().x0 < legend.get_window_extent().x1 <= inside.x1
    names = [text.get_text() for text in legends[0].get_texts()]
    assert ("true tip, last 5 s" in names) == (ends_s == 20.0)


@pytest.mark.parametrize(
    ("highest_pa", "changes"),
    [
        (90e3, {}),
        (60e3, {"limits.maximum_pa": 60e3}),
        (40e3, {"controller.pressures.maximum_pa": 40e3}),
        (50e3, {"platform": "narrow"}),
    ],
)
def test_a_bound_is_the_one_that_the_controller_keeps(tmp_path, highest_pa, changes):
    narrow = {**read_yaml(find_config("emulated_canopen", "platforms")), "range": {"maximum_pa": 50e3}}
    (tmp_path / "narrow.yaml").write_text(yaml.safe_dump(narrow))
    if "platform" in changes:
        changes = {"platform": str(tmp_path / "narrow.yaml")}
    t = np.arange(0.0, 20.0, 0.005)
    tip = TopicSeries(t, np.zeros((t.size, 3)))
    command = TopicSeries(t, np.full((t.size, 3), [highest_pa, 0.5 * highest_pa, 0.0]))
    bag = RunRecording(tip, tip, tip, command, command, EMPTY, {}, ())
    assert report.summarise(bag, load_scene("track_circle", changes)).saturated_part == pytest.approx(2 / 3)


def test_a_chamber_without_a_reading_hides_no_pressure_of_the_others():
    t = np.arange(0.0, 20.0, 0.005)
    tip = TopicSeries(t, np.zeros((t.size, 3)))
    reading = TopicSeries(t, np.full((t.size, 3), [30e3, 10e3, 2e3]))
    reading.value[2000:, 1] = np.nan
    bag = RunRecording(tip, tip, tip, reading, reading, EMPTY, {}, ())
    found = report.summarise(bag, load_scene("track_circle"))
    assert (found.pressure_min_pa, found.pressure_max_pa) == (2e3, 30e3)


def test_the_error_to_the_configured_circle_stands_beside_that_to_another_one():
    t = np.arange(0.0, 20.0, 0.005)
    true, wanted, asked = (TopicSeries(t, np.full((t.size, 3), [x, 0.0, 0.0])) for x in (2e-3, 0.0, -3e-3))
    scene = load_scene("track_circle")
    same = RunRecording(true, true, wanted, EMPTY, EMPTY, EMPTY, {}, ())
    row = "the same to the configured circle, last 5 s"
    for begin_s, error_m in ((4.0, 5e-3), (17.5, np.sqrt(0.5 * (2e-3**2 + 5e-3**2))), (np.inf, np.nan)):
        found = report.summarise(replace(same, configured_tip=asked.at_times(t >= begin_s)), scene)
        assert found.tip_error_last_rms_m == pytest.approx(2e-3)
        kept = found.to_dict()["configured_tip_error_last_rms_m"]
        rows = dict(report.rows(found, scene))
        if np.isnan(error_m):
            assert (kept, row in rows) == (None, False)
        else:
            assert kept == pytest.approx(error_m, rel=1e-3)
            assert rows[row] == f"{1e3 * error_m:.2f} mm"


def test_the_tip_on_the_configured_circle_is_published_recorded_and_read(tmp_path):
    other = np.eye(4)
    other[:3, 3] = 0.01, 0.02, 0.03
    sent, topic = {}, "arm/configured/tip"
    publisher = ControlReport([], "map", sent.__setitem__, lambda name: name.startswith("arm"))
    publisher.publish(SimpleNamespace(tip_reference=np.eye(4), configured_tip=None), None, 5)
    assert list(sent) == ["arm/desired/tip"]
    publisher.publish(SimpleNamespace(tip_reference=np.eye(4), configured_tip=other), None, 5)
    kind = "geometry_msgs/msg/PoseStamped"
    assert f"/track_circle/{topic} {kind}" in recorded_topics(load_scene("track_circle"))
    with BagReader(WHOLE) as reader, BagWriter(tmp_path / "bag") as writer:
        kept = [one for one in reader.topics if one.name != f"/track_circle/{topic}"]
        for one in (*kept, Topic(f"/track_circle/{topic}", kind)):
            writer.add_topic(one)
        for item in reader.messages({one.name for one in kept}):
            writer.write(item.topic, item.data, item.log_time_ns)
            if item.topic == "/track_circle/arm/desired/tip":
                data = bytes(serialize_message(sent[topic]))
                writer.write(f"/track_circle/{topic}", data, item.log_time_ns)
    found = recording.read(tmp_path / "bag", "track_circle")
    assert found.configured_tip.t.size == found.wanted_tip.t.size > 10
    assert found.configured_tip.value[-1] == pytest.approx(other[:3, 3])


FIRST = "tip error RMS, 3 to 8 s"


@pytest.mark.parametrize(
    ("ends_s", "duration_s", "first", "last"),
    [
        (20.0, 20.0, "2.00 mm", "2.00 mm"),
        (8.0, 8.0, "2.00 mm", "2.00 mm"),
        (7.0, 7.0, "-", "2.00 mm"),
        (1.5, 1.5, "-", "2.00 mm"),  # a short run as a whole
        (17.0, 20.0, "2.00 mm", "-"),  # interrupted
        (5.0, 20.0, "-", "-"),
    ],
)
def test_a_window_that_the_run_did_not_fill_is_a_dash(ends_s, duration_s, first, last):
    found = rows(ends_s, duration_s=duration_s)
    assert found[f"{FIRST} (while adapting)"] == first
    span = f"last {min(duration_s, 5.0):g} s"
    assert found[f"tip error RMS, {span}"] == found[f"tip error max, {span}"] == last
    assert found[f"estimator's tip error RMS, {span}"] == ("0.00 mm" if last != "-" else "-")


@pytest.mark.parametrize(
    ("ends_s", "faults", "settling"),
    [
        (20.0, (), "never beyond it"),
        (17.0, (), "- (not run to its end)"),
        (12.0, ("regulator: vented: stuck",), "- (not run to its end)"),
        (20.0, ("regulator: vented: stuck",), "- (not run to its end)"),
    ],
    ids=["complete", "interrupted", "vented", "vented at the end"],
)
def test_what_was_cut_short_has_not_settled(ends_s, faults, settling):
    assert rows(ends_s, trips=faults)["settling to 5% of the length"] == settling


@pytest.mark.parametrize(
    ("kind", "settling_s"), [("vent", 1.0), ("warning", 11.0)], ids=["vented", "messages lost"]
)
def test_after_a_vent_on_request_the_settling_counts_from_the_last_enable(kind, settling_s):
    """The arm is far off for 1 s after each begin of control, at 0 s and at 10 s."""
    t = np.concatenate([np.arange(0.0, 6.0, 0.005), np.arange(10.0, 20.0, 0.005)])
    far = (t < 1.0) | ((t >= 10.0) & (t < 11.0))
    true = TopicSeries(t, np.where(far[:, None], [0.05, 0.0, 0.0], [2e-3, 0.0, 0.0]))
    wanted = TopicSeries(t, np.zeros((t.size, 3)))
    events = (recording.Event(5.5, kind, "regulator", "vented: vent requested"),)
    run = RunRecording(true, true, wanted, EMPTY, EMPTY, EMPTY, {}, (), events=events)
    found = report.summarise(run, load_scene("track_circle", {"duration_s": 20.0}))
    assert found.settling_s == pytest.approx(settling_s, abs=0.011)


def test_faults_of_another_arm_are_not_this_one_s():
    status = [
        DiagnosticStatus(level=DiagnosticStatus.ERROR, name=name, message="vented: stuck")
        for name in ("/other/regulator", "/regulator", "/arm/regulator")
    ]
    found = recording.statuses(DiagnosticArray(status=status), "/arm/")
    assert list(found) == [("regulator", {}, "regulator: vented: stuck")]


def test_without_adaptation_the_report_leaves_it_out():
    found = rows(20.0, controller__adapt=False)
    assert found[FIRST] == "2.00 mm"
    assert found["law"] == "composite, adaptation off"
    assert rows(20.0)["law"] == "composite, adaptation on"
    assert rows(20.0, controller__law="tip_pid")["law"] == "tip_pid"
    assert FIRST in rows(20.0, controller__law="tip_pid")  # nothing adapts meanwhile


def test_injected_faults_and_trips_are_separate_rows():
    leak = {"fault": "leak", "chamber": "link0/chamber0", "rate_1_s": 3.0}
    injected = [{"at": 5.0, **leak}, {"at": 6.5, "fault": "drop"}]
    found = rows(20.0, platform="emulated_canopen", faults=injected)
    told = "leak of link0/chamber0 (rate_1_s 3) at 5 s; drop (p 0.2) at 6.5 s"
    assert (found["injected faults"], found["trips"]) == (told, "none")
    plain = rows(20.0, trips=("regulator: vented: stuck",))
    assert plain["trips"] == "regulator: vented: stuck"
    assert "injected faults" not in plain


def test_a_trip_whose_text_grows_is_one_trip():
    faults = ("regulator: vented: stuck", "estimator: no readings")
    grown = "regulator: vented: stuck; link0/chamber1 still at 150.0 kPa"
    assert recording.with_fault(faults, grown) == ("estimator: no readings", grown)
    assert recording.with_fault((grown,), grown) == recording.with_fault((grown,), faults[0]) == (grown,)
    assert recording.with_fault(faults, "regulator: vented: stuck wide") == (
        *faults,
        "regulator: vented: stuck wide",
    )


def test_files_of_a_robot_and_a_platform_are_titled_without_their_folders():
    scene = load_scene("track_circle")
    placed = with_changes(scene, robot="/home/me/arm/arm_robot.yaml", platform="/home/me/arm/valves.yaml")
    assert report.title_of(scene).startswith("track_circle: tue_three_bellow on emulated_canopen, ")
    assert report.title_of(placed).startswith("track_circle: arm_robot.yaml on valves.yaml, ")


def test_what_was_not_measured_is_a_dash():
    found = rows(20.0)
    assert found["loop lateness p50 / p99"] == found["measured pressures"] == "-"
    known = {"regulator": {"lateness_p50_ms": "0.1", "lateness_p99_ms": "0.5"}}
    assert rows(20.0, known)["loop lateness p50 / p99"] == "0.10 / 0.50 ms"


def test_lockstep_has_no_schedule_to_be_late_for():
    known = {"regulator": {"lateness_p50_ms": "0.1", "overruns": "6682"}}
    assert summary_of(20.0, known)[0].overruns == 6682
    summary, _ = summary_of(20.0, known, mode="lockstep")
    assert (summary.overruns, math.isnan(summary.lateness_p50_ms)) == (0, True)


def test_of_a_real_arm_the_report_has_the_measured_tip_and_its_distance_from_the_shadow():
    found = rows(20.0, valves="real", arm="real", controller__adapt=False)
    assert found["tip error RMS, last 5 s"] == "1.00 mm"
    assert found["tip, measured to shadow, RMS / max"] == "3.00 / 3.00 mm"
    assert found["bending, measured less shadow, mean / RMS"] == "-0.57 / 0.57 deg"
    assert not any("shadow" in name for name in rows(20.0))


def test_the_legend_of_the_estimates_gives_units():
    t = np.linspace(0.0, 1.0, 5)
    values = np.stack([0.02 * t, 0.5 + t, 0.0 * t, -0.1 * t, 0.25 * t], axis=1)
    force = ("link0/bend_x/offset", "link0/bend_x/by link0/bend_x")
    estimates = TopicSeries(t, values, ("tip_mass", "link0/bend_x/damping", "link0/area_slope", *force))
    drawn = replace(recorded(t, EMPTY, EMPTY), estimates=estimates)
    axis = Figure().subplots()
    panels.draw_estimates(axis, panels.View(drawn, None, 0.0, 1.0, "true"))
    assert axis.get_legend_handles_labels()[1] == [
        "learned force, its 2 numbers; 1: the largest, 0.25",
        "tip_mass: 20 g at the end; 1: its largest value, 20 g",
        "link0/bend_x/damping: 1.5 at the end; 1: its start, 0.5",
        "link0/area_slope: 0 all the time",
    ]
    learned = [line.get_ydata() for line in axis.lines if line.get_color() == "0.6"]
    assert np.array(learned) == pytest.approx(np.stack([-0.4 * t, t]))
