"""arm/covariance and arm/learned: what they carry, and who waits for them in lockstep."""

import math

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Float64MultiArray

from soro_core.adaptation import Learned
from soro_core.adaptation.external_force import ExternalForce
from soro_core.adaptation.learner import Learner
from soro_core.control.laws import Certainty
from soro_core.control.nonuniform_strain import NonuniformStrain
from soro_ros.conversion import learning, messages
from soro_ros.nodes.controller import ControllerNode
from soro_ros.nodes.estimator import EstimatorNode
from soro_ros.topics.diagnostics import OK, WARN
from tests.soro_ros.direct import active, captured, fire, receive, request, values

CHAMBERS = ("link0/chamber0", "link0/chamber1", "link0/chamber2")
COORDINATES = ("link0/elongation", "link0/bending_x", "link0/bending_y")
TICK_NS = 5_000_000
LATE_NS = 1_800_000_000_123_456_789  # more digits than a float has
THETA = np.concatenate([[0.02], 0.01 * np.arange(14)])
P = np.diag([1e-3, 0.1, 0.1, 1.0, 10.0, 10.0]) ** 2


def stamp(message):
    return messages.to_ns(message.header.stamp)


def reading(stamp_ns):
    return messages.chambers(CHAMBERS, np.full(3, 1e4), stamp_ns)


@pytest.mark.parametrize("stamp_ns", [0, TICK_NS, LATE_NS])
def test_messages_carry_stamp_and_values_to_the_bit(stamp_ns):
    there = learning.learned(Learned(THETA), stamp_ns)
    assert stamp(there) == stamp_ns
    assert learning.learned_of(there).theta.tobytes() == THETA.tobytes()
    for positions, covariance in ((True, P), (False, P), (True, P * 2e6 / P.max())):  # (1/m/s)^2 at a fall
        found = learning.certainty_of(learning.covariance(Certainty(covariance, positions), stamp_ns), 3)
        assert found.covariance.tobytes() == covariance.tobytes()
        assert found.positions is positions
    whole = Learned(THETA, own=0.5 * THETA, doubt=np.arange(9.0).reshape(3, 3))
    found = learning.learned_of(learning.learned(whole, stamp_ns))
    assert (found.own.tobytes(), found.doubt.tobytes()) == (whole.own.tobytes(), whole.doubt.tobytes())
    assert found.doubt.shape == (3, 3)
    for stage, mass_free in (("free", True), ("outside force", True), ("contact", False)):
        force, covariance = np.array([0.1, 0.0, -0.02]), np.diag([1e-6, 2e-6, 5e-3])
        pushed = ExternalForce(force, covariance, stage, mass_free, None if mass_free else 0.1 * force)
        there = learning.covariance(Certainty(P, True, pushed), stamp_ns)
        found = learning.certainty_of(there, 3).external
        assert (found.stage, found.mass_free) == (stage, mass_free)
        assert found.force_n.tobytes() == pushed.force_n.tobytes()
        assert found.covariance.tobytes() == pushed.covariance.tobytes()
        assert (found.tip is None) if mass_free else found.tip.tobytes() == pushed.tip.tobytes()
    there.velocity[0] = math.nan
    assert learning.certainty_of(there, 3) is None
    there.velocity[0], there.effort[4] = 0.0, math.nan
    assert learning.certainty_of(there, 3) is None
    assert learning.learned_of(learning.learned(None, stamp_ns)) is None
    assert learning.certainty_of(learning.covariance(None, stamp_ns), 3) is None
    assert learning.certainty_of(learning.covariance(Certainty(P, True), 0), 4) is None


@pytest.mark.parametrize("data", [[], [1.0], [np.nan, 0.0], [1.0, 1e308], [2.0**31, 0.0]])
def test_a_message_of_an_old_bag_without_a_time_is_refused(data):
    with pytest.raises(ValueError, match="no time"):
        learning.from_array(Float64MultiArray(data=data))


