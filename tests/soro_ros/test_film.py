"""The film of a run: the arm that is drawn is the one that was recorded."""

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from soro_core.config import find_config, with_changes
from soro_core.robot import load_robot
from soro_core.twin.config import PayloadChanges
from soro_core.twin.push import Wall
from soro_lab.scene import load_scene
from soro_ros.cli import application
from soro_ros.pictures import film
from soro_ros.recordings.recording import EMPTY
from soro_ros.view import arm_shape

BAG = Path(__file__).parents[2] / "bags" / "track_circle_lockstep_2s"


@pytest.fixture(scope="module")
def shown():
    return film.take(BAG, load_scene(str(BAG / "scene.yaml")), 0.5, 1.5, 10.0)


def test_the_drawn_tip_is_the_recorded_one(shown):
    assert shown.t == pytest.approx(np.arange(0.5, 1.51, 0.1))
    assert shown.poses[:, -1, :3, 3] == pytest.approx(shown.recording.true_tip.at(shown.t), abs=1e-7)


def test_a_film_goes_on_behind_control_until_the_recording_ends(soro, tmp_path, monkeypatch):
    taken = []
    monkeypatch.setattr(film, "still", lambda shown, file, width: taken.append(shown) or file.touch())
    scene = tmp_path / "scene.yaml"
    scene.write_text((BAG / "scene.yaml").read_text().replace("duration_s: 2.0", "duration_s: 1.5"))
    (tmp_path / "bag").symlink_to(BAG)
    assert soro("plot", str(tmp_path), "--film", str(tmp_path / "film.png")).status == 0
    assert taken[0].scene.duration_s == 1.5
    assert taken[0].t[-1] == pytest.approx(4.1)  # of the bag, in which the arm has come to rest
    assert np.all(np.isnan(taken[0].command[-1]))
    assert np.all(np.isfinite(taken[0].command[10]))


def test_a_real_arm_is_drawn_as_it_was_estimated(monkeypatch, shown):
    scene = load_scene(str(BAG / "scene.yaml"))
    without = replace(shown.recording, true_state=EMPTY)
    monkeypatch.setattr(film, "read_run", lambda bag, scene: without)
    estimated = film.take(BAG, scene, 0.5, 1.5, 10.0)
    assert estimated.poses[:, -1, :3, 3] == pytest.approx(without.estimated_tip.at(shown.t), abs=1e-6)


def test_the_wall_of_the_scene_is_drawn_where_it_is(shown):
    at = {"stiffness": 1e3, "point": (0.03, 0.0, 0.0), "normal": (-1.0, 0.0, 0.0)}
    wall = Wall(**at, velocity_m_s=(-0.01, 0.0, 0.0))
    scene = with_changes(shown.scene, twin=with_changes(shown.scene.twin, wall=wall))
    drawn = film.AnimatedFigure(replace(shown, scene=scene))

    def corners(k):
        drawn.at(k)
        (path,) = drawn._walls.get_paths()
        return path.vertices[:4]

    moved = drawn._camera.project(np.array([[-0.01, 0.0, 0.0], [0.0, 0.0, 0.0]]))[:, :2]
    assert corners(10) - corners(0) == pytest.approx(np.tile(moved[0] - moved[1], (4, 1)), abs=1e-9)
    still = film.AnimatedFigure(shown)
    still.at(0)
    assert not still._walls.get_paths()


def test_a_chamber_has_the_colour_of_its_pressure(shown):
    robot, s = shown.robot, shown.s
    straight = np.tile(np.eye(4), (len(s), 1, 1))
    straight[:, 2, 3] = s

    def colours(pressure):
        return arm_shape.surface(robot, s, straight, pressure, 0.0).colours

    differs = np.any(colours({"link0/chamber1": 1.0}) != colours({}), axis=1)
    faces = arm_shape.surface(robot, s, straight, {}, 0.0).corners[differs]
    middle = arm_shape.chambers(robot)[1]
    away = np.linalg.norm(faces[..., :2] - middle.offset, axis=-1)
    assert differs.any()
    assert away.max() <= middle.radius + 1e-12


