"""The estimator node: each message on chambers/state gives one on arm/state and one on arm/tip."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from soro_core.adaptation import Learned
from soro_core.adaptation.learned import size_of
from soro_core.estimation import EstimatorState, ImuSample, PoseSample
from soro_core.estimation.monitor import SensorMonitor
from soro_core.estimation.samples import imu_sensor, pose_sensor
from soro_core.loop import certainty_of, estimator_of
from soro_core.robot import load_robot
from soro_core.scene import EstimatorNodeConfig
from soro_ros import learning, messages, qos
from soro_ros.diagnostics import OK, WARN
from soro_ros.lifecycle import SoroNode
from soro_ros.node_process import run_node
from soro_ros.sample_inputs import SampleInputs


class EstimatorNode(SoroNode[EstimatorNodeConfig]):
    """Runs the filter at each chambers/state; in lockstep it first waits for the samples of that tick."""

    config_model = EstimatorNodeConfig
    node_name = "estimator"

    def setup(self, config: EstimatorNodeConfig) -> None:
        robot = load_robot(config.robot)
        self._config, self._lockstep = config, config.mode == "lockstep"
        self.estimator = estimator_of(config, robot)
        self._names, self._coordinates = robot.chamber_names, self.estimator.arm.robot.coordinate_names
        self.state: EstimatorState | None = None
        self._epoch_ns = 0
        self._malformed, self._trouble = 0, ""
        self._pressures: deque[tuple[int, np.ndarray]] = deque(maxlen=1000)
        poses = [f"pose{k}" for k in range(len(config.pose_locations))]
        imus = [f"imu{k}" for k in range(len(config.imu_locations))]
        length = self.estimator.length
        self._sensors = {
            **{n: pose_sensor(at * length) for n, at in zip(poses, config.pose_locations, strict=True)},
            **{n: imu_sensor(at * length) for n, at in zip(imus, config.imu_locations, strict=True)},
        }
        loop, sensor = qos.loop(self._lockstep), qos.sensor(self._lockstep)
        self._learned: Learned | None = None
        self._awaited_ns: int | None = None  # in lockstep: the tick whose learned model has not come yet
        self._covariance = self.create_publisher(Float64MultiArray, "arm/covariance", loop)
        self.create_subscription(Float64MultiArray, "arm/learned", self._on_learned, loop)
        self._arm_state = self.create_publisher(JointState, "arm/state", loop)
        self._tip = self.create_publisher(PoseWithCovarianceStamped, "arm/tip", loop)
        self._backbone = self.create_publisher(PoseArray, "arm/backbone", 10)
        self.create_subscription(JointState, "chambers/state", self._on_pressures, sensor)
        self._samples = SampleInputs(self, config, length, self._seconds, self._process)
        self.compile(self._warm_up)

    def start(self) -> None:
        if self._config.backbone_rate_hz > 0:
            self.every(1.0 / self._config.backbone_rate_hz, self._publish_backbone)

    def _warm_up(self) -> None:
        """Run ticks without output, with a learned force too, which compiles their kernels."""
        estimator, dt = self.estimator, 0.005
        zero, nothing = np.zeros(len(self._names)), Learned(np.zeros(size_of(estimator.arm.n_q)))
        pose = estimator.arm.pose(np.zeros(estimator.arm.n_q), estimator.length)
        quaternion = np.array(_quaternion(pose))
        state = estimator.initial_state()
        for k in range(1, 60):  # until the filter is sure of the arm, and the watch estimates the delay
            sample = PoseSample(k * dt, pose[:3, 3], quaternion, estimator.length)
            poses = [sample] if k % 8 else []  # a tick without a sample has a kernel of its own
            imu = ImuSample(k * dt, np.zeros(3), np.array([0.0, 0.0, 9.81]), None, estimator.length)
            learned = nothing if k > 1 else None
            state, _ = estimator.step(state, zero, poses, [imu] if k % 8 == 1 else [], dt, learned)

    # Inputs ----------------------------------------------------------------------------------------
    def _on_learned(self, message: Float64MultiArray) -> None:
        self._learned = learning.learned_of(message)
        if learning.stamp_ns(message) == self._awaited_ns:
            self._awaited_ns = None
        self._process()

    def _on_pressures(self, message: JointState) -> None:
        try:
            pressure = messages.pressures(message, self._names)
        except ValueError as error:
            self._malformed += 1
            self.get_logger().warning(f"chambers/state refused: {error}", throttle_duration_sec=1.0)
            return
        self._pressures.append((messages.to_ns(message.header.stamp), pressure))
        self._process(new_pressure=True)

    # One step --------------------------------------------------------------------------------------
    def _process(self, new_pressure: bool = False) -> None:
        if not self._lockstep and not new_pressure:
            return  # in real time a sample waits for the next tick
        while self._pressures:
            stamp_ns, pressure = self._pressures[0]
            tick = round(stamp_ns * 1e-9 * self._config.rate_hz)
            if self._lockstep and (self._awaited_ns is not None or not self._samples.complete(tick)):
                return
            self._pressures.popleft()
            due = [sample for found in self._samples.due(tick).values() for sample in found]
            poses = [sample for sample in due if isinstance(sample, PoseSample)]
            imus = [sample for sample in due if isinstance(sample, ImuSample)]
            self._step(stamp_ns, pressure, poses, imus)

    def _step(
        self, stamp_ns: int, pressure: np.ndarray, poses: list[PoseSample], imus: list[ImuSample]
    ) -> None:
        if self.state is None:
            self._epoch_ns = 0 if self._lockstep else stamp_ns
            self.state = self.estimator.initial_state(self._seconds(stamp_ns), pressure_pa=pressure)
            self._await(stamp_ns)
            self._covariance.publish(learning.covariance(None, stamp_ns))
            self._publish_nothing(stamp_ns)
            return
        dt = self._seconds(stamp_ns) - self.state.t_s
        learned, self._learned = self._learned, None
        self.state, estimate = self.estimator.step(self.state, pressure, poses, imus, dt, learned)
        self._report(estimate.status.message or estimate.status.note)
        self._await(stamp_ns)
        self._covariance.publish(learning.covariance(certainty_of(estimate), stamp_ns))
        if not estimate.status.ok:
            self._publish_nothing(stamp_ns)
            return
        self._arm_state.publish(
            messages.arm_state(self._coordinates, estimate.q, estimate.qd, estimate.force, stamp_ns)
        )
        self._tip.publish(
            messages.tip_estimate(estimate.tip_pose, estimate.tip_covariance, stamp_ns, "world")
        )

    def _await(self, stamp_ns: int) -> None:
        """Wait in lockstep for what the controller has learned from this tick, before the next."""
        if self._lockstep and self._config.learned:
            self._awaited_ns = stamp_ns

    def _publish_nothing(self, stamp_ns: int) -> None:
        """Report that there is no estimate: in lockstep by an empty message, in real time by none."""
        if self._lockstep:
            nothing = JointState()
            nothing.header.stamp = messages.to_time(stamp_ns)
            self._arm_state.publish(nothing)

    def _seconds(self, stamp_ns: int) -> float:
        return (stamp_ns - self._epoch_ns) * 1e-9

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
        message.header.stamp = messages.to_time(self._epoch_ns + round(self.state.t_s * 1e9))
        self._backbone.publish(message)

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
        values = {**self.state.counts._asdict(), "malformed": self._malformed}
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


def _quaternion(pose: np.ndarray) -> tuple[float, float, float, float]:
    o = messages.pose_of(pose).orientation
    return o.x, o.y, o.z, o.w


def main() -> None:
    """Entry point of `ros2 run soro_ros estimator`."""
    run_node(EstimatorNode)


if __name__ == "__main__":
    main()
