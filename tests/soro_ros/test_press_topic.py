"""A press on the topic of a controller in the test's own process, and what it reports of it."""

import contextlib
import re

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped

from soro_core.adaptation.external_force import ExternalForce
from soro_core.control.laws import Certainty
from soro_ros.conversion import learning, messages
from tests.soro_ros.direct import receive
from tests.soro_ros.test_motion_topic import CHAMBERS, NAMES, Ticked, controller


class Wall(Ticked):
    """An arm whose tip follows its reference up to a wall, and presses on it with the controller's push."""

    wall_m, felt_n, drift_n, is_blind = 0.002, 0.0, 0.0, False

    def tick(self, times=1):
        arm = self.node.controller.arm
        for _ in range(times):
            self.t_s += 5e-3
            stamp_ns, point, state = round(self.t_s * 1e9), self.node.state.point, self.node.state.force
            q = np.zeros(3) if point is None else point.q
            x = arm.pose(q, arm.length)[0, 3]
            pressed = state.wanted_n if state.phase == "contact" else 9.0 * max(x - self.wall_m, 0.0)
            self.felt_n += 0.05 * (pressed - self.felt_n)
            receive(self.node, "chambers/state", messages.chambers(CHAMBERS, np.zeros(3), stamp_ns))
            force = ExternalForce(np.array([-self.felt_n - self.drift_n, 0.0, 0.0]), 1e-8 * np.eye(3))
            certain = Certainty(1e-8 * np.eye(6), True, None if self.is_blind else force)
            receive(self.node, "arm/covariance", learning.covariance(certain, stamp_ns))
            receive(self.node, "arm/state", messages.arm_state(NAMES, q, np.zeros(3), np.zeros(3), stamp_ns))

    def press(self, *force_n, frame="world", torque=0.0, stamp_s=1.0):
        message = WrenchStamped()
        message.header.frame_id, message.header.stamp = frame, messages.to_time(round(stamp_s * 1e9))
        force = message.wrench.force
        force.x, force.y, force.z = force_n
        message.wrench.torque.z = torque
        receive(self.node, "arm/reference/wrench", message)

    @property
    def x_m(self):
        return self.wanted[0]


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    from tests.soro_ros.conftest import own_domain

    with own_domain(tmp_path_factory.mktemp("state")):
        yield


@contextlib.contextmanager
def wall(*settings, **keys):
    with controller(*settings, **keys) as it:
        it.__class__ = Wall
        it.tick(5)
        yield it


@pytest.mark.slow
def test_a_press_approaches_holds_and_releases(alone):
    with wall("control.force.approach_speed_m_s:=0.01") as it:
        it.press(0.03, 0.0, 0.0)
        assert re.fullmatch(r"presses with (29|30)\.\d mN", it.until("reached"))
        words = [report.message for report in it.reports]
        assert it.states == ["moving", "reached"]
        assert "approaches" in words
        assert words.index("approaches") < words.index("in contact")
        values = {pair.key: float(pair.value) for pair in it.reports[-1].values if pair.key.endswith("_n")}
        assert values == {"force_n": pytest.approx(0.03, abs=0.0015), "goal_n": 0.03}
        it.press(0.05, 0.0, 0.0, stamp_s=2.0)  # goes on
        assert it.node.state.force.phase == "contact"
        assert re.fullmatch(r"presses with (49|50)\.\d mN", it.until("reached"))
        it.press(0.0, 0.0, 0.0, stamp_s=3.0)
        assert it.until("reached") == ""
        it.tick(300)
        assert it.x_m == pytest.approx(0.0, abs=1e-4)
        assert not it.node.state.force.push_n.any()


def test_a_tip_that_meets_nothing_stops_and_says_so(alone):
    with wall("control.force.approach_s:=0.5", "control.force.approach_speed_m_s:=0.01") as it:
        it.wall_m = 1.0
        it.press(0.03, 0.0, 0.0)
        assert "no contact within 0.5 s" in it.until("lost")
        x = it.x_m
        assert x == pytest.approx(0.005, abs=2e-4)
        it.tick(100)
        assert it.x_m == pytest.approx(x, abs=1e-9)
        assert not it.node.state.force.push_n.any()


@pytest.mark.slow
def test_the_same_press_begins_anew_after_no_contact_but_not_by_a_stream(alone):
    with wall("control.force.approach_s:=0.5", "control.force.approach_speed_m_s:=0.01") as it:
        it.wall_m = 1.0
        it.press(0.03, 0.0, 0.0)
        it.until("lost")
        x = it.x_m
        for k in range(8):
            it.tick(40)
            it.press(0.03, 0.0, 0.0, stamp_s=2.0 + k)
        assert it.x_m == pytest.approx(x, abs=1e-9)
        assert "no contact within 0.5 s" in it.reports[-1].message
        assert it.reports[-1].name == "lost"
        it.tick(250)
        it.wall_m = x + 0.002
        it.press(0.03, 0.0, 0.0, stamp_s=20.0)
        assert it.reports[-1].name == "moving"
        it.until("reached")


@pytest.mark.slow
def test_a_short_gap_of_the_estimate_does_not_end_a_press(alone):
    with wall("control.force.approach_speed_m_s:=0.01") as it:
        it.press(0.03, 0.0, 0.0)
        it.until("reached")
        it.is_blind = True
        it.tick(40)
        assert it.node.state.force.wanted_n == pytest.approx(0.03, abs=1e-4)
        it.is_blind = False
        it.tick(100)
        assert it.states[-1] == "reached"
        it.is_blind = True
        assert "no estimate of the force" in it.until("lost")
        it.tick(400)
        assert not it.node.state.force.push_n.any()


def test_a_force_that_is_lost_is_said(alone):
    with wall("control.force.approach_speed_m_s:=0.01", "control.force.approach_s:=1.0") as it:
        it.press(0.03, 0.0, 0.0)
        it.until("reached")
        it.drift_n = -0.03  # as if the wall were gone
        assert "wanted: 30 mN" in it.until("lost")


@pytest.mark.parametrize(
    ("settings", "force", "keys", "names"),
    [
        ((), (0.1, 0.0, 0.0), {"frame": "optitrack"}, ("header.frame_id", "optitrack", "world", "base")),
        ((), (0.1, 0.0, 0.0), {"torque": 0.1}, ("wrench.torque",)),
        ((), (np.nan, 0.0, 0.0), {}, ("force", "finite")),
        ((), (0.0, 0.0, 0.0), {}, ("releases",)),
        ((), (3.0, 0.0, 0.0), {}, ("link0/chamber", "kPa")),
        (("control.force.cap_n:=0.05",), (0.1, 0.0, 0.0), {}, ("cap", "50 mN")),
    ],
)
def test_a_press_that_cannot_be_is_refused_in_one_line_and_nothing_moves(alone, settings, force, keys, names):
    with wall(*settings) as it:
        before = it.wanted
        it.press(*force, **keys)
        (report,) = it.reports
        assert report.name == "refused"
        assert "\n" not in report.message
        assert all(name in report.message for name in names), report.message
        it.tick(50)
        assert it.wanted == pytest.approx(before, abs=1e-12)
