"""What a controller node has seen of its arm before it is enabled, and what speaks against it."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Imu, JointState

from soro_core.control import Controller
from soro_core.control.enable_checks import SensorSample, pressure_findings, resting_arm
from soro_lab.scene import ControllerNodeConfig
from soro_ros.conversion import messages, qos
from soro_ros.topics.frame_check import FrameCheck

_KINDS = {"pose": PoseStamped, "imu": Imu}


class EnableCheck:
    """Keeps the latest samples of the arm; in lockstep there are none before the controller is enabled.

    Parameters
    ----------
    node : Node
        The controller node.
    controller : Controller
    config : ControllerNodeConfig
        Places of the sensors, and the bounds.
    probing : callable
        Says whether a probe goes on.
    note_pose : callable
        Takes the poses of a probe, and the names of their topics.
    """

    def __init__(
        self,
        node: Node,
        controller: Controller,
        config: ControllerNodeConfig,
        probing: Callable[[], bool],
        note_pose: Callable[[str, PoseStamped], None],
    ) -> None:
        self._node, self._controller = node, controller
        self._probing, self._note_pose = probing, note_pose
        self._mode = "off" if config.mode == "lockstep" else config.control.check_at_enable
        self._bounds = config.control.enable
        self._names, self._frames = controller.robot.chamber_names, config.frames
        self._arrived: dict[str, float] = {}  # monotonic time of the latest sample, by topic
        self._pressure_pa = np.zeros(len(self._names))
        self._raw: dict[str, bytes] = {}
        self._places: dict[str, tuple[str, float]] = {}
        if self._mode != "off":
            self._rest = resting_arm(controller)
        elif controller.probe is None:
            return
        length = controller.arm.length
        for kind, places in (("pose", config.pose_locations), ("imu", config.imu_locations)):
            for k, place in enumerate(places):
                topic = f"sensors/{kind}{k}"
                self._places[topic] = kind, place * length
                # Bytes: a sample is only read when the controller is to be enabled.
                node.create_subscription(
                    _KINDS[kind], topic, partial(self._on_sample, topic), qos.SENSOR, raw=True
                )

    def warm_up(self) -> None:
        """Run the checks once without effect: imports and compilation take longer than a tick."""
        if self._mode != "off":
            upside_down = SensorSample(
                "", self._controller.arm.length, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.ones(3)
            )
            self._rest.findings([upside_down], self._bounds)

    def note_reading(self, pressure_pa: np.ndarray) -> None:
        """Note measured pressures (n_u,) [Pa gauge]."""
        self._arrived["chambers/state"], self._pressure_pa = time.monotonic(), pressure_pa

    def note_state(self, message: JointState) -> None:
        """Note an estimate of the arm's state; an empty one is none."""
        if message.name:
            self._arrived["arm/state"] = time.monotonic()

    def findings(self, anyway: bool, between: Callable[[], None]) -> tuple[list[str], list[str]]:
        """Return lines that refuse to enable the controller, and warnings.

        Parameters
        ----------
        anyway : bool
            Only samples that are not fresh, or that nothing can be done with, refuse.
        between : callable
            Called again and again: the check takes longer than a tick.
        """
        if self._mode == "off":
            return [], []
        # A sensor from which nothing has ever come is none, although a node may offer its topic.
        sensors = [topic for topic in self._places if topic in self._raw]
        unusable = self._stale(("chambers/state", "arm/state", *sensors))
        if silent := messages.without_reading(self._pressure_pa, self._names):
            unusable.append(f"no reading of {silent}")
        frames = FrameCheck(self._frames)
        seen = [one for topic in sensors if (one := self._seen(topic, frames)) is not None]
        unusable += [frames.refusal] if frames.refusal else []
        if unusable:
            return unusable, []
        found = pressure_findings(self._names, self._pressure_pa, self._bounds)
        if seen:
            found += self._rest.findings(seen, self._bounds, between)
        beside = self._without_place()
        return ([], found + beside) if anyway or self._mode == "warn" else (found, beside)

    def _stale(self, topics: tuple[str, ...]) -> list[str]:
        lines, most = [], self._bounds.sample_age_s
        for topic in topics:
            age_s = time.monotonic() - self._arrived.get(topic, -np.inf)
            if age_s > most:
                old = (
                    f"the last sample of {topic} is {age_s:.1f} s old"
                    if np.isfinite(age_s)
                    else f"no {topic}"
                )
                lines.append(f"{old}, allowed: {most:g} s (enable.sample_age_s)")
        return lines

    def _without_place(self) -> list[str]:
        """Sensors that publish, but whose place on the arm is not known."""
        lines = []
        for kind in _KINDS:
            topic = f"sensors/{kind}{sum(known == kind for known, _ in self._places.values())}"
            if self._node.count_publishers(topic):
                lines.append(f"{topic} is not checked: {kind}_locations does not say where it is")
        return lines

    def _seen(self, topic: str, frames: FrameCheck) -> SensorSample | None:
        kind, s = self._places[topic]
        message = deserialize_message(self._raw[topic], _KINDS[kind])
        if not frames.takes_sample(topic, message.header.frame_id):
            return None
        if kind == "pose":
            position, quaternion = messages.pose_arrays(message.pose)
            return SensorSample(topic, s, position, quaternion)
        _, force, orientation = messages.imu_arrays(message)
        return SensorSample(topic, s, None, orientation, force)

    def _on_sample(self, topic: str, sample: bytes) -> None:
        self._arrived[topic], self._raw[topic] = time.monotonic(), sample
        if self._places[topic][0] == "pose" and self._probing():
            self._note_pose(topic, deserialize_message(sample, PoseStamped))
