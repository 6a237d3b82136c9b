"""The verdict on a run: what is refused before it starts, and what is lost."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from soro_core import load_robot
from soro_core.config import find_config, read_yaml
from soro_lab.scene import check_gains, load_scene
from soro_ros.recordings.events import Event, NodeStatus
from soro_ros.recordings.recording import EMPTY, RunRecording, TopicSeries
from soro_ros.recordings.report import Summary, table
from soro_ros.recordings.verdict import Verdict, advice, judge, with_verdict
from soro_ros.run.end import End
from soro_ros.run.execution import without_alike
from tests.refused import refused, refused_keys
from tests.soro_ros.running import run, summary

GOOD = Summary(20.0, 2e-3, 1e-3, 2e-3, 1e-3, 1.0, 0.0, 9e4, 0.1, 0, 0, 0.1, 0.2, 0, ())
GAINS = {"k_p": [0.4, 1e-6, 1e-6], "k_d": [0.0, 1e-7, 1e-7], "lambda_per_s": [4.0, 4.0, 4.0]}
LEAK = {"at": 5.0, "fault": "leak", "chamber": "link0/chamber0", "rate_1_s": 3.0}


@pytest.mark.parametrize(
    ("figures", "keys", "status", "word", "names"),
    [
        ({}, {}, 0, "good", ()),
        # A tenth of 64 mm.
        ({"tip_error_last_rms_m": 6.5e-3}, {}, 0, "lost", ("6.5 mm", "10%")),
        ({"tip_error_last_rms_m": 6.3e-3}, {}, 0, "poor", ("6.3 mm", "9.8%", "2% (1.3 mm)")),
        ({"tip_error_last_rms_m": 6.5e-3}, {"verdict.tip_error_part": 0.2}, 0, "poor", ("6.5 mm",)),
        # A fiftieth of it.
        ({"tip_error_last_rms_m": 1.3e-3}, {}, 0, "poor", ("1.3 mm", "2.0%", "2%")),
        ({"tip_error_last_rms_m": 1.27e-3}, {}, 0, "good", ()),
        ({"tip_error_last_rms_m": 1.3e-3}, {"verdict.good_part": 0.03}, 0, "good", ()),
        ({"tip_error_last_rms_m": 6.5e-3}, {"verdict.good_part": 0.2}, 0, "lost", ("6.5 mm", "10%")),
        # A circle that the law has changed is good where the arm is near the configured one, too.
        ({"configured_tip_error_last_rms_m": 1.3e-3}, {}, 0, "poor", ("1.3 mm", "2.0%", "configured circle")),
        ({"configured_tip_error_last_rms_m": 1.27e-3}, {}, 0, "good", ()),
        ({"saturated_last_part": 0.21}, {}, 0, "poor", ("21%", "last 5 s", "20%")),
        ({"saturated_last_part": 0.2}, {}, 0, "good", ()),
        ({"saturated_part": 0.51}, {}, 0, "lost", ("51%", "50%")),
        ({"saturated_part": 0.51}, {"verdict.at_bound_part": 0.6}, 0, "good", ()),
        ({"tip_error_last_rms_m": float("nan")}, {}, 0, "lost", ("5 s",)),
        # With injected faults a run is not judged by its figures.
        ({"tip_error_last_rms_m": 0.3}, {"faults": [LEAK]}, 0, "good", ()),
        (
            {"faults": ("regulator: vented: leak",)},
            {"faults": [LEAK]},
            1,
            "vented",
            ("regulator: vented: leak",),
        ),
        ({"tip_error_last_rms_m": float("nan")}, {}, 130, "vented", ("interrupted",)),
    ],
)
def test_a_run_is_judged_by_its_figures(figures, keys, status, word, names):
    verdict = judge(replace(GOOD, **figures), load_scene("track_circle", keys), End(status))
    assert verdict.word == word
    assert all(name in verdict.reason for name in names)
    assert bool(verdict.reason) == bool(names)


@pytest.mark.parametrize("status", [1, 130])
def test_a_run_that_never_began_is_not_called_vented(status):
    verdict = judge(None, load_scene("track_circle"), End(status, "no answer of all nodes", has_begun=False))
    assert str(verdict) == "vented: nothing has moved, the run never began: no answer of all nodes"


def test_a_short_run_is_good_and_its_notes_say_that_it_is_not_judged():
    scene = load_scene("track_circle", {"duration_s": 2.0})
    figures = {"duration_s": 1.995, "tip_error_last_rms_m": 16e-3, "saturated_part": 0.6}
    verdict = judge(replace(GOOD, **figures), scene, End())
    assert (verdict.word, verdict.reason) == ("good", "")
    assert verdict.notes == ("too short to be judged: how well it follows takes 5 s",)


def test_a_run_of_five_seconds_is_no_short_one():
    # The last sample comes a tick before the end.
    figures = replace(GOOD, duration_s=4.995, tip_error_last_rms_m=3e-3)
    assert judge(figures, load_scene("track_circle", {"duration_s": 5.0}), End()).word == "poor"


@pytest.mark.parametrize(
    ("reason", "keys", "key"),
    [
        ("regulator: vented: command lost: last one 102 ms old", {}, "limits.command_age_s"),
        ("twin: vented: readings lost: chamber 0 not fresh for 55 ms", {}, "limits.reading_age_s"),
        ("stale_reading: link0/chamber0 (node 1): no pressure for 50 ms", {}, "stale_s"),
        ("stale_reading: link0/chamber0 (node 1): no pressure for 50 ms", {}, "--set platform="),
        ("regulator: vented: leak", {}, ""),
        ("regulator: vented: command lost", {"mode": "lockstep"}, ""),
        ("regulator: vented: stale_reading", {"faults": [LEAK]}, ""),
    ],
)
def test_a_run_that_lateness_ended_has_an_advice(reason, keys, key):
    said = advice(Verdict("vented", reason), load_scene("track_circle", keys))
    assert key in said
    assert ("mode=lockstep" in said) == bool(key)


@pytest.mark.parametrize("cause", ["stale_reading: link0/chamber0", "implausible: link0/chamber0"])
def test_beside_real_valves_no_limit_is_raised(cause):
    scene = load_scene("track_circle", {"platform": "canopen_socketcan", "valves": "real"})
    said = advice(Verdict("vented", f"regulator: vented: {cause}"), scene)
    assert "soro doctor canopen_socketcan" in said
    assert "allow more" not in said
    assert ("zero and scale" in said) == cause.startswith("implausible")


def test_the_terminal_says_once_why_a_short_run_has_vented():
    scene = load_scene("track_circle")
    why = "regulator: vented: leak"
    nis = (NodeStatus(0.1, "estimator", 1, "NIS 30, expected 6"),)
    short = replace(GOOD, duration_s=1.8, faults=(why,))
    recording = RunRecording(EMPTY, EMPTY, EMPTY, EMPTY, EMPTY, EMPTY, {}, (), said=nis)
    verdict = judge(short, scene, End(1, why), recording)
    assert verdict.notes == ()
    names = set(table(with_verdict(short, verdict), scene, why).columns[0].cells)
    assert {"verdict", "reason", "trips", "set points at a bound"} & names == {"verdict"}
    late = [f"stale_reading: link0/chamber{k}: no pressure for 50 ms" for k in range(3)]
    assert (
        without_alike(f"vented: {'; '.join(late)}; leak: x")
        == f"vented: {late[0]}, and 2 more like it; leak: x"
    )
    assert without_alike("probe: late; state delay_s") == "probe: late; state delay_s"


def test_a_run_without_a_recording_is_not_judged():
    assert str(judge(None, load_scene("track_circle"), End())) == "good: not judged: no tip was recorded"


@pytest.mark.parametrize(("commands_until_s", "word"), [(19.9, "good"), (19.7, "vented")])
def test_a_run_that_its_user_vented_is_judged_by_whether_it_went_on(commands_until_s, word):
    wanted = TopicSeries(np.array([0.0, commands_until_s]), np.zeros((2, 3)))
    events = (Event(3.0, "vent", "regulator", "vented"), Event(7.0, "vent", "regulator", "vented"))
    recording = RunRecording(EMPTY, EMPTY, wanted, EMPTY, EMPTY, EMPTY, {}, (), events=events)
    verdict = judge(GOOD, load_scene("track_circle"), End(), recording)
    reason = "on request at 7.00 s, and not enabled again" if word == "vented" else ""
    assert (verdict.word, verdict.reason) == (word, reason)
    assert verdict.notes == ("vented on request at 3.00 s", "vented on request at 7.00 s")


def test_a_run_without_any_command_of_the_law_is_lost_and_says_why():
    why = "no command: law mine: its force is not finite"
    said = (NodeStatus(0.1, "controller", 1, why),)
    recording = RunRecording(EMPTY, EMPTY, EMPTY, EMPTY, EMPTY, EMPTY, {}, (), said=said)
    for keys in ({}, {"faults": [LEAK]}):
        verdict = judge(None, load_scene("track_circle", keys), End(), recording)
        assert verdict.word == "lost"
        assert f"controller: {why}" in verdict.reason


def gains_of(changes, **keys):
    scene = load_scene("track_circle", {"platform": "", **changes, **keys})
    return check_gains(scene, load_robot(find_config(scene.robot, "robots")), "scene.yaml"), scene


def test_gains_of_another_robot_are_refused(tmp_path):
    other = {"robot": "asu_two_segment"}
    with refused("controller.gains", names=("asu_two_segment",)) as caught:
        gains_of(other, controller="adaptive_three_bellow")
    assert "tue_three_bellow" in caught.value.got
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump({"robot": "asu_two_segment", "gains": GAINS}))
    with refused("controller.gains") as caught:
        gains_of({}, controller=str(file))
    assert "asu_two_segment" in caught.value.got


def test_gains_that_are_stated_or_of_this_robot_are_accepted(tmp_path):
    assert gains_of({})[0] == ""
    assert gains_of({}, controller="adaptive_three_bellow")[0] == ""
    other = {"robot": "asu_two_segment"}
    line = "controller.gains name no robot: taken for those of asu_two_segment"
    said, scene = gains_of(other, **{"controller.gains": {"k_p": [0.4, 1e-6, 1e-6]}})
    assert said == line
    # The scene that a run leaves says whose they are, and can be run again.
    used = tmp_path / "used.yaml"
    used.write_text(yaml.safe_dump(scene.to_dict()))
    again = load_scene(used)
    assert check_gains(again, load_robot(find_config(again.robot, "robots")), "used.yaml") == ""
    # A controller file from before files named their robot.
    old = read_yaml(find_config("adaptive_three_bellow", "controllers"))
    del old["robot"]
    file = tmp_path / "old.yaml"
    file.write_text(yaml.safe_dump(old))
    assert gains_of(other, controller=str(file))[0] == line
    # The same robot in another folder, another one that the gains are known to fit, and automatic ones.
    copy = tmp_path / "tue_three_bellow.yaml"
    copy.write_text(find_config("tue_three_bellow", "robots").read_text())
    assert gains_of({"robot": str(copy)})[0] == ""
    theirs = {"controller": "adaptive_three_bellow"}
    assert gains_of(other, **theirs, **{"controller.robot": "asu_two_segment"})[0] == ""
    assert gains_of(other, **theirs, **{"controller.gains": "auto"})[0] == ""
    assert gains_of(other)[0] == ""
    assert (
        gains_of(
            {"robot": "tue_three_bellow", "controller": "adaptive_three_bellow"},
            **{"controller.adapt": False},
        )[1].controller.adapt
        is False
    )


@pytest.mark.process
def test_a_run_with_the_gains_of_another_robot_does_not_start(domain, tmp_path):
    status, output, folder = run(
        tmp_path, "robot=asu_two_segment", "platform=", "mode=lockstep", "controller=adaptive_three_bellow"
    )
    assert status == 2, output
    assert summary(folder)["verdict"] == "refused"
    assert summary(folder)["reason"] in output
    assert refused_keys(summary(folder)["reason"]) == ["controller.gains"]
    assert not (folder / "log").exists()
    assert not (folder / "bag").exists()


@pytest.mark.process
def test_a_run_whose_reference_is_out_of_reach_does_not_start(domain, tmp_path):
    gains = "controller.gains={k_p: [0.4, 1.0e-6, 1.0e-6]}"
    changes = ("robot=asu_two_segment", "platform=", "mode=lockstep", gains)
    status, output, folder = run(tmp_path, *changes)
    assert status == 2, output
    found = summary(folder)
    assert found["verdict"] == "refused"
    assert refused_keys(found["reason"]) == ["reference.curvature_per_m"]
    assert "Traceback" not in output
