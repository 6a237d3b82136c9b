"""The estimator between its messages: each chambers/state gives one arm/state, arm/tip and arm/covariance."""

from __future__ import annotations

from collections import deque
from typing import Any, ClassVar

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped, WrenchStamped
from sensor_msgs.msg import JointState

from soro_core.adaptation import Learned
from soro_core.adaptation.external_force import ExternalForce
from soro_core.estimation import EstimatorState, ImuSample, PoseSample
from soro_core.loop import certainty_of
from soro_core.robot import load_robot
from soro_core.rotation import quaternion_from_matrix
from soro_lab.scene import EstimatorNodeConfig
from soro_lab.scene.loop import estimator_of
from soro_ros.conversion import force, learning, messages, qos
from soro_ros.status_words import NO_ESTIMATE, add_prefix
from soro_ros.topics.base_topic import ToldBase
from soro_ros.topics.frame_check import FrameCheck
from soro_ros.topics.ports import Input, Inputs, NodeOutputs
from soro_ros.topics.sample_inputs import SampleInputs


class EstimatorTicks:
    """Runs the filter at each chambers/state; in lockstep it first waits for the samples of that tick.

    Parameters
    ----------
    config : EstimatorNodeConfig
    ports : NodeOutputs
    frames : FrameCheck, optional
        Refuses samples in another frame than the configured one; one that tells nobody by default.

    Attributes
    ----------
    estimator : Estimator
    state : EstimatorState or None
        None before the first tick.
    inputs : mapping of str to Input
        What it takes, by the name of the topic.
    malformed : int
        Refused messages on chambers/state.
    estimated_ns : int or None
        Time of the estimate of the last tick [ns]; None if that gave none.
    external : ExternalForce or None
        What pushed on the arm at the last tick; None if it is not known.
    """

    outputs: ClassVar[dict[str, type[Any]]] = {
        "arm/covariance": JointState,
        "arm/state": JointState,
        "arm/tip": PoseWithCovarianceStamped,
        "arm/wrench": WrenchStamped,
        "arm/wrench/covariance": JointState,
    }

    def __init__(
        self, config: EstimatorNodeConfig, ports: NodeOutputs, frames: FrameCheck | None = None
    ) -> None:
        robot = load_robot(config.robot)
        self._config, self._lockstep, self._ports = config, config.mode == "lockstep", ports
        self.estimator = estimator_of(config, robot)
        self._names, self._coordinates = robot.chamber_names, self.estimator.arm.robot.coordinate_names
        self.state: EstimatorState | None = None
        self.epoch_ns, self.malformed = 0, 0
        self.estimated_ns: int | None = None
        self.external: ExternalForce | None = None
        frames = frames or FrameCheck(config.frames)
        self._pressures: deque[tuple[int, np.ndarray]] = deque(maxlen=1000)
        self._learned: Learned | None = None
        self._awaited_ns: int | None = None  # in lockstep: the tick whose learned model has not come yet
        self._samples = SampleInputs(config, self.estimator.length, self._seconds, self._process, frames)
        self.inputs: Inputs = {
            "chambers/state": Input(JointState, self._on_pressures, qos.sensor),
            "arm/learned": Input(JointState, self._on_learned, qos.loop),
            **self._samples.inputs,
        }
        self._tick_ns = 0
        self._base: ToldBase | None = None
        if config.base_by_topic:
            varying = self.estimator.filter.mean_strain
            arms = [self.estimator.arm, *([varying.fine] if varying is not None else [])]
            self._base = ToldBase(robot, lambda: arms, frames, self._now_ns, ports.warn)
            self.inputs = {**self.inputs, **self._base.inputs}

    def warm_up(self) -> None:
        """Run ticks without output, with a learned force too, which compiles their kernels."""
        estimator, dt = self.estimator, 0.005
        zero, nothing = np.zeros(len(self._names)), estimator.filter.nothing
        pose = estimator.arm.pose(np.zeros(estimator.arm.n_q), estimator.length)
        quaternion = quaternion_from_matrix(pose[:3, :3])
        state = estimator.initial_state()
        for k in range(1, 20):
            sample = PoseSample(k * dt, pose[:3, 3], quaternion, estimator.length)
            poses = [sample] if k % 8 else []  # a tick without a sample has a kernel of its own
            imu = ImuSample(k * dt, np.zeros(3), np.array([0.0, 0.0, 9.81]), None, estimator.length)
            learned = nothing if k > 1 else None
            state, _ = estimator.step(state, zero, poses, [imu] if k % 8 == 1 else [], dt, learned)

    def _now_ns(self) -> int:
        """Time [ns] that stamps of now have."""
        return self._tick_ns if self._lockstep else self._ports.now_ns()

    # Inputs ----------------------------------------------------------------------------------------
    def _on_learned(self, message: JointState) -> None:
        self._learned = learning.learned_of(message)
        if messages.to_ns(message.header.stamp) == self._awaited_ns:
            self._awaited_ns = None
        self._process()

    def _on_pressures(self, message: JointState) -> None:
        try:
            pressure = messages.pressures(message, self._names)
        except ValueError as error:
            self.malformed += 1
            self._ports.warn(f"chambers/state refused: {error}")
            return
        stamp_ns = messages.to_ns(message.header.stamp)
        ahead = "" if self._lockstep else messages.ahead(stamp_ns, self._ports.now_ns())
        if ahead:  # taken, it would make all later ones old
            self.malformed += 1
            self._ports.warn(f"chambers/state refused: {ahead}")
            return
        self._pressures.append((stamp_ns, pressure))
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
            if silent := messages.without_reading(pressure, self._names):
                # As without a message, which is what comes where no chamber is read; samples wait.
                self._ports.report(add_prefix(NO_ESTIMATE, f"no reading of {silent}"))
                self._without_estimate(stamp_ns)
                continue
            due = [sample for found in self._samples.due(tick).values() for sample in found]
            poses = [sample for sample in due if isinstance(sample, PoseSample)]
            self._tick_ns = stamp_ns
            if self._base is not None:
                if unknown := self._base.place(stamp_ns):
                    self._ports.report(add_prefix(NO_ESTIMATE, unknown))
                    self._without_estimate(stamp_ns)
                    continue
                poses = [self._base.carry(one, self._sample_ns(one), stamp_ns) for one in poses]
            imus = [sample for sample in due if isinstance(sample, ImuSample)]
            self._step(stamp_ns, pressure, poses, imus)

    def _step(
        self, stamp_ns: int, pressure: np.ndarray, poses: list[PoseSample], imus: list[ImuSample]
    ) -> None:
        publish = self._ports.publish
        if self.state is None:
            self.epoch_ns = 0 if self._lockstep else stamp_ns
            self.state = self.estimator.initial_state(self._seconds(stamp_ns), pressure_pa=pressure)
            self._without_estimate(stamp_ns)
            return
        dt = self._seconds(stamp_ns) - self.state.t_s
        learned, self._learned = self._learned, None
        refused = self.state.counts.invalid
        self.state, estimate = self.estimator.step(self.state, pressure, poses, imus, dt, learned)
        if self.state.counts.invalid > refused:
            found = self.state.counts.invalid
            self._ports.warn(f"samples of sensors refused, with numbers of no arm: {found} since the start")
        self._ports.report(add_prefix(NO_ESTIMATE, estimate.status.message) or estimate.status.note)
        self._await(stamp_ns)
        publish("arm/covariance", learning.covariance(certainty_of(estimate), stamp_ns))
        if not estimate.status.ok:
            self._publish_nothing(stamp_ns)
            return
        self.estimated_ns = stamp_ns
        state = messages.arm_state(self._coordinates, estimate.q, estimate.qd, estimate.force, stamp_ns)
        publish("arm/state", state)
        if self._ports.is_read("arm/tip"):
            world = self._config.frames.world
            tip = messages.tip_estimate(estimate.tip_pose, estimate.tip_covariance, stamp_ns, world)
            publish("arm/tip", tip)
        self._publish_force(estimate.external, stamp_ns)
        self._ports.estimated(stamp_ns)

    def _publish_force(self, external: ExternalForce | None, stamp_ns: int) -> None:
        """Publish the force when there is a new one: it is estimated at a rate of its own."""
        before, self.external = self.external, external
        if external is None or external is before:
            return
        if self._ports.is_read("arm/wrench"):
            pushed = force.wrench(external.force_n, stamp_ns, self._config.frames.world)
            self._ports.publish("arm/wrench", pushed)
        if self._ports.is_read("arm/wrench/covariance"):
            self._ports.publish("arm/wrench/covariance", force.covariance(external, stamp_ns))

    def _without_estimate(self, stamp_ns: int) -> None:
        """Answer a tick at which the filter takes no step."""
        self._await(stamp_ns)
        self._ports.publish("arm/covariance", learning.covariance(None, stamp_ns))
        self._publish_nothing(stamp_ns)

    def _await(self, stamp_ns: int) -> None:
        """Wait in lockstep for what the controller has learned from this tick, before the next."""
        if self._lockstep and self._config.learned:
            self._awaited_ns = stamp_ns

    def _publish_nothing(self, stamp_ns: int) -> None:
        """Report that there is no estimate: in lockstep by an empty message, in real time by none."""
        self.estimated_ns = self.external = None
        if self._lockstep:
            nothing = JointState()
            nothing.header.stamp = messages.to_time(stamp_ns)
            self._ports.publish("arm/state", nothing)

    def _sample_ns(self, sample: PoseSample) -> int:
        return self.epoch_ns + round(1e9 * sample.stamp_s)

    def _seconds(self, stamp_ns: int) -> float:
        return (stamp_ns - self.epoch_ns) * 1e-9
