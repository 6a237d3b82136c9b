"""Paths on the topic of a controller in the test's own process, and what it reports of them."""

import contextlib
import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path

from soro_core import equilibrium, save_robot
from soro_core.rotation import quaternion_from_matrix, rotation_exp
from soro_ros.conversion import messages
from soro_ros.host import middleware
from soro_ros.nodes.controller import ControllerNode
from soro_ros.topics.diagnostics import WARN
from tests.soro_core.planning.test_around import ARM, END, IN_THE_WAY, START, TWO, least_clearance, tip
from tests.soro_ros.direct import captured, receive, request

NAMES = ["link0/elongation", "link0/bending_x", "link0/bending_y"]
CHAMBERS = ["link0/chamber0", "link0/chamber1", "link0/chamber2"]
TURNED = [float(x) for x in quaternion_from_matrix(rotation_exp(np.array([0.0, 0.0, 0.5 * np.pi])))]


class Ticked:
    """A controller whose arm follows its reference exactly, tick by tick, and its reports."""

    def __init__(self, node: ControllerNode, start_s: float, rest: np.ndarray | None) -> None:
        self.node, self.t_s = node, start_s
        self.reports = captured(node, "arm/motion")
        self.follows = True
        robot = node.controller.robot
        self.names, self.chambers = robot.coordinate_names, robot.chamber_names
        self.rest = np.zeros(robot.n_q) if rest is None else rest

    def tick(self, times: int = 1) -> None:
        for _ in range(times):
            self.t_s += 5e-3
            stamp_ns, point = round(self.t_s * 1e9), self.node.state.point
            q = point.q if self.follows and point is not None else self.rest
            receive(
                self.node,
                "chambers/state",
                messages.chambers(self.chambers, np.zeros(len(self.chambers)), stamp_ns),
            )
            state = messages.arm_state(self.names, q, 0.0 * q, np.zeros(3), stamp_ns)
            receive(self.node, "arm/state", state)

    def send(self, *positions, frame="world", stamp_s=1.0, quaternion=(0.0, 0.0, 0.0, 1.0)) -> None:
        path = Path()
        path.header.frame_id, path.header.stamp = frame, messages.to_time(round(stamp_s * 1e9))
        path.poses = [PoseStamped(pose=messages.pose(np.array(p), np.array(quaternion))) for p in positions]
        receive(self.node, "arm/reference/path", path)

    def until(self, *states: str) -> str:
        """Tick until a report of one of these states has come; returns its message."""
        for _ in range(3000):
            if self.reports and self.reports[-1].name in states:
                return self.reports[-1].message
            self.tick()
        raise AssertionError(f"no {states} in {[report.name for report in self.reports]}")

    @property
    def states(self) -> list[str]:
        """The states in their order, each once in a row."""
        names = [report.name for report in self.reports]
        return [name for k, name in enumerate(names) if k == 0 or name != names[k - 1]]

    @property
    def wanted(self) -> np.ndarray:
        """Where the tip is wanted."""
        arm = self.node.controller.arm
        return arm.pose(self.node.state.point.q, arm.length)[:3, 3]


@contextlib.contextmanager
def controller(
    *settings: str, enabled: bool = True, mode: str = "lockstep", rest: np.ndarray | None = None
) -> Iterator[Ticked]:
    given = (
        f"mode:={mode}",
        "control.law:=adaptive",
        "control.reference.kind:=hold",
        "control.reference.start_s:=0.1",
        *settings,
    )
    middleware.init(["--ros-args", *(part for setting in given for part in ("-p", setting))])
    try:
        node = ControllerNode()
        node.trigger_configure()
        assert node.failure is None
        node.trigger_activate()
        ticked = Ticked(node, 1.0, rest)
        if mode != "lockstep":  # the node refuses stamps that are old or ahead: its time is that of the ticks
            ports = node._ticks._ports
            node._ticks._ports = replace(ports, now_ns=lambda: round(ticked.t_s * 1e9))
        if enabled:
            assert request(node, "~/enable").success
            ticked.tick(30)
        yield ticked
        node.destroy_node()
    finally:
        rclpy.shutdown()


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    from tests.soro_ros.conftest import own_domain

    with own_domain(tmp_path_factory.mktemp("state")):
        yield


@pytest.mark.slow
def test_a_path_is_followed_to_its_end_and_reported(alone):
    with controller() as it:
        goal = [0.008, 0.0, 0.066]
        it.send([0.0, 0.0, 0.066], goal)
        assert it.states == ["planning"]
        it.until("moving")
        middle = len(it.reports)
        it.send([0.0, 0.0, 0.066], goal)  # the same message again
        it.until("reached")
        assert it.states == ["planning", "moving", "reached"]
        assert it.wanted == pytest.approx(goal, abs=1e-6)
        assert len(it.reports) > middle + 3
        values = {pair.key: pair.value for pair in it.reports[-2].values}
        assert values["stamp_ns"] == "1000000000"
        assert 0.0 < float(values["passed_s"]) <= float(values["duration_s"])
        assert float(values["factor"]) == 1.0

        # In the frame of the base, with the speed of the parameter; orientations are not followed.
        start_s = it.t_s
        it.node.set_parameters([rclpy.Parameter("control.motion.speed_m_s", value=0.004)])
        it.send(goal, [0.0, 0.0, 0.066], frame="", stamp_s=2.0)
        assert it.until("reached") == ""
        assert it.t_s - start_s > 2.0
        # A refusal changes nothing.
        before = it.wanted
        for wrong in ({"frame": "camera"}, {}):
            it.send([0.3, 0.0, 0.066], stamp_s=3.0, **wrong)
            assert it.until("refused") == it.reports[-1].message
            assert it.node.diagnostics.status.level == WARN
            assert it.reports[-1].message in it.node.diagnostics.status.message
            it.tick(5)
        assert it.wanted == pytest.approx(before, abs=1e-9)


