"""How well the samples of one sensor fit the prediction: the mean of their normalised innovation squared."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import NamedTuple

from scipy.special import chdtri

from soro_core.estimation.sensors.watch_config import WatchConfig

# Components of a position, and of a whole sample at most: rate, orientation and gravity of an IMU.
_POSITION, _WHOLE = 3, 9
# A sample counts at most with what 1 % of the good ones exceed: single outliers, which are counted as such,
# must not say for seconds that the residual of all samples grows.
_LARGEST_POSITION, _LARGEST = float(chdtri(_POSITION, 0.01)), float(chdtri(_WHOLE, 0.01))

# Variance over the stated one that is named.
_NOISY = 4.0
# Time for which a mean is above its bound before it is named [s]: that the arm meets something is known 0.2 s
# after its first touch.
_LASTS_S = 0.25


class Innovation(NamedTuple):
    """What one sample says of its sensor.

    Attributes
    ----------
    sensor : str
        Name of the sensor.
    stamp_s : float
        Its stamp [s].
    nis, position_nis : float
        Normalised innovation squared, and that of the position alone, NaN of an IMU.
    noise, orientation_noise : float
        Variance of its position or angular velocity, and of its orientation, over the stated one.
    """

    sensor: str
    stamp_s: float
    nis: float
    position_nis: float
    noise: float = 1.0
    orientation_noise: float = 1.0


class SensorMonitor(NamedTuple):
    """Means of one sensor.

    Attributes
    ----------
    stamp_s : float
        Stamp of the last sample [s].
    nis, position_nis : float
        Means; the second NaN of an IMU.
    passed_s : float
        Time since the first sample [s].
    squares : float
        Sum of the squared weights of the samples in the mean; its inverse is the number that counts.
    noise, orientation_noise : float
        Those of the last sample, see `Innovation`.
    above_s : float
        Time for which the mean has been above what is allowed [s].
    """

    stamp_s: float
    nis: float
    position_nis: float
    passed_s: float = 0.0
    squares: float = 1.0
    noise: float = 1.0
    orientation_noise: float = 1.0
    above_s: float = 0.0

    @property
    def watched(self) -> float:
        """Mean of the watched statistic: of a pose that of the position.

        The deviation of orientations is an allowance for bends that the model does not have, far above the
        sensor's noise; it would hide a position that is wrong.
        """
        return self.nis if math.isnan(self.position_nis) else self.position_nis

    @property
    def components(self) -> int:
        """Components of the watched statistic, the mean of a good sensor."""
        return _WHOLE if math.isnan(self.position_nis) else _POSITION

    def allowed(self, config: WatchConfig) -> float:
        """Return the mean that a good sensor exceeds with the configured probability at most."""
        count = 1.0 / self.squares
        return _quantile(round(self.components * count, 1), config.nis_false_alarm) / count


@lru_cache(maxsize=256)
def _quantile(freedom: float, probability: float) -> float:
    """Return what chi-square exceeds with a probability; most calls have the same numbers."""
    return float(chdtri(freedom, probability))


def monitored(state: SensorMonitor | None, seen: Innovation, dt: float, config: WatchConfig) -> SensorMonitor:
    """Return the means with one more sample.

    Parameters
    ----------
    state : SensorMonitor or None
        After the last sample of this sensor; None before the first.
    seen : Innovation
        Of the new sample.
    dt : float
        Time between the stamps of the two, above 0 [s].
    config : WatchConfig
    """
    nis, position = seen.nis, seen.position_nis
    if nis > _LARGEST:
        nis = _LARGEST
    if position > _LARGEST_POSITION:
        position = _LARGEST_POSITION
    if state is None:
        return SensorMonitor(seen.stamp_s, nis, position, 0.0, 1.0, seen.noise, seen.orientation_noise)
    # At first a mean: the first sample alone would count for the time constant.
    passed_s = state.passed_s + dt
    part = max(-math.expm1(-dt / config.nis_time_s), dt / (passed_s + dt))
    after = SensorMonitor(
        seen.stamp_s,
        state.nis + part * (nis - state.nis),
        state.position_nis + part * (position - state.position_nis),
        passed_s,
        (1.0 - part) ** 2 * state.squares + part**2,
        seen.noise,
        seen.orientation_noise,
    )
    # As they are printed: a warning of 3.9 where 3.9 is allowed would be none. Up to its mean it is below
    # every bound, whose quantile takes time.
    is_above = after.watched > after.components and round(after.watched, 1) > round(after.allowed(config), 1)
    return after._replace(above_s=state.above_s + dt) if is_above else after


def watched(
    monitors: Mapping[str, SensorMonitor],
    innovations: Iterable[Innovation],
    config: WatchConfig,
    pushed: bool = False,
) -> dict[str, SensorMonitor]:
    """Return the monitors of the sensors after a tick.

    Parameters
    ----------
    monitors : mapping of str to SensorMonitor
        After the last tick.
    innovations : iterable of Innovation
        Of the samples that are new, in the order of their stamps.
    config : WatchConfig
    pushed : bool
        Whether something pushes on the arm: the residual is that of the push, and the means begin anew.
    """
    after = dict(monitors)
    for seen in innovations:
        old = None if pushed else after.get(seen.sensor)
        dt = seen.stamp_s - (old.stamp_s if old is not None else -math.inf)
        after[seen.sensor] = monitored(old, seen, dt, config)
    return after


def note_of(monitors: Mapping[str, SensorMonitor], t_s: float, silent_s: float, config: WatchConfig) -> str:
    """Return what the user must know of the sensors, or an empty string.

    Parameters
    ----------
    monitors : mapping of str to SensorMonitor
    t_s, silent_s : float
        Time, and the time for which a sensor may be silent: it is not judged after that [s].
    config : WatchConfig
    """
    said = [
        _noise_note(sensor, monitor) if monitor.noise > _NOISY else _nis_note(sensor, monitor, config)
        for sensor, monitor in monitors.items()
        if t_s - monitor.stamp_s <= silent_s and (monitor.above_s >= _LASTS_S or monitor.noise > _NOISY)
    ]
    return "; ".join(said)


def _noise_note(sensor: str, monitor: SensorMonitor) -> str:
    key = "imu.rate_std_rad_s" if math.isnan(monitor.position_nis) else "pose.position_std_m"
    return (
        f"{sensor}: noise {math.sqrt(monitor.noise):.1f} times {key}: look at the sensor, or state its noise"
    )


def _nis_note(sensor: str, monitor: SensorMonitor, config: WatchConfig) -> str:
    allowed = monitor.allowed(config)
    key = "imu" if math.isnan(monitor.position_nis) else "pose"
    return (
        f"{sensor}: NIS {monitor.watched:.1f}, allowed {allowed:.1f}: check its noise ({key}), its place "
        "and the robot file"
    )
