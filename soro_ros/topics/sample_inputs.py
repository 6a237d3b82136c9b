"""Samples of the sensors that wait for their tick; in lockstep a tick waits for them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any, TypeAlias

from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import Imu

from soro_core.estimation.sensors.samples import ImuSample, PoseSample, Sample
from soro_core.twin import SensorConfig
from soro_core.twin.sensors import SensorClock
from soro_lab.scene import EstimatorNodeConfig, ExciterNodeConfig
from soro_ros.conversion import messages, qos
from soro_ros.topics.frame_check import FrameCheck
from soro_ros.topics.ports import Input, Inputs

_Read: TypeAlias = Callable[[float, Any, float], Sample]


class SampleInputs:
    """Samples of the sensors on the arm by name: pose0, pose1, ..., imu0, ...

    Parameters
    ----------
    config : EstimatorNodeConfig or ExciterNodeConfig
        Places, rates and delays of the sensors, and whether time is in lockstep.
    length : float
        Length of the arm [m].
    seconds : callable
        Function that returns the time [s] of a stamp [ns].
    on_sample : callable
        Called after each sample.
    frames : FrameCheck
        Refuses samples in another frame than the configured one.

    Attributes
    ----------
    inputs : mapping of str to Input
        The topics sensors/pose0, ...
    """

    def __init__(
        self,
        config: EstimatorNodeConfig | ExciterNodeConfig,
        length: float,
        seconds: Callable[[int], float],
        on_sample: Callable[[], None],
        frames: FrameCheck,
    ) -> None:
        self._lockstep = config.mode == "lockstep"
        self._seconds, self._on_sample = seconds, on_sample
        self._frames = frames
        pose = _clock(config.pose_rate_hz, config.pose_delay_s, config.rate_hz)
        imu = _clock(config.imu_rate_hz, config.imu_delay_s, config.rate_hz)
        poses = [f"pose{k}" for k in range(len(config.pose_locations))]
        imus = [f"imu{k}" for k in range(len(config.imu_locations))]
        self._expected = dict.fromkeys(poses, pose) | dict.fromkeys(imus, imu)
        # None: a refused sample, which a tick in lockstep does not wait for any longer.
        self._samples: dict[str, deque[Sample | None]] = {name: deque(maxlen=1000) for name in self._expected}
        self._taken, self._received = (dict.fromkeys(self._samples, 0) for _ in range(2))
        self.inputs: Inputs = {
            f"sensors/{name}": Input(kind, partial(self._on_message, read, name, place * length), qos.sensor)
            for kind, names, places, read in (
                (PoseStamped, poses, config.pose_locations, _pose),
                (Imu, imus, config.imu_locations, _imu),
            )
            for name, place in zip(names, places, strict=True)
        }

    def complete(self, tick: int) -> bool:
        """Whether every sample that must have been published by `tick` has come."""
        return all(
            clock is None or self._received[name] >= clock.published_by(tick)
            for name, clock in self._expected.items()
        )

    def due(self, tick: int) -> dict[str, list[Sample]]:
        """Return the samples of a tick; in lockstep the twin may already have sent those of the next."""
        return {name: self._due(name, tick) for name in self._samples}

    def _on_message(self, read: _Read, name: str, s: float, message: PoseStamped | Imu) -> None:
        self._received[name] += 1
        is_used = self._frames.takes_sample(f"sensors/{name}", message.header.frame_id)
        stamp_s = self._seconds(messages.to_ns(message.header.stamp))
        self._samples[name].append(read(stamp_s, message, s) if is_used else None)
        self._on_sample()

    def _due(self, name: str, tick: int) -> list[Sample]:
        queue, clock = self._samples[name], self._expected[name]
        n = len(queue)
        if self._lockstep and clock is not None:
            n = min(n, clock.published_by(tick) - self._taken[name])
        self._taken[name] += n
        taken = [queue.popleft() for _ in range(n)]
        return [sample for sample in taken if sample is not None]


def _pose(stamp_s: float, message: PoseStamped, s: float) -> PoseSample:
    position, quaternion = messages.pose_arrays(message.pose)
    return PoseSample(stamp_s, position, quaternion, s)


def _imu(stamp_s: float, message: Imu, s: float) -> ImuSample:
    omega, force, quaternion = messages.imu_arrays(message)
    return ImuSample(stamp_s, omega, force, quaternion, s)


def _clock(sensor_rate_hz: float, delay_s: float, rate_hz: float) -> SensorClock | None:
    if sensor_rate_hz <= 0.0:
        return None
    return SensorClock.of(SensorConfig(rate_hz=sensor_rate_hz, delay_s=delay_s), rate_hz)
