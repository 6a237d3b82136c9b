"""Choice of sensors: greedy against all sets, symmetry, the estimator with a good and with a bad place."""

from itertools import combinations

import numpy as np
import pytest
import yaml

from soro_core.config import with_changes
from soro_core.errors import ConfigError
from soro_core.twin import Twin
from soro_lab.analysis.placement import Information, best, greedy
from soro_lab.analysis.problem import place_sensors
from soro_lab.analysis.sensor_picture import draw
from soro_lab.analysis.sensor_report import best_line, scene_block, step_rows, steps
from soro_lab.scene import Scene, load_scene
from soro_lab.scene.loop import loop_of


@pytest.fixture(scope="module")
def placed():
    """One link, and two links, with all kinds."""
    one = place_sensors(Scene(), ("pose", "marker", "imu", "bend"), 3, 2)
    two = place_sensors(Scene(robot="asu_two_segment"), ("pose", "imu"), 3, 2)
    return one, two


@pytest.mark.slow
def test_greedy_is_near_the_best_set(placed, figure):
    for found in placed:
        value, n = found.information.value, len(found.candidates)
        for count in (1, 2, 3):
            ours = value(greedy(found.information, count))
            most = max(value(those) for those in combinations(range(n), count))
            figure(f"{found.arm.robot.name}, {count} of {n}: greedy {100 * ours / most:.4f} % of the best")
            assert ours >= (1.0 - np.exp(-1.0)) * most
            assert ours == pytest.approx(most, rel=1e-9)
            assert value(best(found.information, count)) == most


def test_greedy_keeps_its_bound_where_it_is_not_the_best():
    """A set cover: the first choice, the largest, is none of the best two."""
    seen = [[1, 1, 1, 1, 0, 0], [1, 1, 0, 0, 1, 0], [0, 0, 1, 1, 0, 1]]
    scaled = np.array([[np.diag(100.0 * np.array(row)) for row in seen]])
    information = Information(np.eye(6), scaled, np.zeros((1, 3, 6)))
    ours = greedy(information, 2)
    assert ours[0] == 0
    assert best(information, 2) == (1, 2)
    part = information.value(ours) / information.value((1, 2))
    assert 1.0 - np.exp(-1.0) <= part < 1.0


def test_the_value_is_submodular_and_grows(placed):
    rng = np.random.default_rng(3)
    for found in placed:
        value, n = found.information.value, len(found.candidates)
        assert value(()) == 0.0
        for _ in range(20):
            order = rng.permutation(n)
            small, large, extra = order[:1], order[:3], order[3]
            gain = value([*small, extra]) - value(small)
            assert gain >= value([*large, extra]) - value(large) - 1e-9
            assert value(large) > value(small)


def test_a_turned_arm_has_the_same_values():
    """About the vertical by 90 degrees, with its chambers: nothing changes but the directions."""
    robot = Scene().loaded_robot
    half = np.sqrt(0.5)
    values = []
    for quaternion in ((0.0, 0.0, 0.0, 1.0), (0.0, 0.0, half, half)):
        scene = Scene()
        scene.__dict__["loaded_robot"] = robot.replace(base_quaternion=quaternion)
        found = place_sensors(scene, ("pose", "imu"), 1, 2)
        values.append([found.information.value([k]) for k in range(4)])
    assert values[0] == pytest.approx(values[1], rel=1e-6)


@pytest.mark.slow
def test_more_sensors_say_more_and_the_report_has_it(placed, tmp_path):
    found = placed[1]
    rows = steps(found)
    assert [row.value for row in rows] == sorted(row.value for row in rows)
    assert [row.tip_m for row in rows] == sorted((row.tip_m for row in rows), reverse=True)
    assert len(step_rows(found)) == 4
    assert best_line(found) == "the best of all sets of 3"
    draw(tmp_path / "sensors.png", found, "test")
    assert (tmp_path / "sensors.png").stat().st_size > 10_000


def test_the_block_is_part_of_a_scene(placed):
    for found in placed:
        block = yaml.safe_load(scene_block(found))
        scene = Scene.model_validate(block)
        poses = {
            found.candidates[k].s for k in found.chosen if found.candidates[k].kind.name in ("pose", "marker")
        }
        if poses:
            assert np.array(scene.twin.pose.locations) * found.arm.length == pytest.approx(
                sorted(poses), abs=1e-6
            )
        assert scene.twin.pose.enabled == bool(poses)


def test_arguments_that_are_not_allowed_are_refused():
    for keys, key in (((("pose",), 5, 2), "--count"), ((("pose",), 0, 2), "--count")):
        with pytest.raises(ConfigError) as caught:
            place_sensors(Scene(), *keys)
        assert caught.value.key == key
    with pytest.raises(ConfigError) as caught:
        place_sensors(Scene(), ("pose",), 1, 2, {"position_m": 0.0})
    assert caught.value.key == "position_m"
    with pytest.raises(ConfigError) as caught:
        place_sensors(Scene(robot="silicone_rod"), ("pose",), 1, 2)
    assert caught.value.key == "robot"


def test_the_estimator_is_better_with_the_chosen_place(figure):
    """Pose at the chosen place and at the one of least information, on the same circle with the same load."""
    scene = load_scene("track_circle", {"platform": "", "twin.payload_kg": 0.01, "mode": "lockstep"})
    found = place_sensors(scene, ("pose",), 1, 4, seconds=2.0)
    values = [found.information.value([k]) for k in range(4)]
    places = {"chosen": found.candidates[found.chosen[0]].s, "worst": found.candidates[np.argmin(values)].s}
    errors = {}
    for name, s in places.items():
        pose = with_changes(scene.twin.pose, locations=(s / found.arm.length,))
        there = with_changes(scene, twin=with_changes(scene.twin, pose=pose))
        twin = Twin(there.loaded_robot, with_changes(there.twin_node(), pressures="regulators"))
        loop, late = loop_of(there), []
        for tick in loop.run(twin, 600, twin.dt, before_s=-twin.dt):
            if tick.t_s > 1.5:
                late.append(np.linalg.norm(tick.estimate.tip_pose[:3, 3] - tick.seen.tip[:3, 3]))
        errors[name] = float(np.sqrt(np.mean(np.square(late))))
    figure(f"tip of the estimator: {places} m, RMS errors {errors} m")
    assert errors["chosen"] < 0.5 * errors["worst"]
