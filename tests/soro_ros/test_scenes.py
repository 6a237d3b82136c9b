"""The shipped scenes in lockstep: each ends as it says, and as near to its reference as it can."""

import numpy as np
import pytest

from soro_lab.scene import check_scene, load_scene
from soro_lab.scene.load import scenes_in, shipped_folder
from soro_ros.study.closed_loop import ticks_of
from tests.soro_ros.in_process import tip_errors_m

# Scenes that run to their end: how long here [s], and the largest tip error in the last second, RMS [mm].
GOOD = {
    "set_points": (8.5, 1.0),
    "line_and_square": (5.0, 0.5),
    "two_links": (5.0, 0.8),
    "hanging_arm": (5.0, 0.4),
    "contact_with_a_wall": (6.0, 1.0),
    "imu_only": (6.0, 1.5),
    "six_links": (5.0, 0.5),
    "no_devices": (5.0, 0.5),
    "press_wall": (11.0, 1.0),
    "push_by_hand": (16.0, 1.0),
    "antagonistic_joint": (12.0, 0.5),
}
# What the load that changes, and the wall, do to the tip at least [mm].
DISTURBED_MM = {"set_points": 8.0, "contact_with_a_wall": 3.0, "push_by_hand": 3.0, "antagonistic_joint": 0.8}


def shipped(name, **changes):
    scene = load_scene(name, {"mode": "lockstep", **changes})
    check_scene(scene, name)
    return scene


def last_second_mm(scene, errors):
    """Distance of the tip from its reference, RMS [mm]."""
    return float(np.sqrt(np.mean(errors[-round(scene.rate_hz) :] ** 2)))


def test_every_scene_is_listed_and_tested():
    found = scenes_in(shipped_folder())
    assert (found.wrong, found.others) == ((), ())
    ends = {scene.name: scene.verdict.expected for scene in found.scenes}
    others = {
        "track_circle": "good",
        "three_fingers": "good",
        "grasp_ball": "good",
        "grasp_pneunets": "good",
        "hand_on_an_arm": "good",
        "two_arms_carry_a_bar": "good",
        "wrap_a_cylinder": "good",
        "exoskeleton": "good",
        "contact_with_a_wall": "poor",
        "valve_fails": "vented",
    }
    assert ends == dict.fromkeys(GOOD, "good") | others
    assert all(scene.description and scene.mode == "real_time" for scene in found.scenes)


@pytest.mark.slow
@pytest.mark.parametrize("name", GOOD)
def test_a_scene_follows_its_reference(name, figure):
    """The loop of its nodes in one process; `test_closed_loop.py` compares it with them to the bit."""
    seconds, most_mm = GOOD[name]
    scene = shipped(name)
    ticks = list(ticks_of(scene.with_keys(duration_s=seconds)))
    errors = 1e3 * tip_errors_m(ticks)
    found = last_second_mm(scene, errors)
    figure(f"scene {name}: tip error {found:.2f} mm RMS from {seconds - 1:g} to {seconds:g} s")
    assert found <= most_mm < 1e3 * scene.verdict.tip_error_part * scene.loaded_robot.length
    if name in DISTURBED_MM:
        assert errors[round(3.0 * scene.rate_hz) :].max() > DISTURBED_MM[name]
    if name == "press_wall":
        the_press_keeps_its_force_on_a_wall_that_nobody_told_it(scene, ticks)


def the_press_keeps_its_force_on_a_wall_that_nobody_told_it(scene, ticks):
    along = np.array([-tick.seen.force_n[0] for tick in ticks])
    settled = along[round(10.0 * scene.rate_hz) :]
    assert scene.controller.reference.press_n == (0.08, 0.0, 0.0)
    assert settled.mean() == pytest.approx(0.08, rel=0.05)
    assert along[: round(6.0 * scene.rate_hz)].tolist() == [0.0] * round(6.0 * scene.rate_hz)
    assert ticks[-1].estimate.external.stage == "contact"
    assert {tick.estimate.status.note for tick in ticks} == {""}, "a touch is no fault of the sensor"


@pytest.mark.slow
def test_a_controller_that_does_not_learn_fails():
    seconds, most_mm = GOOD["no_devices"]
    scene = shipped("no_devices", **{"controller.adapt": False})
    errors = 1e3 * tip_errors_m(ticks_of(scene.with_keys(duration_s=seconds)))
    assert last_second_mm(scene, errors) > 4 * most_mm