def test_in_lockstep_the_estimator_waits_for_what_its_last_tick_has_taught(domain):
    with active(EstimatorNode, "mode:=lockstep", "learned:=true") as node:
        sent = captured(node, "arm/covariance")
        for k in range(3):
            receive(node, "chambers/state", reading(k * TICK_NS))
        assert [stamp(one) for one in sent] == [0]
        receive(node, "arm/learned", learning.learned(None, 7))  # of another tick
        assert len(sent) == 1
        receive(node, "arm/learned", learning.learned(None, 0))
        assert [stamp(one) for one in sent] == [0, TICK_NS]
        receive(node, "arm/learned", learning.learned(Learned(THETA), TICK_NS))
        assert len(sent) == 3


def test_without_a_law_that_learns_it_waits_for_nothing(domain):
    with active(EstimatorNode, "mode:=lockstep") as node:
        sent = captured(node, "arm/covariance")
        for k in range(3):
            receive(node, "chambers/state", reading(k * TICK_NS))
        assert len(sent) == 3


def test_a_learned_force_that_stops_is_reported(domain):
    levels, upright = [], np.eye(4)
    upright[2, 3] = 0.064
    with active(EstimatorNode) as node:
        for k in range(80):
            stamp_ns = k * TICK_NS
            receive(node, "sensors/pose0", messages.pose_stamped(upright, stamp_ns, "world"))
            receive(node, "chambers/state", messages.chambers(CHAMBERS, np.zeros(3), stamp_ns))
            if k < 40:
                receive(node, "arm/learned", learning.learned(Learned(THETA), stamp_ns))
            levels.append(node.diagnostics.status.level)
    assert set(levels[2:60]) == {OK}  # the learned force of the last message still counts for 0.1 s
    assert levels[-1] == WARN


def upright(node, k):
    """A pose of the straight arm."""
    message = PoseStamped()
    message.header.stamp = messages.to_time(k * TICK_NS)
    true = node.estimator.arm.pose(np.zeros(3), node.estimator.length)
    message.pose = messages.pose_of(true)
    return message


def test_trouble_that_follows_other_trouble_is_shown(domain):
    """Learned force and poses stop at once: first one is missed, then the other; the level stays."""
    with active(EstimatorNode) as node:
        shown = []
        for k in range(1, 120):
            if k < 40:
                receive(node, "sensors/pose0", upright(node, k))
                receive(node, "arm/learned", learning.learned(Learned(THETA), k * TICK_NS))
            receive(node, "chambers/state", messages.chambers(CHAMBERS, np.zeros(3), k * TICK_NS))
            shown.append((node.diagnostics.status.level, node.diagnostics.status.message))
        (active_at,) = {one for one in shown[10:35] if one[0] == OK}
        first, second = (one for one in dict.fromkeys(shown[40:]) if one != active_at)
        assert first[0] == second[0] == WARN
        assert "learned" in first[1]
        assert "sample" in second[1]
        # Their numbers follow once a second, not at each tick.
        fire(node, 1.0)
        assert node.diagnostics.status.message != second[1]
        assert "sample" in node.diagnostics.status.message


def test_nis_and_noise_of_each_sensor_are_live(domain):
    with active(EstimatorNode, "pose_locations:=[0.5, 1.0]", "imu_locations:=[1.0]") as node:
        fire(node, 1.0)
        assert not any("nis" in name for name in values(node))
        for k in range(1, 60):
            receive(node, "sensors/pose1", upright(node, k))
            receive(node, "chambers/state", messages.chambers(CHAMBERS, np.zeros(3), k * TICK_NS))
        fire(node, 1.0)
        found = {name: float(value) for name, value in values(node).items() if name.startswith("pose1/")}
        (monitor,) = node.state.monitors.values()
        assert found == pytest.approx(
            {
                "pose1/nis": monitor.nis,
                "pose1/position_nis": monitor.position_nis,
                "pose1/noise": np.sqrt(monitor.noise),
                "pose1/orientation_noise": np.sqrt(monitor.orientation_noise),
            },
            rel=1e-5,
        )
        # A sensor without samples has no values.
        assert not any(name.startswith(("pose0/", "imu0/")) for name in values(node))


