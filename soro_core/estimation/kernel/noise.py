"""The noise of one sensor, from how much its innovations differ from one sample to the next (after Mehra).

Half of the mean square of this difference is the variance of an innovation where the filter is consistent.
An error of the model lasts longer than from sample to sample, so that the difference has little of it.
"""

from __future__ import annotations

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.estimation.kernel.parts import FIRST_RESIDUAL, FIRST_SPREAD, IMU, POSE, FilterArm

# Places in the record of a sensor: variance of position or angular velocity, and of orientation, over the
# stated one; their last residuals.
NOISE, LAST = 15, 17
N_NOISE = 2
# A sample counts at most with what 1 % of good ones exceed in the mean square of three components, and at
# most with this part of the mean: slow sensors have few.
_LARGEST, _MOST_PART = 3.78, 0.2
# Bounds of the variance over the stated one.
_LEAST_NOISE, _MOST_NOISE = 1.0 / 400.0, 400.0


@inner
def noise_variance(arm: FilterArm, kind: int, record: Array, component: int) -> tuple[float, float]:
    """Give the variance of the noise of a kind of component, and of the error of the kinematics in it."""
    s = arm.settings
    if kind == POSE:
        return record[NOISE + component] * s.pose_variance[component], s.kinematic_variance[3 * component]
    model = s.imu_kinematic_variance if component == 1 else 0.0
    return record[NOISE + component] * s.imu_variance[component], model


@inner
def match_noise(arm: FilterArm, kind: int, record: Array, since_s: float, repeats: tuple[bool, bool]) -> None:
    """Put a new sample, `since_s` after the last one of its sensor, into the noise of its record.

    A position or an orientation that the sensor repeats, because its steps are coarse, says nothing of noise.
    """
    reported, time_s = arm.scratch.reported, arm.settings.noise_time
    part = min(since_s / time_s, _MOST_PART) if time_s > 0.0 else 0.0
    for component in range(1 if kind == IMU else N_NOISE):
        noise, model = noise_variance(arm, kind, record, component)
        square = expected = 0.0
        for r in range(3 * component, 3 * component + 3):
            residual, spread = reported[FIRST_RESIDUAL + r], reported[FIRST_SPREAD + r]
            changed = residual - record[LAST + r]
            record[LAST + r] = residual
            square += 0.5 * changed * changed
            # The update takes back this part of an innovation; without model it is all of the spread's.
            share = spread / (spread + noise + model)
            expected += noise * (1.0 + share + 0.5 * share * share) + 0.5 * share * (1.0 + share) * spread
        if part > 0.0 and square >= 0.0 and not repeats[component]:  # not before the second sample
            ratio = 1.0 + part * (min(square / expected, _LARGEST) - 1.0)
            record[NOISE + component] = min(max(record[NOISE + component] * ratio, _LEAST_NOISE), _MOST_NOISE)