@pytest.mark.parametrize("name", ["tue_three_bellow", "asu_two_segment"])
def test_chambers_lie_within_the_section(name):
    robot = load_robot(find_config(name, "robots"))
    found = arm_shape.chambers(robot)
    assert [chamber.name for chamber in found] == list(robot.chamber_names)
    for chamber in found:
        assert 0 < chamber.radius <= robot.links[0].radius - np.hypot(*chamber.offset)
    assert arm_shape.places(robot)[-1] == pytest.approx(found[-1].end)


def test_three_bellows_lie_beside_one_another():
    found = arm_shape.chambers(load_robot(find_config("tue_three_bellow", "robots")))
    for one, other in combinations(found, 2):
        assert np.hypot(*np.subtract(one.offset, other.offset)) >= one.radius + other.radius


def test_a_link_that_tapers_is_drawn_so():
    """Plates and core have the radius of their section, and the bellows stay within it."""
    robot = load_robot(find_config("tapered_helix", "robots"))
    upright = np.tile(np.eye(4), (len(s := arm_shape.places(robot)), 1, 1))
    drawn = {
        body.name: (body, body.rings(arm_shape.between(s, upright, body.s), 36))
        for body in arm_shape.bodies(robot)
    }
    for name, radius in (("plate0", 0.012), ("plate1", 0.007)):
        assert np.hypot(*drawn[name][1][..., :2].T).max() == pytest.approx(radius)
    section = np.interp(drawn["core"][0].s, [0.0, robot.length], [0.012, 0.007])
    np.testing.assert_allclose(np.hypot(*drawn["core"][1][:, 0, :2].T), 0.3 * section)
    for name in robot.chamber_names:
        body, rings = drawn[name]
        section = np.interp(body.s, [0.0, robot.length], [0.012, 0.007])
        assert (np.hypot(rings[..., 0], rings[..., 1]).max(axis=1) < section).all()


@pytest.mark.slow
def test_gif_and_png(tmp_path):
    app, run = application(), ["plot", str(BAG), "--start", "1s", "--end", "1400ms", "--width", "320"]
    for name in ("film.gif", "film.png"):
        result = CliRunner().invoke(app, [*run, "--film", str(tmp_path / name)])
        assert result.exit_code == 0, result.output
    with Image.open(tmp_path / "film.gif") as gif:
        assert (gif.size, gif.n_frames, gif.info["duration"]) == ((320, 180), 5, 100)
        frames = []
        for k in range(gif.n_frames):
            gif.seek(k)
            frames.append(np.asarray(gif.convert("RGB")).astype(int))
    with Image.open(tmp_path / "film.png") as png:
        last = np.asarray(png).astype(int)
    assert np.abs(frames[-1] - last).mean() < 0.5 * np.abs(frames[0] - last).mean()
    assert tuple(frames[0][0, 0]) == (255, 255, 255)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["film.avi"], "--film"),
        (["film.gif", "--start", "4.2"], BAG.name),
        (["film.gif", "-t", "/arm/tip"], "--film"),
    ],
    ids=["no such kind of file", "begins at the end of the run", "another picture too"],
)
def test_what_cannot_be_drawn_is_refused(options, says):
    result = CliRunner().invoke(application(), ["plot", str(BAG), "--film", *options])
    assert result.exit_code == 2
    (line,) = result.stderr.splitlines()
    assert says in line


def test_the_load_is_that_of_the_time(shown):
    changes = PayloadChanges(at_s=(1.0,), payload_kg=(0.01,))
    scene = with_changes(shown.scene, twin=with_changes(shown.scene.twin, payload_changes=changes))
    loads = [replace(shown, scene=scene).payload_kg(k) for k in range(len(shown.t))]
    assert loads == [0.02] * 5 + [0.01] * 6


@pytest.mark.parametrize("normal", [(-1.0, 0.0, 0.0), (0.0, 0.0, 2.0), (0.3, -0.5, 0.1)])
def test_a_wall_is_drawn_on_its_plane(normal):
    plane = {"point": (0.03, 0.01, 0.02), "normal": normal, "stiffness": 100.0}
    robot = load_robot("tue_three_bellow").replace(contacts={"planes": [plane]})
    body = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.06]])
    (corners,) = arm_shape.walls(robot.contacts.planes, body)
    assert (corners - plane["point"]) @ normal == pytest.approx(0.0, abs=1e-12)
    sides = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    assert sides == pytest.approx(0.06)
    assert arm_shape.walls((), body) == []
