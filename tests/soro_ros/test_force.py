"""The force on the arm as a user sees it: in bags, figures, pictures and events."""

import shutil
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from matplotlib import pyplot
from rclpy.serialization import deserialize_message, serialize_message

from soro_core.adaptation.external_force import ExternalForce
from soro_core.control.config import ReferenceConfig
from soro_core.control.external_references import GivenReferences
from soro_core.control.force.press import Press
from soro_core.model import SoftArm
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.robot import load_robot
from soro_lab.bag import BagReader, BagWriter, Topic
from soro_ros.conversion import force, learning, messages
from soro_ros.nodes.estimator import EstimatorNode
from soro_ros.pictures import panels
from soro_ros.pictures.picture import draw, picture
from soro_ros.pictures.run_view import open_run
from soro_ros.recordings import report
from soro_ros.recordings.evidence import evidence_of
from soro_ros.recordings.recording import EMPTY
from soro_ros.recordings.verdict import judge
from soro_ros.run.end import End
from soro_ros.status_words import STAGES
from soro_ros.ticks.control_report import ControlReport
from tests.soro_ros.direct import active, captured, fire, receive, values

CHAMBERS = ("link0/chamber0", "link0/chamber1", "link0/chamber2")
TICK_NS = 5_000_000
WHOLE = Path(__file__).parents[2] / "bags" / "track_circle_lockstep_2s"
WRENCH, JOINTS = "geometry_msgs/msg/WrenchStamped", "sensor_msgs/msg/JointState"
TYPES = {
    "arm/wrench": WRENCH,
    "truth/wrench": WRENCH,
    "arm/desired/wrench": WRENCH,
    "arm/wrench/covariance": JOINTS,
}
TRUE, ESTIMATED, GOAL = np.array([98e-3, 0.0, 0.0]), np.array([0.1, 0.01, 0.2]), np.array([0.1, 0.0, 0.0])
DEVIATION = np.array([1e-3, 2e-3, 80e-3])
TOUCHES_S, LEAVES_S = 0.5, 1.2


def with_force(target, names):
    """The recorded run with a force, which touches from `TOUCHES_S` to `LEAVES_S`; its tip's axes."""
    axes, start_ns = [], None
    with BagReader(WHOLE) as reader, BagWriter(target / "bag") as writer:
        kept = [t for t in reader.topics if t.name not in {f"/track_circle/{name}" for name in TYPES}]
        for topic in (*kept, *(Topic(f"/track_circle/{name}", TYPES[name]) for name in names)):
            writer.add_topic(topic)
        for item in reader.messages({topic.name for topic in kept}):
            writer.write(item.topic, item.data, item.log_time_ns)
            if item.topic == "/track_circle/arm/desired/tip" and start_ns is None:
                start_ns = messages.to_ns(deserialize_message(item.data, PoseStamped).header.stamp)
            if item.topic != "/track_circle/truth/tip":
                continue
            tip = deserialize_message(item.data, PoseStamped)
            stamp_ns = messages.to_ns(tip.header.stamp)
            t_s = -1.0 if start_ns is None else 1e-9 * (stamp_ns - start_ns)
            touches = TOUCHES_S - 1e-6 < t_s < LEAVES_S - 1e-6
            if 0.0 <= t_s <= 2.0:
                axes.append(messages.transform(tip.pose)[:3, 2])
            pushed = ExternalForce(
                ESTIMATED, np.diag(DEVIATION**2), "contact" if touches else "free", not touches
            )
            made = {
                "arm/wrench": force.wrench(pushed.force_n, stamp_ns, "world"),
                "truth/wrench": force.wrench(TRUE, stamp_ns, "world"),
                "arm/desired/wrench": force.wrench(GOAL, stamp_ns, "world"),
                "arm/wrench/covariance": force.covariance(pushed, stamp_ns),
            }
            for name in names:
                writer.write(f"/track_circle/{name}", bytes(serialize_message(made[name])), item.log_time_ns)
    shutil.copy(WHOLE / "scene.yaml", target / "scene_used.yaml")
    return np.array(axes)


@pytest.fixture(scope="module")
def forced(tmp_path_factory):
    """The axes of the tip, and the run with a force."""
    folder = tmp_path_factory.mktemp("forced")
    return with_force(folder, TYPES), open_run(folder)


