"""`soro move`: the path that it sends, what it prints, and its exit status."""

import contextlib
import re
import shlex
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from soro_core.control.reference.trajectory import Point
from soro_core.planning.steps import finished
from soro_lab.scene import load_scene
from soro_lab.scene.loop import loop_of
from soro_ros.commands import move
from soro_ros.conversion import messages
from soro_ros.run import motion_client as moving
from tests.patience import LIMIT_S
from tests.refused import refused
from tests.soro_ros.direct import captured, receive

LINE = np.array([[0.0, 0.0, 0.066], [0.01, 0.0, 0.066]])


class Scripted:
    """A caller whose controller reports what a test says."""

    def __init__(self, node, *states, vented=""):
        self.node, self.states, self.sent = node, list(states), []
        self.status = {"/arm/regulator": SimpleNamespace(message=vented or "active")}

    def spin(self, seconds):
        if not self.states or not self.sent:
            return
        stamp_ns = messages.to_ns(self.sent[-1].header.stamp)
        name, text = self.states.pop(0)
        values = {"stamp_ns": stamp_ns, "passed_s": 1.0, "duration_s": 2.0, "from_the_end_m": 0.003}
        if name == "other":
            values["stamp_ns"] = 1
        pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        receive(self.node, "/arm/arm/motion", DiagnosticStatus(name=name, message=text, values=pairs))


def moved(node, *states, vented=""):
    caller, said = Scripted(node, *states, vented=vented), []
    mover = moving.Mover(caller, "/arm/controller", LIMIT_S if states else 0.2, said.append)
    caller.sent = captured(node, "/arm/arm/reference/path")
    return mover.move(LINE), said, caller.sent


@pytest.mark.parametrize(
    ("state", "status"), [("reached", 0), ("refused", 2), ("lost", 1), ("replaced", 1), ("vented", 1)]
)
def test_the_exit_status_is_that_of_the_end(node, state, status):
    found, said, (path,) = moved(
        node, ("planning", ""), ("other", "of another motion"), ("moving", ""), (state, "why")
    )
    assert found == status
    assert [line.split(":")[0] for line in said] == ["planning", "moving", state]
    assert said[-1] == f"{state}: why, 1.0 of 2.0 s, 3.0 mm from the end"
    assert path.header.frame_id == "world"
    assert [messages.pose_arrays(pose.pose)[0].tolist() for pose in path.poses] == LINE.tolist()


def test_the_path_is_in_the_frame_in_which_the_controller_states_its_poses(node):
    caller = Scripted(node, ("reached", ""))
    mover = moving.Mover(caller, "/arm/controller", LIMIT_S, lambda line: None)
    caller.sent = captured(node, "/arm/arm/reference/path")
    receive(node, "/arm/arm/desired/tip", messages.pose_stamped(np.eye(4), 0, "map"))
    assert mover.move(LINE) == 0
    assert caller.sent[0].header.frame_id == "map"


@pytest.mark.parametrize(
    ("states", "vented", "end"),
    [
        ((("moving", ""),), "vented: leak", "lost: /arm/regulator: vented: leak"),
        ((), "", "lost: no report of the controller on arm/motion for 0.2 s"),
    ],
)
def test_a_vented_arm_and_a_silent_controller_are_lost(node, states, vented, end):
    status, said, _ = moved(node, *states, vented=vented)
    assert (status, said[-1]) == (1, end)


def test_a_controller_that_is_not_in_control_refuses(node):
    caller = Scripted(node)
    with refused("controller", names=("soro enable",)):
        moving.Mover(caller, "/arm/controller", 0.05, print).start()


MADE = []


class Noted:
    """In place of a mover: notes what a command asks for."""

    def __init__(self, caller, name, limit_s, say):
        self.parameters, self.path = None, None
        MADE.append(self)

    def configured(self, given):
        self.parameters = {key: value for key, value in given.items() if value is not None}
        return contextlib.nullcontext()

    def start(self):
        return np.array([0.001, 0.002, 0.066])

    def move(self, path):
        self.path = 1e3 * path
        return 0