@pytest.mark.slow
def test_a_path_that_replaces_another_begins_under_way(alone):
    with controller() as it:
        it.send([0.0, 0.0, 0.066], [0.015, 0.0, 0.066])
        it.until("moving")
        it.tick(100)
        accelerations = []
        it.send([0.0, 0.01, 0.066], [0.0, 0.0, 0.066], stamp_s=2.0)
        while it.states[-1] != "reached":
            it.tick()
            accelerations.append(it.node.state.point.qdd)
        assert it.states == ["planning", "moving", "planning", "replaced", "moving", "reached"]
        assert it.wanted == pytest.approx([0.0, 0.0, 0.066], abs=1e-6)
        rows = np.array(accelerations)
        assert np.abs(np.diff(rows, axis=0)).max() < 0.15 * np.abs(rows).max()
        # One that is refused while the other goes on leaves that one alone.
        it.send([0.0, 0.0, 0.066], [0.015, 0.0, 0.066], stamp_s=3.0)
        it.until("moving")
        it.send([0.3, 0.0, 0.066], stamp_s=4.0)
        assert it.states[-1] == "refused"
        it.until("reached")
        assert it.wanted == pytest.approx([0.015, 0.0, 0.066], abs=1e-6)


def test_a_plan_goes_on_however_late_the_ticks_are(alone, monkeypatch):
    monkeypatch.setattr("soro_ros.topics.motion_topic._SHARE", -1e3)
    unchecked = ("control.check_at_enable:='off'", "control.probe_at_enable:='off'")
    with controller(*unchecked, mode="real_time") as it:
        it.send([0.0, 0.0, 0.066])
        assert it.states == ["planning"]
        it.until("moving")


def test_the_end_of_a_motion_that_is_not_reached_has_its_reason(alone):
    with controller("control.motion.settle_s:=0.1") as it:
        line = ([0.0, 0.0, 0.066], [0.01, 0.0, 0.066])
        it.follows = False
        it.send(*line, stamp_s=1.0)
        assert "motion.reached_m" in it.until("lost")
        it.follows = True
        it.send(*reversed(line), stamp_s=2.0)
        it.until("moving")
        receive(it.node, "arm/reference/tip", messages.pose_stamped(_at(0.0, 0.066), 0, "world"))
        assert it.states[-2:] == ["replaced", "moving"]
        it.tick(20)
        it.send(*line, stamp_s=3.0)
        it.until("moving")
        request(it.node, "~/vent")
        assert it.states[-1] == "vented"
        it.send(*line, stamp_s=4.0)
        assert it.states[-1] == "refused"
        assert "soro enable" in it.reports[-1].message


def test_a_turned_base_counts_in_its_own_frame(alone, tmp_path):
    from soro_core.config import find_config

    text = find_config("tue_three_bellow", "robots").read_text()
    file = tmp_path / "turned.yaml"
    file.write_text(text.replace("[0.0, 0.0, 0.0, 1.0]", str(TURNED)) + "\nbase_position: [0.1, 0.0, 0.0]\n")
    with controller(f"robot:={file}", "control.reference.rotation_weight_m:=0.0") as it:
        it.send([0.0, 0.0, 0.066], [0.008, 0.0, 0.066], frame="base", quaternion=TURNED)
        it.until("reached")
        assert it.wanted == pytest.approx([0.1, 0.008, 0.066], abs=1e-6)


def _at(x: float, z: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = x, 0.0, z
    return pose


@pytest.mark.slow
def test_a_point_behind_an_obstacle_is_reached_around_it_if_that_is_asked_for(alone, tmp_path):
    robot = TWO.replace(contacts=IN_THE_WAY.model_dump())
    save_robot(robot, tmp_path / "two.yaml")
    goal = tip(END)
    with controller(f"robot:={tmp_path / 'two.yaml'}", rest=equilibrium(ARM, START)) as it:
        it.send(goal)
        it.until("refused")
        it.node.set_parameters([rclpy.Parameter("control.motion.around", value=True)])
        it.send(goal, stamp_s=2.0)
        rows = []
        while it.reports[-1].name in ("planning", "moving", "refused"):
            assert len(rows) < 6000, it.reports[-1]
            it.tick()
            rows.append(it.node.state.point.q)
        assert it.states == ["planning", "refused", "planning", "moving", "reached"]
        assert it.wanted == pytest.approx(goal, abs=2e-4)
        assert least_clearance(np.array(rows[::5]), IN_THE_WAY) > 1.8e-3

        inside = np.array(IN_THE_WAY.spheres[0].centre)
        it.send(inside, stamp_s=3.0)
        assert re.search(r"with the tip at .*|contacts\.spheres\[0\]", it.until("refused"))
        assert it.wanted == pytest.approx(goal, abs=2e-4)
