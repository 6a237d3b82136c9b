"""A recorded run in the view."""

import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("viser", reason="the extra `view` is not installed")

from soro_core.errors import BagError, ConfigError
from soro_core.robot import load_robot
from soro_lab.bag import BagReader
from soro_ros.commands.view import view
from soro_ros.view.access import Access
from soro_ros.view.recorded import RecordedPage, namespace_of, read
from soro_ros.view.server import ViewServer

BAGS = Path(__file__).resolve().parents[3] / "bags"
CIRCLE = BAGS / "track_circle_lockstep_2s"


@pytest.fixture(scope="module")
def recorded():
    """Moments of a run, drawn from its arm/backbone."""
    return read(CIRCLE, "", None, 20.0)


def test_a_run_becomes_moments_of_its_own_time(recorded):
    times = np.array([moment.t_s for moment in recorded])
    assert times[0] == 0.0
    assert np.diff(times) == pytest.approx(0.05, abs=0.0051)
    last = next(moment for moment in recorded if moment.t_s > 1.9)  # of two seconds under control
    assert last.error_m < 1e-3
    assert last.latched is False
    assert max(last.pressure.values()) > 20e3
    assert last.backbone[-1, :3, 3] == pytest.approx(last.tip, abs=2e-3)
    assert max(recorded[-1].pressure.values()) < 5e3  # recorded until the arm is empty


def test_without_a_backbone_the_shape_follows_from_the_recorded_coordinates():
    def shape(q):
        poses = np.tile(np.eye(4), (2, 1, 1))
        poses[1, 0, 3] = q[0]
        return poses

    _, first, *_, last = read(BAGS / "two_links", "", shape, 20.0)  # the estimate begins after the first
    assert len(first.backbone) == len(last.backbone) == 2
    assert first.backbone[1, 0, 3] != last.backbone[1, 0, 3]


def test_an_arm_that_is_not_recorded_is_named():
    with BagReader(CIRCLE) as reader:
        assert namespace_of(reader, "track_circle") == "/track_circle"
        with pytest.raises(BagError, match=r"--namespace other; recorded: /track_circle"):
            namespace_of(reader, "other")


def test_a_recording_without_a_scene_needs_a_robot(tmp_path):
    shutil.copytree(CIRCLE, tmp_path / "bag", ignore=shutil.ignore_patterns("scene.yaml"))
    with pytest.raises(ConfigError, match=r"--robot.*no scene"):
        view(tmp_path / "bag", robot="", namespace="", port=18480, rate=20.0, trail=10.0)


def test_what_is_no_bag_says_so_and_not_that_a_robot_is_missing(tmp_path, soro):
    ended = soro("view", str(tmp_path))
    assert ended.status == 2
    assert "no .mcap or .db3 file" in ended.err


@pytest.mark.process
def test_play_pause_and_the_slider_set_the_time(recorded):
    server = ViewServer(Access(), 18280)
    try:
        player = RecordedPage(server, {"": (load_robot("tue_three_bellow"), recorded)}, 10.0)
        player.step(0.5)
        assert player.shown(recorded)[-1].t_s == 0.0  # no page is open
        server.get_clients = lambda: {0: None}
        player.step(0.5)
        assert player.shown(recorded)[-1].t_s == pytest.approx(0.5, abs=0.05)
        player._toggle()
        player.step(0.5)
        assert player.shown(recorded)[-1].t_s == pytest.approx(0.5, abs=0.05)
        player._slider.value = 1.5
        player._on_slider(SimpleNamespace(client=None))  # set by the server
        assert player.shown(recorded)[-1].t_s == pytest.approx(0.5, abs=0.05)
        player._on_slider(SimpleNamespace(client=object()))
        assert player.shown(recorded)[-1].t_s == pytest.approx(1.5, abs=0.05)
        player._toggle()
        player.step(99.0)
        assert player.shown(recorded)[-1] is recorded[-1]
        assert player._button.label == "play"
        player._toggle()  # from the begin again
        player.step(0.1)
        assert player.shown(recorded)[-1].t_s == pytest.approx(0.1, abs=0.05)
    finally:
        server.stop()


@pytest.mark.process
def test_several_arms_are_on_one_page_each_with_its_own_moments(recorded):
    server = ViewServer(Access(), 18290)
    try:
        robot = load_robot("tue_three_bellow")
        arms = {"left": (robot, recorded), "right": (robot.replace(base_position=(0.1, 0.0, 0.0)), recorded)}
        player = RecordedPage(server, arms, 10.0)
        server.get_clients = lambda: {0: None}
        player.step(0.5)
        left, right = player._pages
        assert (left._meshes[0].name, right._meshes[0].name) == tuple(
            f"/{name}/arm/{left._skin.names[0]}" for name in arms
        )
        assert left._meshes[0].visible
        assert right._meshes[0].visible
    finally:
        server.stop()


@pytest.mark.process
def test_an_arm_at_the_tip_of_another_is_drawn_below_the_frame_of_that_tip(recorded):
    """In a viser scene what has the name of a frame before its own moves with that frame."""
    server = ViewServer(Access(), 18300)
    try:
        robot = load_robot("tue_three_bellow")
        arms = {"upper": (robot, recorded), "lower": (robot, recorded)}
        player = RecordedPage(server, arms, 10.0, mounts={"lower": "upper"})
        server.get_clients = lambda: {0: None}
        player.step(0.5)
        upper, lower = player._pages
        tip = next(frame for frame in upper._frames if frame.name == "/upper/tip")
        end = upper._skin.names.index("core")
        assert tip.visible
        assert np.linalg.norm(tip.position - upper._vertices[end][-1]) < 0.3 * robot.length
        assert lower._meshes[0].name == f"/upper/tip/lower/arm/{lower._skin.names[0]}"
    finally:
        server.stop()
