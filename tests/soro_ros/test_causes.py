"""The probable cause of a bad run: each row of the table, and what recordings show of it."""

import io
import json
import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from rich.console import Console

from soro_lab.scene import load_scene
from soro_ros.commands import run
from soro_ros.recordings import report
from soro_ros.recordings.causes import CAUSES, Answers, Bound, Evidence, end_of_commands, probable_cause
from soro_ros.recordings.events import Event, NodeStatus
from soro_ros.recordings.evidence import evidence_of
from soro_ros.recordings.recording import EMPTY, RunRecording, TopicSeries
from soro_ros.recordings.verdict import judge
from soro_ros.run.end import End

POOR = Evidence(error=0.05, good=0.02)
SWAPPED = Answers("chambers are swapped: b acts as a", "swap the tubes", grave=True)
WEAK = Answers("link0/chamber0 gives 0.82 of the force that the others give", "look at this chamber")
LIMIT = Bound("limits.maximum_pa, 90 kPa,", "state another one")
LATE = "probe: pose@0.1: poses are stamped 40 ms late (+-2)"
# What each row of the table finds in, and words of its cause and of its next step.
ROWS = [
    (
        {"answers": SWAPPED, "controller": "link0/chamber2 gives 0.58 of the force"},
        "swapped",
        "swap the tubes",
    ),
    ({"controller": "link0/chamber2 gives 0.58 of the force that its file says"}, "gives 0.58", "bellow"),
    ({"controller": "the arm has fallen over: vented"}, "fallen over", "soro reach"),
    ({"controller": "no command: an elongation is near -1"}, "elongation", "least_elongation"),
    ({"estimator": "no estimate: no good sample for 0.3 s"}, "no good sample", "sensors publish"),
    ({"controller": "no command: arm/state is of no arm"}, "no arm", "soro log"),
    ({"late": 0.03}, "3% of the cycles", "lockstep"),
    ({"error": math.nan}, "its sensor, or the recording", "soro bag info"),
    ({"pressure_off": "the pressure of link0/chamber1 is 5.0 kPa below"}, "chamber1", "valve, supply"),
    ({"at_bound": 0.3, "held": 0.6, "bound": LIMIT}, "limits.maximum_pa, 90 kPa,", "state another one"),
    (
        {"controller": "pressure saturated: link0/chamber1 needs 8 kPa", "held": 0.6, "at_bound": 0.1},
        "needs 8 kPa",
        "soro reach",
    ),
    (
        {"controller": "limit cycle at 3.2 Hz: feedback lowered to 0.5 times its gains", "swing_hz": 3.2},
        "limit cycle at 3.2 Hz",
        "probe_at_enable",
    ),
    ({"swing_hz": 2.34, "at_bound": 0.3}, "swings about its reference at 2.3 Hz", "controller.gains"),
    ({"answers": WEAK, "at_bound": 0.21, "bound": LIMIT}, "limits.maximum_pa, 90 kPa,", "state another one"),
    (
        {"controller": "pressure saturated: link0/chamber0 needs 9 kPa more than its limit"},
        "needs 9 kPa",
        "soro reach",
    ),
    ({"at_slew": 0.25}, "25% of the changes", "slower reference"),
    ({"estimator_error": 0.026}, "2.6% of the length", "place-sensors"),
    ({"good_at_s": 31.0}, "still falling", "duration_s=31"),
    ({"learns": False}, "adapt is false", "adapt=true"),
    (
        {"touching": 0.3, "pushed_n": 0.12, "free": 0.6},
        "touches something, with up to 0.120 N (30% of the time)",
        "docs/force.md",
    ),
    ({"controller": "the learned mass at the tip is at its bound, -10.2 g"}, "at its bound", "soro identify"),
    ({"free": 0.6, "estimator": "NIS 9"}, "on a part of its way", "obstacle"),
    ({"answers": WEAK, "estimator": "NIS 9", "controller": LATE}, "gives 0.82", "look at"),
    ({"estimator": "NIS 9", "controller": LATE}, "controller: probe: pose@0.1: poses are stamped", "clock"),
    ({"estimator": "pose@0.1: NIS 9.0, allowed 3.9: check its noise"}, "NIS 9.0", "soro identify"),
    ({}, "differs from its robot file", "soro hil first-pressure); then soro excite"),
]


