"""From moments to what viser sends."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("viser", reason="the extra `view` is not installed")

from soro_core.robot import load_robot
from soro_core.robot.surroundings import Contacts, Plane, Sphere
from soro_ros.view.access import Access
from soro_ros.view.moment import Moment
from soro_ros.view.page import ViewerPage, touching, turned_to
from soro_ros.view.server import ViewServer

ROBOT = load_robot("tue_three_bellow")


@pytest.fixture
def server():
    it = ViewServer(Access(), 18180)
    yield it
    it.stop()


@pytest.fixture
def sent(server, monkeypatch):
    """Names of what is sent."""
    found = []
    buffer = server._websock_server.get_message_buffer()
    push = buffer.push
    monkeypatch.setattr(buffer, "push", lambda message: (found.append(message), push(message)))
    return found


def straight(length=ROBOT.length, x=0.0):
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, 2, 3], poses[:, 0, 3] = np.linspace(0.0, length, 5), x
    return poses


@pytest.mark.process
def test_a_moment_that_is_like_the_last_sends_nothing_and_a_moved_arm_its_vertices(server, sent):
    page = ViewerPage(server, ROBOT)
    names = ROBOT.chamber_names
    moment = Moment(1.0, straight(), pressure=dict.fromkeys(names, 20e3))
    page.show([moment], at_once=True)
    sent.clear()
    page.show([replace(moment, pressure=dict.fromkeys(names, 20.001e3))])
    assert sent == []
    page.show([replace(moment, backbone=straight(x=1e-3))])
    updates = {key for message in sent for key in getattr(message, "updates", {})}
    assert updates == {"vertices"}
    moved = [message for message in sent if "vertices" in getattr(message, "updates", {})]
    assert len(moved) == len(page._skin.names)
    sent.clear()
    page.show([replace(moment, backbone=straight(x=1e-3), pressure={names[0]: 80e3})])
    colours = [message.name for message in sent if "color" in message.updates]
    assert f"/arm/{names[0]}" in colours


@pytest.mark.process
def test_a_pressure_beyond_the_range_of_the_robot_is_within_the_plot(server):
    page = ViewerPage(server, ROBOT)
    name, most_kpa = ROBOT.chamber_names[0], ROBOT.pressure_range_pa[1] / 1e3
    for kpa in (20.0, 120.0, -7.0, 20.0):
        page.show([Moment(1.0, pressure={name: 1e3 * kpa})], at_once=True)
        if kpa == 20.0 and page.plots._range_kpa[0] == 0.0:
            assert page.plots._pressure.scales["y"]["range"] == (0.0, most_kpa)
    assert page.plots._pressure.scales["y"]["range"] == (-7.0, 120.0)


@pytest.mark.process
def test_without_an_estimate_no_arm_is_drawn_and_the_page_says_so(server):
    page = ViewerPage(server, ROBOT)
    page.show([Moment(1.0, straight())])
    assert all(mesh.visible for mesh in page._meshes)
    page.show([Moment(2.0, None, latched=True, valves="vented: high pressure", faults=("twin: silent",))])
    assert not any(mesh.visible for mesh in page._meshes)
    assert "no estimate" in page._state.value
    assert page._head == "soro: vented"
    assert (page._valves.value, page._faults.value) == ("vented: high pressure", "twin: silent")


@pytest.mark.process
def test_a_force_is_an_arrow_at_the_tip_and_stands_in_words(server):
    page = ViewerPage(server, ROBOT)
    for force_n, length_m in ((np.array([0.1, 0.0, 0.0]), 0.02), (np.array([0.0, -50.0, 0.0]), ROBOT.length)):
        page.show([Moment(1.0, straight(), force=force_n, stage="contact")])
        (begin, end) = page._force.points[0]
        assert begin == pytest.approx([0.0, 0.0, ROBOT.length], abs=1e-7)
        assert end - begin == pytest.approx(length_m * force_n / np.linalg.norm(force_n), abs=1e-7)
        assert page._force.visible
    assert page._state.value == "1.0 s, force 50000 mN (contact)"
    page.show([Moment(2.0, straight())])
    assert (page._force.visible, page._state.value) == (False, "2.0 s")


@pytest.mark.process
def test_what_touches_an_obstacle_is_marked(server):
    wall = Plane(stiffness=1e3, point=(0.01, 0.0, 0.0), normal=(-2.0, 0.0, 0.0))
    ball = Sphere(stiffness=1e3, centre=(0.0, 0.0, ROBOT.length), radius=0.001)
    robot = ROBOT.replace(contacts=Contacts(planes=(wall,), spheres=(ball,), points_per_link=4))
    assert touching(robot, straight(x=0.0))[:, 2] == pytest.approx([ROBOT.length])  # the ball at the tip
    assert len(touching(robot, straight(x=0.02))) == 4
    assert len(touching(robot, straight(x=-0.02))) == 0
    assert len(touching(ROBOT, straight())) == 0
    page = ViewerPage(server, robot)
    page.show([Moment(1.0, straight(x=0.02))])
    assert [ball.visible for ball in page._touching] == [True] * 4


@pytest.mark.parametrize("normal", [(0, 0, 1), (0, 0, -3), (1, 0, 0), (0.3, -2.0, 0.4)])
def test_a_plane_is_drawn_along_its_normal(normal):
    w, x, y, z = turned_to(normal)
    axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    assert axis == pytest.approx(np.asarray(normal) / np.linalg.norm(normal))
