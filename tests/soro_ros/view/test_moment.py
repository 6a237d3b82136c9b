"""From messages to what is shown."""

import math

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseArray

from soro_core.adaptation.external_force import ExternalForce
from soro_ros.conversion import force, messages
from soro_ros.view.moment import (
    BACKBONE,
    DIAGNOSTICS,
    LATCH,
    PRESSURES,
    STALE_S,
    TIP,
    WANTED,
    WRENCH,
    WRENCH_COVARIANCE,
    Received,
)

NAMES = ("link0/chamber0", "link0/chamber1")


@pytest.fixture
def received():
    return Received("/arm")


def pose(z):
    place = np.eye(4)
    place[2, 3] = z
    return place


def status(name, level, text, **values):
    pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
    return DiagnosticStatus(name=name, level=level, message=text, values=pairs)


def test_a_moment_has_the_newest_of_each_topic(received):
    received.take(BACKBONE, PoseArray(poses=[messages.pose_of(pose(z)) for z in (0.0, 0.1)]), 5.0)
    received.take(TIP, messages.tip_estimate(pose(0.1), np.eye(6), 0, "world"), 5.0)
    received.take(WANTED, messages.pose_stamped(pose(0.13), 0, "world"), 5.0)
    for stamp_s in (100, 102):
        state = messages.chambers(NAMES, np.array([10e3, np.nan]), stamp_s * 10**9)
        received.take(PRESSURES, state, 5.0)
    moment = received.moment(5.0)
    assert moment.t_s == 2.0
    assert moment.backbone.shape == (2, 4, 4)
    assert moment.backbone[1] == pytest.approx(pose(0.1))
    assert moment.error_m == pytest.approx(0.03)
    assert moment.pressure["link0/chamber0"] == 10e3
    assert math.isnan(moment.pressure["link0/chamber1"])  # of a silent device


def test_the_force_on_the_tip_and_its_stage_are_shown_while_they_come(received):
    pushed = ExternalForce(np.array([0.1, 0.0, -0.02]), 1e-6 * np.eye(3), "contact", mass_free=False)
    received.take(WRENCH, force.wrench(pushed.force_n, 0, "world"), 5.0)
    received.take(WRENCH_COVARIANCE, force.covariance(pushed, 0), 5.0)
    assert received.moment(5.0).force == pytest.approx(pushed.force_n)
    assert received.moment(5.0).stage == "contact"
    later = received.moment(5.1 + STALE_S)
    assert (later.force, later.stage) == (None, "")
    received.take(WRENCH, force.wrench([math.nan, 0.0, 0.0], 0, "world"), 7.0)
    received.take(WRENCH_COVARIANCE, messages.arm_state(["stage"], [3.5], [], [], 0), 7.0)
    assert (received.moment(7.0).force, received.moment(7.0).stage) == (None, "")


def test_a_run_that_begins_anew_has_a_new_time(received):
    for stamp_s, t_s in ((100, 0.0), (102, 2.0), (0, 0.0), (1, 1.0)):
        received.take(PRESSURES, messages.chambers(NAMES, np.zeros(2), stamp_s * 10**9), 5.0)
        assert received.moment(5.0).t_s == t_s


def test_what_has_stopped_is_not_shown_any_more(received):
    received.take(TIP, messages.tip_estimate(pose(0.1), np.eye(6), 0, "world"), 5.0)
    received.take(PRESSURES, messages.chambers(NAMES, np.zeros(2), 0), 5.0)
    assert received.moment(5.0 + STALE_S).tip is not None
    later = received.moment(5.1 + STALE_S)
    assert (later.tip, dict(later.pressure)) == (None, {})
    assert math.isnan(later.error_m)


def test_the_latch_and_its_cause_are_those_of_the_topic_or_of_the_diagnostics(received):
    assert received.moment(0.0).latched is None
    received.take(PRESSURES, messages.chambers(NAMES, np.zeros(2), 0), 0.0)
    assert (received.moment(0.0).latched, received.moment(0.0).valves) == (False, "open")
    vented = status("/arm/regulator", DiagnosticStatus.ERROR, "vented: command lost")
    received.take(DIAGNOSTICS, DiagnosticArray(status=[vented]), 0.0)
    assert (received.moment(0.0).latched, received.moment(0.0).valves) == (True, "vented: command lost")
    received.take(LATCH, status("/arm/regulator", DiagnosticStatus.OK, "open", latched="false"), 0.0)
    assert (received.moment(0.0).latched, received.moment(0.0).valves) == (False, "open")
    gone = received.moment(9.0)  # the driver: its readings have ended
    assert (gone.latched, gone.valves) == (None, "not known: no readings for 9 s")
    received.take(LATCH, status("/arm/regulator", DiagnosticStatus.ERROR, "vented: high pressure"), 0.0)
    assert (received.moment(99.0).latched, received.moment(99.0).valves) == (True, "vented: high pressure")


@pytest.mark.parametrize("bad", [np.nan, 0.0])
def test_a_message_that_is_no_pose_is_not_drawn(received, bad):
    array = PoseArray(poses=[messages.pose_of(pose(0.1)), messages.pose_of(pose(0.2))])
    received.take(BACKBONE, array, 0.0)
    assert received.moment(0.0).backbone is not None
    o = array.poses[1].orientation
    o.x = o.y = o.z = o.w = bad
    assert received.moment(0.0).backbone is None


def test_faults_are_those_of_this_arm_and_a_node_that_falls_silent_is_one(received):
    nodes = [
        status("/arm/estimator", DiagnosticStatus.WARN, "estimator: no sample", lifecycle="active"),
        status("/arm/recorder", DiagnosticStatus.OK, "finished", lifecycle="finalized"),
        status("/arm/twin", DiagnosticStatus.OK, "active", lifecycle="active"),
        status("/arm2/twin", DiagnosticStatus.ERROR, "of another arm"),
    ]
    received.take(DIAGNOSTICS, DiagnosticArray(status=nodes), 10.0)
    assert received.moment(10.0).faults == ("estimator: no sample",)
    assert received.moment(17.0).faults == ("estimator: silent for 7 s", "twin: silent for 7 s")
