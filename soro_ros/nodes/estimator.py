"""The estimator node: each message on chambers/state gives one on arm/state and one on arm/tip."""

from __future__ import annotations

import math

import numpy as np
from geometry_msgs.msg import PoseArray

from soro_core.estimation import Estimator, EstimatorState
from soro_core.estimation.monitor import SensorMonitor
from soro_core.estimation.samples import imu_sensor, pose_sensor
from soro_core.scene import EstimatorNodeConfig
from soro_ros import messages, qos
from soro_ros.diagnostics import OK, WARN
from soro_ros.estimator_ticks import EstimatorTicks
from soro_ros.lifecycle import SoroNode
from soro_ros.node_process import run_node
from soro_ros.ports import Ports, Publishers, subscribe


class EstimatorNode(SoroNode[EstimatorNodeConfig]):
    """Gives the filter its messages, and draws the arm that it estimates."""

    config_model = EstimatorNodeConfig
    node_name = "estimator"

    def setup(self, config: EstimatorNodeConfig) -> None:
        self._config, lockstep, self._trouble = config, config.mode == "lockstep", ""
        loop = qos.loop(lockstep)
        outputs = {topic: (kind, loop) for topic, kind in EstimatorTicks.outputs.items()}
        publishers = Publishers(self, outputs)
        ports = Ports(publishers.publish, warn=self._warn, report=self._report, is_read=publishers.is_read)
        self._ticks = EstimatorTicks(config, ports)
        length = self.estimator.length
        places = ((pose_sensor, "pose", config.pose_locations), (imu_sensor, "imu", config.imu_locations))
        self._sensors = {
            f"{name}{k}": sensor(at * length) for sensor, name, ats in places for k, at in enumerate(ats)
        }
        self._backbone = self.create_publisher(PoseArray, "arm/backbone", 10)
        subscribe(self, self._ticks.inputs, lockstep)
        self.compile(self._ticks.warm_up)

    @property
    def estimator(self) -> Estimator:
        """The filter."""
        return self._ticks.estimator

    @property
    def state(self) -> EstimatorState | None:
        """State of the filter after the last tick; None before the first."""
        return self._ticks.state

    def start(self) -> None:
        if self._config.backbone_rate_hz > 0:
            self.every(1.0 / self._config.backbone_rate_hz, self._publish_backbone)

    def _publish_backbone(self) -> None:
        if self.state is None:
            return
        arm, q = self.estimator.arm, self.state.belief.q
        message = PoseArray(
            poses=[
                messages.pose_of(arm.pose(q, s))
                for s in np.linspace(0.0, self.estimator.length, self._config.backbone_points)
            ]
        )
        message.header.frame_id = "world"
        message.header.stamp = messages.to_time(self._ticks.epoch_ns + round(self.state.t_s * 1e9))
        self._backbone.publish(message)

    def _warn(self, line: str) -> None:
        self.get_logger().warning(line, throttle_duration_sec=1.0)

    def _report(self, trouble: str) -> None:
        """Report at once what is new; where only its numbers change, once a second is enough."""
        warns = self.diagnostics.status.level == WARN
        is_new = bool(trouble) != warns or _without_numbers(trouble) != _without_numbers(self._trouble)
        self._trouble = trouble
        if is_new:
            self.diagnostics.update(WARN if trouble else OK, trouble or "active")

    def diagnose(self) -> None:
        if self.state is None:
            return
        values = {**self.state.counts._asdict(), "malformed": self._ticks.malformed}
        for name, sensor in self._sensors.items():
            values |= _values_of(name, self.state.monitors.get(sensor))
        status = self.diagnostics.status
        text = self._trouble if status.level == WARN and self._trouble else status.message
        self.diagnostics.update(status.level, text, values)


def _without_numbers(text: str) -> str:
    return "".join(c for c in text if c not in "0123456789.")


def _values_of(name: str, monitor: SensorMonitor | None) -> dict[str, object]:
    """Return what is known of one sensor, by the name of its topic; nothing before its first sample."""
    if monitor is None:
        return {}
    values: dict[str, object] = {f"{name}/nis": monitor.nis}
    if not math.isnan(monitor.position_nis):
        values[f"{name}/position_nis"] = monitor.position_nis
    if monitor.delay is not None:
        values[f"{name}/delay_s"] = monitor.delay.delay_s
        values[f"{name}/delay_deviation_s"] = monitor.delay.deviation_s
    return values


def main() -> None:
    """Entry point of `ros2 run soro_ros estimator`."""
    run_node(EstimatorNode)


if __name__ == "__main__":
    main()