@pytest.mark.parametrize(("seen", "cause", "step"), ROWS, ids=[row[1] for row in ROWS])
def test_each_row_is_found_with_its_next_step(seen, cause, step):
    text, does = probable_cause(replace(POOR, **seen))
    assert cause in text
    assert step in does


def test_every_row_is_tested():
    assert len(ROWS) == len(CAUSES)


def both(first, second):
    """Return what two rows show together; None if one key cannot have both values."""
    shared = first.keys() & second.keys()
    if any(not isinstance(first[key], str) and first[key] != second[key] for key in shared):
        return None
    texts = {key: f"{second[key]}; {first[key]}" for key in shared if isinstance(first[key], str)}
    return {**first, **second, **texts}


@pytest.mark.parametrize(("earlier", "later"), list(combinations(range(len(ROWS)), 2)))
def test_of_two_causes_the_one_with_more_evidence_is_named(earlier, later):
    """The order of ROWS is that which the page states."""
    seen = both(ROWS[earlier][0], ROWS[later][0])
    if seen is None:
        pytest.skip("one run cannot show both")
    text, does = probable_cause(replace(POOR, **seen))
    assert ROWS[earlier][1] in text
    assert ROWS[earlier][2] in does


@pytest.mark.parametrize(
    "seen",
    [
        {"late": 0.01, "at_bound": 0.2, "at_slew": 0.2, "free": 0.3},
        {"estimator_error": 0.024, "swing_hz": math.nan, "good_at_s": math.nan},
        {"estimator_error": math.nan, "controller": "rest", "estimator": "no learned force for 0.20 s"},
    ],
)
def test_what_a_good_run_has_too_is_no_cause(seen):
    assert probable_cause(replace(POOR, **seen)) == probable_cause(POOR)


# Recordings ----------------------------------------------------------------------------------------
T = np.arange(0.0, 20.0, 0.005)
SCENE = load_scene("track_circle", {"mode": "lockstep"})
LENGTH_M = SCENE.loaded_robot.length
CHAMBERS = SCENE.loaded_robot.chamber_names
CIRCLE = np.column_stack([np.cos(0.5 * np.pi * T), np.sin(0.5 * np.pi * T), np.zeros(T.size)])


def recorded(away_mm, command=None, reading=None, said=(), **changes):
    """A run whose tip is away from a circle (n, 3), with what its nodes said from the start on."""
    wanted = TopicSeries(T, 0.02 * CIRCLE)
    true = TopicSeries(T, wanted.value + 1e-3 * np.asarray(away_mm))
    chambers = np.full((T.size, 3), 30e3)
    command = TopicSeries(T, chambers if command is None else command, CHAMBERS)
    reading = TopicSeries(T, command.value if reading is None else reading, CHAMBERS)
    statuses = tuple(NodeStatus(0.0, node, level, text) for node, level, text in said)
    return RunRecording(true, true, wanted, command, reading, EMPTY, {}, (), said=statuses, **changes)


def judged(recording, scene=SCENE):
    return judge(report.summarise(recording, scene), scene, End(), recording)


def along_x(values_mm):
    return np.column_stack([values_mm, 0.0 * T, 0.0 * T])


SWING = along_x(4.0 * np.sin(4.0 * np.pi * T))
SWINGS = ("controller", 1, "limit cycle at 2.0 Hz: feedback lowered to 0.5 times its gains")


@pytest.mark.parametrize(
    ("of_time", "cause"),
    [(0.45, "controller: limit cycle at 2.0 Hz"), (0.8, "pressure_range_pa of tue_three_bellow, 90 kPa,")],
)
def test_a_bound_that_holds_a_chamber_most_of_the_time_comes_before_a_limit_cycle(of_time, cause):
    """A loop that swings is at its upper bound for half of each period at most."""
    command = np.full((T.size, 3), 30e3)
    command[of_time > (2.0 * T) % 1.0] = 90e3
    found = judged(recorded(SWING, command, said=(SWINGS,)))
    assert found.word in ("lost", "poor")
    assert f"probable cause: {cause}" in found.reason


STEADY = along_x(np.full(T.size, 3.0))


def test_an_arm_that_is_away_differs_from_its_file():
    found = judged(recorded(STEADY))
    assert found.word == "poor"
    assert "3.0 mm" in found.reason
    assert "differs from its robot file; next: see that each chamber" in found.reason


@pytest.mark.parametrize("hz", [1.4, 4.0])
def test_a_swing_is_found_with_its_frequency(hz):
    found = judged(recorded(along_x(4.0 * np.sin(2.0 * np.pi * hz * T))))
    assert found.word == "poor"
    assert f"swings about its reference at {hz} Hz" in found.reason