def test_in_lockstep_a_controller_that_learns_waits_for_the_covariance(domain):
    with active(ControllerNode, "mode:=lockstep", "control.law:=composite", "enabled:=true") as node:
        sent = {
            topic: captured(node, topic) for topic in ("chambers/command", "arm/learned", "controller/terms")
        }
        zero = np.zeros(3)
        state = messages.arm_state(COORDINATES, zero, zero, zero, TICK_NS)
        receive(node, "chambers/state", reading(TICK_NS))
        receive(node, "arm/state", state)
        receive(node, "arm/covariance", learning.covariance(Certainty(P, True), 0))
        assert not sent["chambers/command"]
        receive(node, "arm/covariance", learning.covariance(Certainty(P, True), TICK_NS))
        assert len(sent["chambers/command"]) == len(sent["arm/learned"]) == 1
        assert stamp(sent["arm/learned"][0]) == TICK_NS
        assert learning.learned_of(sent["arm/learned"][0]).theta.shape == THETA.shape
        assert "link0/elongation/model" in sent["controller/terms"][0].name
        # Not enabled it still answers, or the estimator would wait for ever.
        request(node, "~/vent")
        receive(node, "chambers/state", reading(2 * TICK_NS))
        receive(node, "arm/covariance", learning.covariance(None, 2 * TICK_NS))
        receive(node, "arm/state", messages.arm_state(COORDINATES, zero, zero, zero, 2 * TICK_NS))
        assert stamp(sent["arm/learned"][1]) == 2 * TICK_NS
        assert learning.learned_of(sent["arm/learned"][1]) is None


def test_what_is_learned_is_told_again_before_the_filter_forgets_it(domain):
    fixed = "control.adapt:=false", "control.law_options.nonuniform_strain:=false"
    with active(ControllerNode, "control.law:=composite", "enabled:=true", *fixed) as node:
        sent, zero = captured(node, "arm/learned"), np.zeros(3)
        first_ns = node.get_clock().now().nanoseconds
        for k in range(20):
            stamp_ns = first_ns + k * TICK_NS
            receive(node, "chambers/state", messages.chambers(CHAMBERS, zero, stamp_ns))
            receive(node, "arm/covariance", learning.covariance(Certainty(P, True), stamp_ns))
            receive(node, "arm/state", messages.arm_state(COORDINATES, zero, zero, zero, stamp_ns))
    told_s = [(stamp(message) - first_ns) * 1e-9 for message in sent]
    assert told_s == pytest.approx([0.0, 0.025, 0.050, 0.075], abs=1e-6)


@pytest.mark.parametrize("rate_hz", [200.0, 1000.0])
def test_before_its_first_tick_a_controller_has_learned_and_bent_once(domain, monkeypatch, rate_hz):
    """What runs for the first time in the loop is compiled there, for longer than a watchdog waits."""
    called = []
    for owner in (Learner, NonuniformStrain):
        step = owner.step
        monkeypatch.setattr(
            owner, "step", lambda self, *given, step=step: (called.append(type(self)), step(self, *given))[1]
        )
    with active(ControllerNode, "control.law:=composite", f"rate_hz:={rate_hz}"):
        assert set(called) == {Learner, NonuniformStrain}


def test_keys_of_a_law_reach_the_node(domain):
    with active(ControllerNode, "control.law:=composite", "control.law_options.forget_s:=3.0") as node:
        assert node.controller.law.learner.config.forget_s == 3.0
    rclpy.init(args=["--ros-args", "-p", "control.law:=composite", "-p", "control.law_options.forget:=3.0"])
    try:
        node = ControllerNode()
        assert node.trigger_configure().name == "FAILURE"
        assert node.failure.key == "control.law_options.forget"
        node.destroy_node()
    finally:
        rclpy.shutdown()
