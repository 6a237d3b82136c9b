"""The angle of a measured joint: what the controller makes of one that is late, missing or no number."""

import math

import numpy as np
import pytest
from sensor_msgs.msg import JointState

from soro_core.config import with_changes
from soro_lab.scene import load_scene
from soro_ros.conversion import messages
from soro_ros.recordings.recording import read
from soro_ros.recordings.replay import replay
from soro_ros.ticks.controller_ticks import ControllerTicks
from soro_ros.topics.ports import NodeOutputs
from tests.soro_ros.running import run, summary

JOINT, TICK_NS = "bodies/hand/joint", 5_000_000


class Bench:
    """The work of a controller of the scene `exoskeleton`, and what it has published and said."""

    def __init__(self, mode):
        scene = load_scene("exoskeleton", {"mode": mode})
        self.commands, self.said, self.now_ns = [], "", 0
        ports = NodeOutputs(self._publish, now_ns=lambda: self.now_ns, report=self._say)
        config = with_changes(scene.controller_node(), enabled=True)
        self.ticks = ControllerTicks(config, "/exoskeleton/controller", ports)
        self.coordinates = scene.loaded_robot.coordinate_names

    def _publish(self, topic, message):
        if topic == "chambers/command":
            self.commands.append(message)

    def _say(self, text):
        self.said = text

    def angle(self, angle_rad, stamp_ns=None):
        stamp = messages.to_time(self.now_ns if stamp_ns is None else stamp_ns)
        message = JointState(name=["hand"], position=[] if angle_rad is None else [angle_rad])
        message.header.stamp = stamp
        self.ticks.inputs[JOINT].take(message)

    def estimate(self):
        """Readings and state of now; return the number of new commands that ask for something."""
        before, still = len(self.commands), np.zeros(2)
        self.ticks.inputs["chambers/state"].take(
            messages.chambers(["link0/chamber0"], np.array([40e3]), self.now_ns)
        )
        self.ticks.inputs["arm/state"].take(
            messages.arm_state(self.coordinates, still, still, still, self.now_ns)
        )
        return sum(bool(one.name) for one in self.commands[before:])


@pytest.fixture
def bench():
    made = Bench("real_time")
    made.now_ns = 10**9
    return made


def test_without_an_angle_there_is_no_command(bench):
    assert bench.estimate() == 0
    assert bench.said == f"no command: {JOINT} has not come yet"


@pytest.mark.parametrize("angle", [math.nan, math.inf, 1e6, None])
def test_an_angle_that_is_none_ends_the_commands(bench, angle):
    bench.angle(0.1)
    assert bench.estimate() == 1
    bench.now_ns += TICK_NS
    bench.angle(angle)
    assert bench.estimate() == 0
    assert f"{JOINT} has no angle" in bench.said
    bench.now_ns += TICK_NS
    bench.angle(0.1)
    assert bench.estimate() == 1


def test_an_angle_that_is_old_ends_the_commands(bench):
    bench.angle(0.1)
    assert bench.estimate() == 1
    bench.now_ns += round(0.09e9)
    assert bench.estimate() == 1
    bench.now_ns += round(0.02e9)
    assert bench.estimate() == 0
    assert f"{JOINT} is 0.110 s old" in bench.said


def test_in_lockstep_a_tick_waits_for_its_angle():
    bench = Bench("lockstep")
    for tick in range(1, 4):
        bench.now_ns = tick * TICK_NS
        bench.angle(0.1, bench.now_ns - TICK_NS)  # it is a tick late
        bench.estimate()
        stamps = [messages.to_ns(one.header.stamp) for one in bench.commands]
        assert stamps == [TICK_NS * one for one in range(1, tick)]


def test_in_lockstep_no_angle_is_lost_that_comes_long_before_its_state():
    """As in a bag, whose recorder has its own order of topics."""
    bench, ticks = Bench("lockstep"), range(1, 301)
    for tick in ticks:
        bench.angle(0.1, tick * TICK_NS)
    for tick in ticks:
        bench.now_ns = tick * TICK_NS
        bench.estimate()
    assert [messages.to_ns(one.header.stamp) for one in bench.commands] == [k * TICK_NS for k in ticks]


@pytest.mark.process
def test_the_exoskeleton_bears_a_hand_and_says_what_is_left(domain, tmp_path):
    status, output, folder = run(
        tmp_path / "runs",
        "mode=lockstep",
        "duration_s=9",
        "bodies.hand.mass=0.5",
        "controller.joint=/exoskeleton/bodies/hand/joint",
        scene="exoskeleton",
    )
    found = summary(folder)
    assert (status, found["verdict"]) == (0, "good"), output
    hand = found["bodies"]["hand"]
    assert hand["effort_part"] < 0.15
    assert 0.01 < hand["effort_n_m"] < 0.06
    joint = read(folder, "exoskeleton").joint
    assert joint.names == ("hand", "effort")
    turned = (joint.t > 4.0) & (joint.t < 9.0)
    assert np.ptp(joint.value[turned, 0]) == pytest.approx(2.0 * 0.52, abs=0.06)
    assert np.sqrt(np.mean(joint.value[turned, 1] ** 2)) == pytest.approx(hand["effort_n_m"], rel=0.2)
    again = replay(folder / "bag", load_scene(folder / "scene_used.yaml"))
    assert again.same, [(one.topic, str(one.first)) for one in again.topics if one.differing]
    assert again.without == ()


@pytest.mark.process
def test_a_wearer_who_does_not_relax_is_told_so_and_the_arm_is_vented(domain, tmp_path):
    drive = "{at_s: [0.0, 1.0], angle_rad: [0.3, 0.3]}"
    changes = "mode=lockstep", "duration_s=6", f"bodies.hand.hinge.drive={drive}"
    status, output, folder = run(tmp_path / "runs", *changes, scene="exoskeleton")
    found = summary(folder)
    assert (status, found["verdict"]) == (1, "vented"), output
    assert "rad off level while it was weighed" in found["reason"]
