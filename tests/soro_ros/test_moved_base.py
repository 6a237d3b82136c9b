"""Nodes in lockstep while the base of their arm tilts: estimator and controller are told where it is."""

import contextlib
from collections import deque

import numpy as np
import pytest
import rclpy
import yaml

from soro_core.errors import ConfigError
from soro_core.rotation import rotation_exp
from soro_core.run_keys import Frames
from soro_lab.scene import load_scene
from soro_ros.conversion import messages
from soro_ros.nodes.controller import ControllerNode
from soro_ros.nodes.estimator import EstimatorNode
from soro_ros.nodes.twin import TwinNode
from soro_ros.process.parameter_files import flattened
from soro_ros.topics.base_topic import BASE, ToldBase
from soro_ros.topics.frame_check import FrameCheck
from soro_ros.topics.intra_process import Reader
from tests.soro_ros.direct import request

TILT_RAD, BEGIN_S, TURN_S, END_S = np.radians(30.0), 2.0, 4.0, 9.0
CHANGES = {
    "mode": "lockstep",
    "platform": "",
    "duration_s": 20.0,
    "twin.base_by_topic": True,
    "twin.refine": 1,
    "controller.probe_at_enable": "off",
}


def tilted(t, tilt_rad=TILT_RAD):
    """Pose of a base that tilts within `TURN_S` from `BEGIN_S` on, and moves by 50 mm."""
    part = np.clip((t - BEGIN_S) / TURN_S, 0.0, 1.0)
    part = part * part * (3.0 - 2.0 * part)
    found = np.eye(4)
    found[:3, :3], found[0, 3] = rotation_exp(np.array([tilt_rad * part, 0.0, 0.0])), 0.05 * part
    return found


class Nodes:
    """Nodes of one process whose messages are handed over in their order, without the middleware."""

    def __init__(self, folder, told):
        scene = load_scene("track_circle", CHANGES)
        base = {"robot": scene.robot}
        configs = scene.twin_node(), scene.estimator_node(), scene.controller_node()
        entries = {}
        for name, config in zip(("twin", "estimator", "controller"), configs, strict=True):
            keys = flattened(config.model_dump(mode="json")) | base
            if name != "twin":
                keys["base_by_topic"] = told
            entries[f"/**/{name}"] = {
                "ros__parameters": {k: v for k, v in keys.items() if v not in (None, [])}
            }
        file = folder / "nodes.yaml"
        file.write_text(yaml.safe_dump(entries))
        rclpy.init(args=["--ros-args", "--params-file", str(file)])
        self.nodes = [EstimatorNode(), ControllerNode(), TwinNode()]
        for node in self.nodes:
            assert node.trigger_configure().name == "SUCCESS", node.failure
            node.trigger_activate()
        self.waiting, self.readers, self.last = deque(), {}, {}
        for node in self.nodes:
            for one in node.subscriptions:
                self.readers.setdefault(one.topic_name, []).append(Reader(node, one))
        for node in self.nodes:
            for publisher in node.publishers:
                publisher.publish = lambda message, topic=publisher.topic_name: self.send(topic, message)
                publisher.get_subscription_count = lambda: 1
        self.twin = self.nodes[2]

    def send(self, topic, message):
        self.last[topic] = message
        for reader in self.readers.get(topic, ()):
            self.waiting.append((reader, message))

    def begin(self):
        request(self.nodes[1], "~/enable")
        request(self.twin, "~/start")

    def ticks(self):
        """Time [s] of each tick, before which what comes from outside can be sent."""
        seen = -1
        while self.waiting:
            reader, message = self.waiting.popleft()
            reader.waiting.append(message)
            reader.take()
            if self.twin.state.tick != seen:
                seen = self.twin.state.tick
                yield 1e-9 * self.twin._tick_ns()

    def place(self, name):
        message = self.last.get(f"/{name}")
        return np.full(3, np.nan) if message is None else messages.pose_arrays(message.pose)[0]

    def send_base(self, pose, stamp_ns=0):
        self.send(f"/{BASE}", messages.pose_stamped(pose, stamp_ns, "world"))


@contextlib.contextmanager
def nodes_of(folder, told):
    try:
        found = Nodes(folder, told)
        found.begin()
        yield found
        for node in found.nodes:
            node.destroy_node()
    finally:
        rclpy.shutdown()


def error_mm(folder, told):
    """Distance of the tip from its reference on the base, once that has tilted: RMS [mm]."""
    found = []
    with nodes_of(folder, told) as nodes:
        for t in nodes.ticks():
            nodes.send_base(tilted(t))
            wanted, base = nodes.place("arm/desired/tip"), np.eye(4) if told else tilted(t)
            there = base[:3, :3] @ wanted + base[:3, 3]
            if t > BEGIN_S + TURN_S:
                found.append(there - nodes.place("truth/tip"))
            if t > END_S:
                break
    return 1e3 * np.sqrt(np.mean(np.sum(np.square(found), axis=1)))


def test_an_arm_on_a_base_that_tilts_tracks(domain, tmp_path, figure):
    told, untold = (error_mm(tmp_path, one) for one in (True, False))
    figure(f"base that tilts by 30 degrees: {told:.2f} mm told, {untold:.2f} mm untold, RMS after it")
    assert told < 2.0 < 5.0 < untold


def test_a_base_that_falls_silent_vents_with_one_line(domain, tmp_path):
    silent_s, status = 1.0, ""
    with nodes_of(tmp_path, told=True) as nodes:
        for t in nodes.ticks():
            if t < silent_s:
                nodes.send_base(tilted(t))
            if silent_s + 0.4 < t < silent_s + 0.45:
                assert nodes.last["/arm/state"].position
                assert not nodes.twin._limiter.state.cause
            if t > silent_s + 1.5:
                break
        assert not nodes.last["/arm/state"].position
        status = nodes.nodes[0].diagnostics.status.message
        assert nodes.twin._limiter.state.cause
        assert max(nodes.last["/chambers/state"].position) < 1e3
    assert status.startswith("no estimate: base/pose silent for ")
    assert status.endswith("allowed: at most 0.5 s")
    assert "\n" not in status


def test_a_base_that_jumps_stays_where_it_was_and_vents(domain, tmp_path, capfd):
    with nodes_of(tmp_path, told=True) as nodes:
        for t in nodes.ticks():
            nodes.send_base(tilted(t) if t < 1.0 else tilted(10.0, np.radians(90.0)))
            if t > 2.0:
                break
        assert nodes.twin._limiter.state.cause
    lines = [line for line in capfd.readouterr().err.splitlines() if "base/pose refused" in line]
    for name in ("estimator", "controller", "twin"):
        assert any(f"[{name}]" in line for line in lines), name
    assert all("1.57 rad from the last pose; allowed: at most 0.2 m and 0.5 rad" in line for line in lines)


def test_a_robot_that_touches_what_is_fixed_is_refused():
    robot = load_scene("contact_with_a_wall").loaded_robot
    assert robot.contacts is not None
    with pytest.raises(ConfigError, match="allowed: a robot without contacts"):
        ToldBase(robot, list, FrameCheck(Frames()), lambda: 0, print)
