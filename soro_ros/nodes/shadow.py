"""The shadow: a twin beside a real arm, driven by the measured pressures; it publishes their difference."""

from __future__ import annotations

import time
from collections import deque

import numpy as np
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState

from soro_core.arrays import Array
from soro_core.robot import load_robot
from soro_core.twin.config import ShadowConfig
from soro_core.twin.shadow import DIFFERENCES, PoseDifference, Shadow, ShadowState
from soro_ros.conversion import messages, qos
from soro_ros.process.lifecycle import SoroNode
from soro_ros.process.node_process import run_node
from soro_ros.topics.chambers import on_readings
from soro_ros.topics.diagnostics import OK, WARN
from soro_ros.topics.frame_check import FrameCheck

# Window of the differences in diagnostics [s], and longest time without a pose [s].
WINDOW_S, SILENT_S = 1.0, 1.0


class ShadowNode(SoroNode[ShadowConfig]):
    """Publishes the simulated state, and its difference from measured poses."""

    config_model = ShadowConfig
    node_name = "shadow"
    is_observer = True

    def setup(self, config: ShadowConfig) -> None:
        robot = self._robot = load_robot(config.robot)
        self._config, self._names = config, robot.chamber_names
        self._shadow = Shadow(robot, config)
        self._coordinates = self._shadow.twin.plant.arm.robot.coordinate_names
        self.compile(self._warm_up)
        self._state = ShadowState()
        self._waiting: deque[PoseStamped] = deque(maxlen=100)
        self._recent: deque[tuple[float, PoseDifference]] = deque()
        self._poses = self._compared = 0
        self._frames = FrameCheck(config.frames, self.get_logger().warning, self.diagnostics.refuse)
        self._pose_s = -np.inf
        self._tip = self.create_publisher(PoseStamped, "arm/shadow/tip", qos.RELIABLE)
        self._arm = self.create_publisher(JointState, "arm/shadow/state", qos.RELIABLE)
        self._difference = self.create_publisher(JointState, "arm/shadow/difference", qos.RELIABLE)
        on_readings(self, self._names, qos.SENSOR, self._on_pressures)
        self.create_subscription(PoseStamped, "sensors/pose0", self._on_pose, qos.SENSOR)

    def _warm_up(self) -> None:
        """Run one tick without output, which compiles its kernels."""
        shadow, zero = Shadow(self._robot, self._config), np.zeros(len(self._names))
        state = shadow.advance(ShadowState(), 0, zero)
        shadow.advance(state, round(1e9 / self._config.rate_hz), zero)

    def _on_pressures(self, stamp_ns: int, pressure_pa: Array) -> None:
        before = self._state.twin
        self._state = self._shadow.advance(self._state, stamp_ns, pressure_pa)
        if self._state.twin is None or self._state.twin is before:
            return
        arm = self._state.twin.arm
        nothing = np.zeros_like(arm.q)
        stamp_ns = self._state.stamp_ns
        self._arm.publish(messages.arm_state(self._coordinates, arm.q, arm.qd, nothing, stamp_ns))
        while self._waiting and messages.to_ns(self._waiting[0].header.stamp) <= stamp_ns:
            self._compare(self._waiting.popleft())

    def _on_pose(self, message: PoseStamped) -> None:
        if not self._frames.takes_sample("sensors/pose0", message.header.frame_id):
            return
        if not messages.is_pose(message.pose):
            self.get_logger().warning("sensors/pose0 refused: it is no pose", throttle_duration_sec=1.0)
            return
        self._poses += 1
        self._pose_s = time.monotonic()
        self._waiting.append(message)

    def _compare(self, message: PoseStamped) -> None:
        stamp_ns = messages.to_ns(message.header.stamp)
        simulated = self._shadow.at(self._state, stamp_ns)
        if simulated is None:
            return
        self._compared += 1
        found = self._shadow.compare(simulated, *messages.pose_arrays(message.pose))
        self._recent.append((time.monotonic(), found))
        self._tip.publish(messages.pose_stamped(simulated, stamp_ns, self._config.frames.world))
        difference = JointState(name=list(DIFFERENCES), position=found.values.tolist())
        difference.header.stamp = message.header.stamp
        self._difference.publish(difference)

    def diagnose(self) -> None:
        now = time.monotonic()
        while self._recent and self._recent[0][0] < now - WINDOW_S:
            self._recent.popleft()
        values: dict[str, object] = {
            "poses": self._poses,
            "compared": self._compared,
            "restarts": self._state.restarts,
            **self._frames.values,
        }
        if not self._recent:
            silent = now - self._pose_s > SILENT_S
            why = "no pose on sensors/pose0" if silent else "no pressures at the time of the poses"
            self.diagnostics.update(WARN, f"nothing to compare: {why}", values)
            return
        distance = np.array([found.distance_m for _, found in self._recent])
        bending = float(np.mean([found.bending_rad for _, found in self._recent]))
        values |= {
            "distance_rms_m": float(np.sqrt(np.mean(distance**2))),
            "distance_max_m": float(distance.max()),
            "bending_rad": bending,
        }
        text = f"measured {distance.mean() * 1e3:.1f} mm and {np.degrees(bending):+.1f} deg of bending off"
        far = distance.max() > self._config.tolerance_m
        self.diagnostics.update(WARN if far else OK, text, values)


def main() -> None:
    """Entry point of `ros2 run soro_ros shadow`."""
    run_node(ShadowNode)


if __name__ == "__main__":
    main()