@pytest.fixture
def asked(soro, monkeypatch):
    monkeypatch.setattr(moving, "Mover", Noted)
    monkeypatch.setattr(move, "service_caller", lambda: contextlib.nullcontext(None))
    monkeypatch.setattr(move, "one_node", lambda *of: "/arm/controller")

    def ask(*arguments):
        ended = soro("move", *arguments)
        return ended, MADE[-1]

    return ask


def test_lines_splines_and_points_begin_where_the_tip_is_wanted(asked):
    ended, one = asked("line", "-15", "0", "66.5", "15", "0", "66", "--speed", "40mm/s")
    assert ended.status == 0
    corner = [-15, 0, 66.5]
    assert one.path == pytest.approx(np.array([[1, 2, 66], corner, corner, [15, 0, 66]]))
    assert one.parameters == {"control.motion.speed_m_s": pytest.approx(0.04)}
    _, one = asked("line", "--relative", "-5", "0", "1", "--acceleration", "100mm/s2")
    assert one.path == pytest.approx(np.array([[1, 2, 66], [-4, 2, 67]]))
    assert one.parameters == {"control.motion.acceleration_m_s2": pytest.approx(0.1)}
    _, one = asked("spline", "0", "0", "67", "-5", "-5", "66")
    assert one.path == pytest.approx(np.array([[1, 2, 66], [0, 0, 67], [-5, -5, 66]]))
    assert one.parameters == {}
    _, one = asked("to", "0", "-1", "66")
    assert one.path == pytest.approx(np.array([[0, -1, 66]]))
    assert one.parameters == {}
    _, one = asked("to", "0", "-1", "66", "--around", "--margin", "3mm")
    assert one.parameters == {"control.motion.around": True, "control.motion.margin_m": 0.003}
    _, one = asked("to", "0", "-1", "66", "--straight")
    assert one.parameters == {"control.motion.around": False}
    _, one = asked("arc", "6", "7", "66", "11", "2", "66")
    assert one.path[[0, -1]] == pytest.approx(np.array([[1, 2, 66], [11, 2, 66]]))
    assert np.linalg.norm(one.path - [6, 2, 66], axis=1) == pytest.approx(np.full(len(one.path), 5.0))


@pytest.mark.parametrize("page", ["motion.md", "first_scene.md"])
def test_the_motions_of_a_page_are_planned_for_the_first_scene(asked, page):
    text = (Path(__file__).parents[2] / "docs" / page).read_text(encoding="utf-8")
    commands = re.findall(r"^    soro move (.*)", text, re.MULTILINE)
    control = loop_of(load_scene("track_circle")).controller
    planner = control.planner(control.initial_state(), 0.005)
    begin = Point(np.array([0.05, 0.0, 0.0]), np.zeros(3), np.zeros(3))
    assert len(commands) >= 2
    for command in commands:
        ended, one = asked(*shlex.split(command, comments=True))
        assert ended.status == 0, command
        motion = finished(planner.plan(begin, 1e-3 * one.path, None, 0.0))
        tip = control.arm.pose(motion.sample(motion.end_s).q, control.arm.length)[:3, 3]
        assert 1e3 * tip == pytest.approx(one.path[-1], abs=0.2), command


@pytest.mark.parametrize(
    ("arguments", "allowed"),
    [
        (("line", "1", "2"), "three numbers a point, one or more points for line"),
        (("to", *"123456"), "three numbers a point, one point for to"),
        (("arc", "1", "2", "3"), "three numbers a point, two points for arc"),
        (("spline", "0", "0", "66"), "three numbers a point, two or more points for spline"),
    ],
)
def test_points_that_are_too_few_or_too_many_are_wrong_use(soro, arguments, allowed):
    ended = soro("move", *arguments)
    assert ended.status == 2
    assert f"X Y Z: got '{len(arguments) - 1} numbers'; allowed: {allowed}" in ended.err


def test_only_a_single_point_is_gone_to_around_obstacles(soro):
    with refused("--around", names=("to: the other kinds",)):
        move.move(move.MotionType.LINE, ["1", "2", "3"], around=True)


def test_without_a_running_arm_it_says_how_to_start_one(soro, domain):
    ended = soro("move", "to", "0", "0", "60", "--timeout", "1s")
    (line,) = ended.err.splitlines()
    assert ended.status == 1
    assert "no arm is running" in line
    assert "soro run SCENE" in line