@pytest.mark.slow
def test_a_force_in_a_bag_has_figures_events_a_note_and_a_panel(forced):
    axes, run = forced
    summary = report.summarise(run.recording, run.scene)
    assert summary.force_error_last_rms_n == pytest.approx(2e-3)
    away = np.tile(ESTIMATED - TRUE, (len(axes), 1))
    across = away - np.sum(away * axes, axis=1)[:, None] * axes
    rms = np.sqrt(np.mean(np.sum(across**2, axis=1)))
    assert summary.force_estimate_error_last_rms_n == pytest.approx(rms, rel=0.02)
    assert dict(report.rows(summary, run.scene))["force error RMS, last 2 s"] == "2.0 mN"

    size = f"{1e3 * np.linalg.norm(ESTIMATED):.0f} mN"
    found = [(event.kind, event.text) for event in run.recording.events if event.kind == "contact"]
    assert found == [("contact", f"touches something, with {size}"), ("contact", "leaves what it touched")]
    times = [event.t_s for event in run.recording.events if event.kind == "contact"]
    assert times == pytest.approx([TOUCHES_S, LEAVES_S], abs=1e-3)
    verdict = judge(summary, run.scene, End(), run.recording)
    assert "touches" not in " ".join(verdict.notes), "a press touches on purpose"
    by_chance = replace(run.recording, wanted_force=EMPTY)
    verdict = judge(summary, run.scene, End(), by_chance)
    assert f"the arm touches something, with {size} at 0.50 s, for 0.70 s in all" in verdict.notes
    seen = evidence_of(run.recording, run.scene, summary)
    assert (seen.touching, seen.pushed_n) == pytest.approx((0.35, np.linalg.norm(ESTIMATED)), abs=0.01)

    assert panels.FORCE.known(run.view)
    figure = picture((panels.FORCE,), run.view, "title")
    (axis,) = figure.axes
    lines = {line.get_label(): line for line in axis.lines}
    assert lines["estimated, y"].get_ydata() == pytest.approx(10.0)
    drawn = [line for line in axis.lines if len(line.get_ydata())]
    assert {float(line.get_ydata()[0]) for line in drawn if line.get_linestyle() == "--"} >= {100.0}
    legend = {text.get_text() for text in axis.get_legend().get_texts()}
    estimated = {"estimated, x", "estimated, y", "estimated, z", "2 standard deviations of it"}
    assert legend == {*estimated, "true, of the twin", "wanted", "contact"}
    bands = [band.get_datalim(axis.transData) for band in axis.collections]
    assert [(band.y0, band.y1) for band in bands] == [
        pytest.approx((1e3 * (f - 2 * s), 1e3 * (f + 2 * s)))
        for f, s in zip(ESTIMATED, DEVIATION, strict=True)
    ]
    (shade,) = axis.patches
    assert (shade.get_label(), shade.get_x(), shade.get_width()) == (
        "contact",
        pytest.approx(TOUCHES_S, abs=0.01),
        pytest.approx(LEAVES_S - TOUCHES_S, abs=0.01),
    )
    pyplot.close(figure)


@pytest.mark.parametrize(
    ("kept", "shown"),
    [
        ((), False),
        (("true_force",), True),
        (("wanted_force",), True),
        (("force_doubt", "estimated_force"), True),
        (("estimated_force",), False),
    ],
    ids=["nothing", "true", "wanted", "contact", "no contact"],
)
def test_a_force_that_is_in_a_run_is_shown(forced, kept, shown):
    assert panels.is_pushed(replace(forced[1].view, recording=with_forces(forced[1], kept))) == shown


def with_forces(run, kept):
    """The recording of a run with some of its forces alone."""
    forces = "true_force", "wanted_force", "force_doubt", "estimated_force"
    return replace(run.recording, **{name: EMPTY for name in forces if name not in kept})


@pytest.mark.slow
@pytest.mark.parametrize(("kept", "shown"), [("true_force", [panels.FORCE]), ("estimated_force", [])])
def test_the_picture_of_a_run_shows_the_force_that_is_in_it(tmp_path, monkeypatch, forced, kept, shown):
    run = forced[1]
    monkeypatch.setattr(pyplot, "close", lambda figure: None)
    draw(with_forces(run, (kept,)), run.scene, tmp_path / "run.png")
    titles = [axis.get_title() for axis in pyplot.gcf().axes]
    monkeypatch.undo()
    pyplot.close("all")
    always = [panels.PATH, panels.ERROR, panels.PRESSURES, panels.ESTIMATES]
    assert titles == [panel.title for panel in always + shown]


@pytest.mark.slow
def test_what_an_empty_arm_touches_behind_its_run_is_no_event(tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules[__name__], "TOUCHES_S", 1.0)
    monkeypatch.setattr(sys.modules[__name__], "LEAVES_S", 1e9)
    with_force(tmp_path, TYPES)
    whole = open_run(tmp_path).recording
    assert whole.force_doubt.t[-1] > whole.wanted_tip.t[-1]
    touched = [event for event in whole.events if event.kind == "contact"]
    assert [event.text.split(",")[0] for event in touched] == ["touches something"]
    monkeypatch.setattr(sys.modules[__name__], "TOUCHES_S", whole.wanted_tip.t[-1] + 0.005)
    late = tmp_path / "late"
    late.mkdir()
    with_force(late, TYPES)
    assert not [event for event in open_run(late).recording.events if event.kind == "contact"]


