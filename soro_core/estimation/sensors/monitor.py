"""How well the samples of one sensor fit the prediction: the mean of their normalised innovation squared."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from soro_core.estimation.sensors.delay import DelayFit
from soro_core.estimation.sensors.watch_config import WatchConfig

Array: TypeAlias = NDArray[np.float64]

# Components of a position, and of a whole sample at most: rate, orientation and gravity of an IMU.
_POSITION, _WHOLE = 3, 9
# A sample counts at most with what 1 % of the good ones exceed: single outliers, which are counted as such,
# must not say for seconds that the residual of all samples grows.
_LARGEST_POSITION, _LARGEST = float(chdtri(_POSITION, 0.01)), float(chdtri(_WHOLE, 0.01))


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
    placed : bool
        Whether it is a pose that was fused.
    """

    sensor: str
    stamp_s: float
    nis: float
    position_nis: float
    placed: bool


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
    delay : DelayFit or None
        Delay that is not declared; None of an IMU.
    """

    stamp_s: float
    nis: float
    position_nis: float
    passed_s: float = 0.0
    squares: float = 1.0
    delay: DelayFit | None = None

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
        return float(chdtri(self.components * count, config.nis_false_alarm)) / count


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
        return SensorMonitor(seen.stamp_s, nis, position)
    # At first a mean: the first sample alone would count for the time constant.
    passed_s = state.passed_s + dt
    part = max(-math.expm1(-dt / config.nis_time_s), dt / (passed_s + dt))
    return SensorMonitor(
        seen.stamp_s,
        state.nis + part * (nis - state.nis),
        state.position_nis + part * (position - state.position_nis),
        passed_s,
        (1.0 - part) ** 2 * state.squares + part**2,
        state.delay,
    )
