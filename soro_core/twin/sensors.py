"""Sensors of the twin: they sample the truth, add noise and delay, and lose or spoil some samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np

from soro_core.arrays import Array
from soro_core.estimation.sensors.samples import ImuSample, PoseSample
from soro_core.frozen import replaced
from soro_core.rotation import quaternion_from_matrix, rotation_exp
from soro_core.twin.config import SensorConfig

Sample = TypeVar("Sample", bound=PoseSample | ImuSample)

# Size of an outlier in standard deviations: it represents a swapped marker, not large noise.
OUTLIER_STD = 60.0


@dataclass(frozen=True)
class SensorState(Generic[Sample]):
    """Samples on their way to the reader, each with the tick at which it is due."""

    pending: tuple[tuple[int, Sample], ...] = ()
    last: Sample | None = None
    lost: int = 0


@dataclass(frozen=True)
class SensorClock:
    """The sensor's period and delay in ticks of the twin."""

    period: int
    delay: int

    @staticmethod
    def of(config: SensorConfig, rate_hz: float) -> SensorClock:
        """Round the delay up to whole ticks; the period divides the rate (checked by the scene)."""
        return SensorClock(
            period=max(1, round(rate_hz / config.rate_hz)),
            delay=int(np.ceil(config.delay_s * rate_hz - 1e-9)),
        )

    def published_by(self, tick: int) -> int:
        """Number of samples that have been published when `tick` is complete."""
        return 0 if tick < self.delay else (tick - self.delay) // self.period + 1


def sample(
    config: SensorConfig,
    clock: SensorClock,
    state: SensorState[Sample],
    tick: int,
    measure: Callable[[], Sample],
    rng: np.random.Generator,
) -> tuple[SensorState[Sample], tuple[Sample, ...]]:
    """Advance a sensor by one tick.

    Parameters
    ----------
    config : SensorConfig
        Probability that a sample is lost.
    clock : SensorClock
        Period and delay in ticks.
    state : SensorState
        After the last tick.
    tick : int
        Number of this tick, from 0.
    measure : callable
        Takes a sample now; called only when one is due.
    rng : Generator
        Source of the losses.

    Returns
    -------
    state : SensorState
    due : tuple of samples
        Samples that reach the reader at this tick. A lost sample is replaced by the last one with its stamp,
        as drivers of tracking systems do.
    """
    if tick % clock.period == 0:
        taken = measure()
        if state.last is not None and rng.random() < config.drop:
            state = replaced(
                state, pending=(*state.pending, (tick + clock.delay, state.last)), lost=state.lost + 1
            )
        else:
            state = replaced(state, pending=(*state.pending, (tick + clock.delay, taken)), last=taken)
    due = tuple(item for when, item in state.pending if when <= tick)
    if due:
        state = replaced(state, pending=tuple(entry for entry in state.pending if entry[0] > tick))
    return state, due


def measure_pose(
    config: SensorConfig, transform: Array, stamp_s: float, s: float, rng: np.random.Generator
) -> PoseSample:
    """Measure a pose with noise on position and rotation.

    Parameters
    ----------
    config : SensorConfig
        Noise and outliers.
    transform : ndarray (4, 4)
        True pose of the cross-section.
    stamp_s : float
        Time of the sample [s].
    s : float
        Place on the backbone [m].
    rng : Generator
        Source of the noise.
    """
    scale = OUTLIER_STD if rng.random() < config.outlier else 1.0
    position = transform[:3, 3] + scale * config.position_noise_m * rng.standard_normal(3)
    noise = rotation_exp(scale * config.rotation_noise_rad * rng.standard_normal(3))
    quaternion = quaternion_from_matrix(transform[:3, :3] @ noise)
    return PoseSample(stamp_s=stamp_s, position=position, quaternion=quaternion, s=s)


@dataclass(frozen=True)
class SectionMotion:
    """Motion of one cross-section: pose (4, 4), body twist (6,) (angular, linear), body acceleration (6,)."""

    transform: Array
    twist: Array
    acceleration: Array = field(default_factory=lambda: np.zeros(6))


def measure_imu(
    config: SensorConfig,
    motion: SectionMotion,
    gravity: Array,
    stamp_s: float,
    s: float,
    rng: np.random.Generator,
) -> ImuSample:
    """Measure angular velocity, specific force and orientation with an IMU whose axes are the local frame's.

    Parameters
    ----------
    config : SensorConfig
        Noise and outliers.
    motion : SectionMotion
        True motion of the cross-section.
    gravity : ndarray (3,)
        Acceleration of gravity in the world [m/s^2].
    stamp_s : float
        Time of the sample [s].
    s : float
        Place on the backbone [m].
    rng : Generator
        Source of the noise.
    """
    rotation = motion.transform[:3, :3]
    omega, velocity = motion.twist[:3], motion.twist[3:]
    specific_force = motion.acceleration[3:] + np.cross(omega, velocity) - rotation.T @ gravity
    scale = OUTLIER_STD if rng.random() < config.outlier else 1.0
    noise = rotation_exp(scale * config.rotation_noise_rad * rng.standard_normal(3))
    return ImuSample(
        stamp_s=stamp_s,
        angular_velocity=omega + scale * config.rate_noise_rad_s * rng.standard_normal(3),
        linear_acceleration=specific_force + scale * config.acceleration_noise_m_s2 * rng.standard_normal(3),
        orientation=quaternion_from_matrix(rotation @ noise),
        s=s,
    )
