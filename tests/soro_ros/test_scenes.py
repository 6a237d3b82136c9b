"""The shipped scenes in lockstep: each ends as it says, and as near to its reference as it can."""

import numpy as np
import pytest

from soro_core.config import with_changes
from soro_core.control.reference_feasibility import check_reach
from soro_lab.scene import check_scene, load_scene
from soro_lab.scene.load import scenes_in, shipped_folder
from soro_lab.scene.loop import loop_of
from soro_ros.recordings.recording import read
from tests.patience import patient_platform
from tests.soro_ros.in_process import lockstep, without_valves
from tests.soro_ros.running import run, summary

# Scenes that end well: how long each runs here [s], and the largest tip error in the last second, RMS [mm].
GOOD = {
    "set_points": (8.5, 1.0),
    "line_and_square": (5.0, 0.5),
    "two_links": (5.0, 0.8),
    "hanging_arm": (5.0, 0.4),
    "contact_with_a_wall": (6.0, 1.0),
    "imu_only": (6.0, 1.5),
    "six_links": (5.0, 0.5),
    "no_devices": (5.0, 0.5),
}
# What the load that changes, and the wall, do to the tip at least [mm].
DISTURBED_MM = {"set_points": 8.0, "contact_with_a_wall": 3.0}


def shipped(name, **changes):
    scene = load_scene(name, {"mode": "lockstep", **changes})
    check_scene(scene, name)
    return without_valves(scene)


def errors_mm(scene, seconds):
    """Distance of the tip from its reference at each tick under control."""
    check_reach(loop_of(scene).controller, scene.verdict.tip_error_part)
    steps = list(lockstep(scene, round(seconds * scene.rate_hz)))
    return np.array([1e3 * np.linalg.norm(step.tip - step.wanted) for step in steps[1:]])


def last_second_mm(scene, errors):
    return float(np.sqrt(np.mean(errors[-round(scene.rate_hz) :] ** 2)))


def test_every_scene_is_listed_and_tested():
    found = scenes_in(shipped_folder())
    assert (found.wrong, found.others) == ((), ())
    ends = {scene.name: scene.verdict.expected for scene in found.scenes}
    assert ends == dict.fromkeys(GOOD, "good") | {"valve_fails": "vented", "track_circle": "good"}
    assert all(scene.description and scene.mode == "real_time" for scene in found.scenes)


@pytest.mark.slow
@pytest.mark.parametrize("name", GOOD)
def test_a_scene_follows_its_reference(name, figure):
    """The loop of its nodes in one process; `test_closed_loop.py` compares it with them to the bit."""
    seconds, most_mm = GOOD[name]
    scene = shipped(name)
    errors = errors_mm(scene, seconds)
    found = last_second_mm(scene, errors)
    figure(f"scene {name}: tip error {found:.2f} mm RMS from {seconds - 1:g} to {seconds:g} s")
    assert found <= most_mm < 1e3 * scene.verdict.tip_error_part * scene.loaded_robot.length
    if name in DISTURBED_MM:
        assert errors[round(3.0 * scene.rate_hz) :].max() > DISTURBED_MM[name]


@pytest.mark.slow
def test_a_controller_that_does_not_learn_fails():
    seconds, most_mm = GOOD["no_devices"]
    scene = shipped("no_devices", **{"controller.adapt": False})
    assert last_second_mm(scene, errors_mm(scene, seconds)) > 4 * most_mm


@pytest.mark.process
def test_the_valve_that_fails_vents_the_arm(domain, tmp_path):
    """With nodes, and bytes on a pseudo-terminal."""
    platform = patient_platform(tmp_path, real_time=False)
    status, output, folder = run(
        tmp_path / "runs", "mode=lockstep", f"platform={platform}", scene="valve_fails"
    )
    figures = summary(folder)
    assert status == 1, output
    assert figures["verdict"] == load_scene("valve_fails").verdict.expected
    assert "over-pressure: link0/chamber1" in figures["reason"]
    assert figures["pressure_max_pa"] > 90e3


@pytest.mark.process
def test_path_and_load_reach_the_nodes(domain, tmp_path):
    """To the bit what one process computes."""
    changes = ("mode=lockstep", "platform=", "duration_s=1.2", "twin.payload_changes.at_s=[0.4, 0.8]")
    hurry = ("controller.reference.start_s=0.3", "controller.reference.pause_s=0.1")
    status, output, folder = run(tmp_path, *changes, *hurry, scene="set_points")
    assert status == 0, output
    scene = load_scene(folder / "scene_used.yaml")
    assert scene.twin.payload_changes.at_s == (0.4, 0.8)
    recorded = read(folder / "bag", scene.name)
    steps = list(lockstep(scene, 241))
    constant = list(lockstep(with_changes(scene, twin=with_changes(scene.twin, payload_changes={})), 241))
    for series, name, first in (
        (recorded.true_tip, "tip", 0),
        (recorded.wanted_tip, "wanted", 1),
        (recorded.command, "setpoint_pa", 1),
    ):
        expected = np.array([getattr(step, name) for step in steps[first:]])
        assert len(series.value) >= len(expected) - 2
        np.testing.assert_array_equal(series.value, expected[: len(series.value)], err_msg=name)
    moved = 1e3 * np.array([np.linalg.norm(a.tip - b.tip) for a, b in zip(steps, constant, strict=True)])
    assert moved[:81].max() == 0.0
    assert moved[161] > 1.0
