"""The estimator node: each message on chambers/state gives one on arm/state, arm/tip and arm/wrench."""

from __future__ import annotations

import math

import numpy as np
from geometry_msgs.msg import PoseArray

from soro_core.estimation import Estimator, EstimatorState
from soro_core.estimation.sensors.monitor import SensorMonitor
from soro_core.estimation.sensors.samples import imu_sensor, pose_sensor
from soro_lab.scene import EstimatorNodeConfig
from soro_ros.conversion import messages, qos
from soro_ros.process.lifecycle import SoroNode
from soro_ros.process.node_process import run_node
from soro_ros.ticks.estimator_ticks import EstimatorTicks
from soro_ros.topics.diagnostics import OK, WARN
from soro_ros.topics.frame_check import FrameCheck
from soro_ros.topics.ports import NodeOutputs, Publishers, is_read, subscribe
from soro_ros.topics.transforms import ArmTransforms


class EstimatorNode(SoroNode[EstimatorNodeConfig]):
    """Gives the filter its messages, and draws the arm that it estimates."""

    config_model = EstimatorNodeConfig
    node_name = "estimator"

    def setup(self, config: EstimatorNodeConfig) -> None:
        self._config, lockstep, self._failure = config, config.mode == "lockstep", ""
        loop = qos.loop(lockstep)
        outputs = {topic: (kind, loop) for topic, kind in EstimatorTicks.outputs.items()}
        publishers = Publishers(self, outputs)
        ports = NodeOutputs(
            publishers.publish,
            warn=self._warn,
            report=self._report,
            is_read=publishers.is_read,
            estimated=self._estimated,
        )
        self._frames = FrameCheck(config.frames, self.get_logger().warning, self.diagnostics.refuse)
        self._ticks = EstimatorTicks(config, ports, self._frames)
        length = self.estimator.length
        places = ((pose_sensor, "pose", config.pose_locations), (imu_sensor, "imu", config.imu_locations))
        self._sensors = {
            f"{name}{k}": sensor(at * length) for sensor, name, ats in places for k, at in enumerate(ats)
        }
        self._backbone = self.create_publisher(PoseArray, "arm/backbone", 10)
        self._transforms = ArmTransforms(self, self.estimator.arm, config)
        rate_hz = config.backbone_rate_hz
        self._pictures = Turns(round(1e9 / rate_hz)) if rate_hz > 0 else None
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

    def _estimated(self, stamp_ns: int) -> None:
        """Draw an estimate when due, once the command that answers it has gone out.

        A timer of its own would do so when the next tick is due: that would begin a millisecond late.
        """
        if self._pictures is not None and self._pictures.is_due(stamp_ns):
            self.after_handover(self._draw)

    def _draw(self) -> None:
        """Publish the shape of the newest estimate."""
        stamp_ns = self._ticks.estimated_ns
        if self.state is None or stamp_ns is None:
            return
        arm, q = self.estimator.arm, self.state.belief.q
        if is_read(self._backbone):
            places = np.linspace(0.0, self.estimator.length, self._config.backbone_points)
            message = PoseArray(poses=[messages.pose_of(arm.pose(q, s)) for s in places])
            message.header.frame_id = self._config.frames.world
            message.header.stamp = messages.to_time(stamp_ns)
            self._backbone.publish(message)
        self._transforms.publish(q, stamp_ns)

    def _warn(self, line: str) -> None:
        self.get_logger().warning(line, throttle_duration_sec=1.0)

    def _report(self, failure: str) -> None:
        """Report at once what is new; where only its numbers change, once a second is enough."""
        warns = self.diagnostics.level == WARN
        if bool(failure) == warns and failure == self._failure:
            return
        is_new = bool(failure) != warns or _without_numbers(failure) != _without_numbers(self._failure)
        self._failure = failure
        if is_new:
            self.diagnostics.update(WARN if failure else OK, failure or "active")

    def diagnose(self) -> None:
        values: dict[str, object] = {"malformed": self._ticks.malformed, **self._frames.values}
        if self.state is not None:
            values |= self.state.counts._asdict()
            for name, sensor in self._sensors.items():
                values |= _values_of(name, self.state.monitors.get(sensor))
        if (external := self._ticks.external) is not None:
            x, y, z = 1e3 * external.force_n
            values |= {"force": f"{external.stage}: {x:.1f}, {y:.1f}, {z:.1f} mN in x, y, z"}
        level, text = self.diagnostics.level, self.diagnostics.message
        self.diagnostics.update(level, self._failure if level == WARN and self._failure else text, values)


class Turns:
    """Stamps at which something of a fixed period is due.

    Parameters
    ----------
    period_ns : int
        The period [ns].
    """

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._due_ns: int | None = None

    def is_due(self, stamp_ns: int) -> bool:
        """Whether it is due at a stamp [ns], which then counts as its turn."""
        if self._due_ns is None or abs(self._due_ns - stamp_ns) > self._period_ns:
            self._due_ns = stamp_ns  # the first, or after a gap
        if stamp_ns < self._due_ns:
            return False
        self._due_ns += self._period_ns
        return True


def _without_numbers(text: str) -> str:
    return "".join(c for c in text if c not in "0123456789.")


def _values_of(name: str, monitor: SensorMonitor | None) -> dict[str, object]:
    """Return what is known of one sensor, by the name of its topic; nothing before its first sample."""
    if monitor is None:
        return {}
    values: dict[str, object] = {
        f"{name}/nis": monitor.nis,
        f"{name}/noise": math.sqrt(monitor.noise),
        f"{name}/orientation_noise": math.sqrt(monitor.orientation_noise),
    }
    if not math.isnan(monitor.position_nis):
        values[f"{name}/position_nis"] = monitor.position_nis
    return values


def main() -> None:
    """Entry point of `ros2 run soro_ros estimator`."""
    run_node(EstimatorNode)


if __name__ == "__main__":
    main()