@pytest.mark.parametrize(
    "away",
    [
        3.0 * CIRCLE,  # of the reference's own period
        STEADY + along_x(1.5 * np.sin(8.0 * np.pi * T)),  # beside a larger steady error
        along_x(200.0 * np.exp(-0.2 * T) * np.sin(4.0 * np.pi * T) * (T > 15.0) * np.exp(-(T - 15.0))),
    ],
    ids=["round", "small", "ends"],
)
def test_an_error_of_another_kind_is_no_swing(away):
    recording = recorded(away)
    seen = evidence_of(recording, SCENE, report.summarise(recording, SCENE))
    assert math.isnan(seen.swing_hz)


def test_an_error_that_falls_needs_a_longer_run():
    """By a factor of 4 in two periods it comes from 5.5 mm at 16 s to a good one (1.3 mm)."""
    found = judged(recorded(along_x(88.0 * 4.0 ** (-T / 8.0))))
    assert found.word == "poor"
    seconds = int(found.reason.split("duration_s=")[1])
    assert 88.0 * 4.0 ** (-(seconds - 5.0) / 8.0) < 0.02 * 1e3 * LENGTH_M < 1.5
    assert seconds < 40


@pytest.mark.parametrize(
    ("changes", "level_pa", "name"),
    [
        ({}, 90e3, "pressure_range_pa of tue_three_bellow, 90 kPa,"),
        ({"limits.maximum_pa": 60e3}, 60e3, "limits.maximum_pa, 60 kPa,"),
        ({"controller.pressures.maximum_pa": 50e3}, 50e3, "controller.pressures.maximum_pa, 50 kPa,"),
        ({}, 0.0, "pressure_range_pa of tue_three_bellow, 0 kPa,"),
    ],
)
def test_the_bound_that_binds_is_named_with_who_states_it(changes, level_pa, name):
    """Whatever the error."""
    scene = load_scene("track_circle", {"mode": "lockstep", **changes})
    command = np.full((T.size, 3), 30e3)
    command[T > 15.0, 0] = level_pa
    found = judged(recorded(0.0 * STEADY, command), scene)
    assert found.word == "poor"
    assert "33% of the set points of the last 5 s at a bound, more than 20%" in found.reason
    assert f"probable cause: {name} holds set points back" in found.reason


def test_a_run_that_was_lost_at_a_bound_has_it_as_its_cause():
    """Also if it was not there in the last 5 s."""
    command = np.full((T.size, 3), 30e3)
    command[(T > 1.0) & (T < 15.0)] = 90e3
    found = judged(recorded(0.0 * STEADY, command))
    assert found.word == "lost"
    assert "70% of the set points at a bound, more than 50%" in found.reason
    assert "pressure_range_pa of tue_three_bellow, 90 kPa, holds set points back" in found.reason


def test_a_rate_and_a_valve_that_hold_back_are_named():
    """Up at 200 kPa/s, and slowly down; a pressure that stays below its set point."""
    command = 30e3 + 40e3 * np.column_stack([np.interp(T % 0.4, [0, 0.2, 0.4], [0, 1, 0])] * 3)
    assert "limits.rise_pa_s" in judged(recorded(STEADY, command)).reason
    assert "differs from" in judged(recorded(STEADY, 30e3 + 0.5 * (command - 30e3))).reason
    reading = np.full((T.size, 3), 30e3) - np.array([0.0, 8e3, 1e3])
    assert (
        "the pressure of link0/chamber1 is 8.0 kPa below" in judged(recorded(STEADY, reading=reading)).reason
    )


def test_an_estimate_that_is_off_and_an_arm_that_touches_are_named():
    recording = recorded(STEADY)
    off = replace(recording, estimated_tip=recording.wanted_tip)
    assert "estimated tip is 4.7% of the length away" in judged(off).reason
    pushed = along_x(6.0 * (np.sin(0.5 * np.pi * T) > 0.3))
    assert "held back, or pushed, on a part of its way" in judged(recorded(pushed)).reason