def test_a_bag_without_a_force_says_nothing_of_it(tmp_path):
    with_force(tmp_path, ())
    run = open_run(tmp_path)
    summary = report.summarise(run.recording, run.scene)
    assert np.isnan([summary.force_error_last_rms_n, summary.force_estimate_error_last_rms_n]).all()
    assert not [name for name, _ in report.rows(summary, run.scene) if "force" in name]
    assert not panels.FORCE.known(run.view)
    assert not [event for event in run.recording.events if event.kind == "contact"]


def pushed_tip(wrench):
    """Pose of the tip of the finer arm at rest under a wrench of its tip, and the force in the world."""
    arm = SoftArm(load_robot("tue_three_bellow").refine(4))
    pose = arm.pose(equilibrium(arm, np.zeros(3), wrench=wrench), arm.length)
    return pose, pose[:3, :3] @ wrench[3:]


def test_the_estimator_publishes_the_force_its_covariance_and_its_stage(domain):
    pose, true = pushed_tip(np.array([0.0, 0.0, 0.0, 0.08, -0.03, 0.0]))
    place, rng = pose[:3, 3].copy(), np.random.default_rng(1)
    with active(EstimatorNode, "frames.world:=map") as node:
        sent, beside = captured(node, "arm/wrench"), captured(node, "arm/wrench/covariance")
        told = captured(node, "arm/covariance")
        for k in range(1, 400):
            stamp_ns = k * TICK_NS
            if k % 2:
                pose[:3, 3] = place + 1e-5 * rng.standard_normal(3)  # a sensor that repeats itself is refused
                receive(node, "sensors/pose0", messages.pose_stamped(pose, stamp_ns, "map"))
            receive(node, "chambers/state", messages.chambers(CHAMBERS, np.zeros(3), stamp_ns))
        fire(node, 1.0)
        said = values(node)["force"]
        silent_ns = stamp_ns + 10**9
        count = len(sent)
        receive(node, "chambers/state", messages.chambers(CHAMBERS, np.zeros(3), silent_ns))
        assert len(sent) == len(beside) == count, "without poses there is no force"
    last, doubt = sent[-1], dict(zip(beside[-1].name, beside[-1].position, strict=True))
    assert last.header.frame_id == "map"
    stamps = [messages.to_ns(one.header.stamp) for one in sent]
    assert stamps == [messages.to_ns(one.header.stamp) for one in beside]
    assert np.diff(stamps).min() >= 2e7, "each estimate once"
    found = force.force_of(last)
    assert found[:2] == pytest.approx(true[:2], abs=4e-3)
    assert (abs(found - true) <= 3.0 * np.sqrt([doubt["xx"], doubt["yy"], doubt["zz"]])).all()
    external = learning.certainty_of(told[-2], 3).external
    assert external.force_n == pytest.approx(found)
    assert external.covariance[0, 1] == doubt["xy"]
    assert external.stage == STAGES[int(doubt["stage"])]
    assert said.startswith(external.stage)
    assert f"{1e3 * found[0]:.1f}" in said


def test_a_press_tells_the_force_that_ought_to_be_on_the_arm():
    sent, command = {}, SimpleNamespace(tip_reference=np.eye(4), configured_tip=None)
    report = ControlReport([], "map", sent.__setitem__, lambda topic: topic.startswith("arm/desired"))
    report.publish(command, None, 5)
    assert list(sent) == ["arm/desired/tip"]
    press = Press(np.zeros(3), np.array([0.0, -1.0, 0.0]), 0.08, np.zeros(3))
    report.publish(command, press, 5)
    goal = sent["arm/desired/wrench"]
    assert (goal.header.frame_id, messages.to_ns(goal.header.stamp)) == ("map", 5)
    assert force.force_of(goal) == pytest.approx([0.0, 0.08, 0.0])


@pytest.mark.parametrize(
    ("t", "felt", "presses"), [(1.9, True, False), (2.0, False, False), (2.0, True, True)]
)
def test_a_configured_press_begins_at_its_time_once_the_force_is_known(t, felt, presses):
    settings = ReferenceConfig(press_n=(0.0, 0.05, 0.0), press_s=2.0)
    made = []
    arm = SimpleNamespace(
        config=SimpleNamespace(reference=settings),
        press=lambda state, force_n: made.append(force_n) or "press",
    )
    loop = SimpleNamespace(felt=object() if felt else None, press=None, refusal="")
    found = GivenReferences.configured_press(arm, SimpleNamespace(force=loop), t)
    assert (found, made) == (("press", [settings.press_n]) if presses else (None, []))
    under_way = SimpleNamespace(felt=loop.felt, press="the one under way")
    if presses:
        assert GivenReferences.configured_press(arm, SimpleNamespace(force=under_way), t) == under_way.press


def test_a_series_that_is_not_recorded_has_no_columns_at_other_times():
    assert EMPTY.at(np.arange(3.0)).shape == (3, 0)