def test_what_the_nodes_say_last_stands_beside_the_verdict():
    said = (
        ("controller", 1, "gone before the end"),
        ("controller", 0, "active"),
        ("estimator", 1, "pose: NIS 5.0"),
        ("twin", 1, "late"),
    )
    good, bad = (judged(recorded(away, said=said)) for away in (0.0 * STEADY, STEADY))
    assert (good.word, good.reason) == ("good", "")
    assert good.notes == bad.notes == ("estimator: pose: NIS 5.0", "twin: late")
    assert "probable cause: estimator: pose: NIS 5.0" in bad.reason
    rows = dict(report.rows(report.summarise(recorded(STEADY), SCENE), SCENE))
    assert "verdict" not in rows


@pytest.mark.parametrize(
    ("away", "status", "printed"),
    [
        (0.0 * STEADY, 0, "good, but estimator: pose: NIS 5.0"),
        (STEADY, 1, "soro: poor: tip error 3.0 mm RMS"),
    ],
    ids=["good", "poor"],
)
def test_a_run_prints_its_verdict_and_writes_it(monkeypatch, tmp_path, capsys, away, status, printed):
    recording = recorded(away, said=(("estimator", 1, "pose: NIS 5.0"),))
    monkeypatch.setattr(report, "read_run", lambda bag, scene: recording)
    (tmp_path / "bag").mkdir()
    screen = io.StringIO()
    assert run._report(SCENE, tmp_path, End(), False, Console(file=screen)) == status
    assert printed in screen.getvalue()
    written = json.loads((tmp_path / "summary.json").read_text())
    assert written["verdict"] == ("poor" if status else "good")
    assert bool(written["reason"]) == bool(status)
    assert written["notes"] == ["estimator: pose: NIS 5.0"]
    assert "│ notes" in capsys.readouterr().out


# Vents ---------------------------------------------------------------------------------------------
TRIP = "regulator: vented: command lost: last one 105 ms old"


def vented(*said, failure=TRIP, trips=(TRIP,)):
    """The reason of a run that a missing command ended at 8 s."""
    recording = recorded(STEADY, said=said, events=(Event(8.0, "trip", "regulator", TRIP),))
    after = NodeStatus(8.1, "controller", 1, "no command: deactivated")
    recording = replace(recording, said=(*recording.said, after), faults=trips)
    return judge(report.summarise(recording, SCENE), SCENE, End(1, failure), recording).reason


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        (
            (("controller", 1, "no command: an elongation is near -1"),),
            "controller: no command: an elongation is near -1",
        ),
        (
            (
                ("controller", 1, "no command: no estimate of the state"),
                ("estimator", 1, "no estimate: no good sample for 0.30 s"),
            ),
            "estimator: no estimate: no good sample for 0.30 s",
        ),
        # In real time no state comes, and the controller says nothing new.
        (
            (
                ("controller", 1, "pressure saturated"),
                ("estimator", 1, "no estimate: no reading of link0/chamber0"),
            ),
            "estimator: no estimate: no reading of link0/chamber0",
        ),
        ((("controller", 1, "pressure saturated"),), TRIP),
    ],
)
def test_what_ended_the_commands_is_the_reason_of_a_vent(said, reason):
    assert vented(*said) == reason


def test_what_ended_the_commands_may_arrive_behind_the_trip():
    recording = recorded(STEADY, events=(Event(8.0, "trip", "regulator", TRIP),))
    late = NodeStatus(8.05, "controller", 1, "no command: law mine: division by zero")
    recording = replace(recording, said=(late,), faults=(TRIP,))
    found = judge(report.summarise(recording, SCENE), SCENE, End(1, TRIP), recording)
    assert found.reason == "controller: no command: law mine: division by zero"


def test_a_node_that_ended_is_the_reason_of_a_vent():
    assert vented(failure="controller ended with status -9") == "controller ended with status -9"
    leak = "regulator: vented: leak: link0/chamber0"
    assert vented(("controller", 1, "no command: x"), failure=leak, trips=(leak,)) == leak


def test_a_run_without_a_recording_has_what_the_nodes_said():
    said = {"estimator": "no estimate: no good sample for 0.30 s", "controller": "active; late"}
    found = judge(None, SCENE, End(1, TRIP, said=said))
    assert found.reason == "estimator: no estimate: no good sample for 0.30 s"
    assert found.notes == ("controller: active; late", f"estimator: {said['estimator']}")
    assert judge(None, SCENE, End(said=said)).notes == found.notes
    assert judge(None, SCENE, End(1, TRIP)).reason == TRIP


def test_the_end_of_commands_is_unknown_without_words():
    assert end_of_commands("", "") == end_of_commands("pressure saturated", "pose: NIS 5.0") == ""
