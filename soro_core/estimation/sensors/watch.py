"""The watch over the sensors at each tick: their means, their delays, and what the user must know of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.errors import ModelError
from soro_core.estimation.kernel.advance import FUSED_POSES, RESIDUALS
from soro_core.estimation.sensors.delay import DelayFit, DelayModel, Instant
from soro_core.estimation.sensors.monitor import Innovation, SensorMonitor, monitored

if TYPE_CHECKING:
    from soro_core.estimation.config import EstimatorConfig
    from soro_core.estimation.draft import Draft
    from soro_core.estimation.state import EstimatorState, Segment
    from soro_core.model import SoftArm

Array: TypeAlias = NDArray[np.float64]

# Rows of the delay come at most so often [s]: the filter's errors last longer, and a row costs as much as a
# step of the filter.
_ROW_S = 0.04
# Round-off of times [s].
_SAME_S = 1e-9


class Watch:
    """The watch of one estimator.

    Parameters
    ----------
    arm : SoftArm
        Model of the filter.
    config : EstimatorConfig
    """

    def __init__(self, arm: SoftArm, config: EstimatorConfig) -> None:
        self.config, self.delay = config, DelayModel(arm, config)

    def step(
        self, state: EstimatorState | Draft, innovations: Sequence[Innovation]
    ) -> dict[str, SensorMonitor]:
        """Return the monitors of the sensors.

        Parameters
        ----------
        state : EstimatorState or Draft
            At the new time, the samples fused.
        innovations : sequence of Innovation
            Of the samples that are new, in the order of their stamps.
        """
        monitors = dict(state.monitors)
        for seen in innovations:
            name = seen.sensor
            old = monitors.get(name)
            dt = seen.stamp_s - (old.stamp_s if old is not None else -math.inf)
            new = monitored(old, seen, dt, self.config.watch)
            if seen.placed and self.delay.usable:
                new = self._with_delay(new, name, state)
            monitors[name] = new
        return monitors

    def _with_delay(
        self, monitor: SensorMonitor, sensor: str, state: EstimatorState | Draft
    ) -> SensorMonitor:
        """Return the monitor with a row of its delay where it is time for one."""
        fit, t_s = monitor.delay, state.t_s
        if fit is None:
            return monitor._replace(delay=self.delay.start(t_s))
        if t_s - fit.t_s < _ROW_S - _SAME_S:
            return monitor
        sample, record = state.sensors[sensor]
        residuals, pressure = record[RESIDUALS : FUSED_POSES + 1], state.pressure_pa
        mean = mean_pressure(state.history, fit.t_s, pressure)
        at = Instant(t_s, state.belief, pressure, mean, state.known.share, sample.s, residuals)
        try:
            fit = self.delay.step(fit, at)
        except (ModelError, np.linalg.LinAlgError):  # where the model has no value there is no delay
            fit = self.delay.start(t_s, residuals)
        return monitor._replace(delay=fit)

    def note(self, monitors: Mapping[str, SensorMonitor], t_s: float) -> str:
        """Return what the user must know of the sensors, or an empty string.

        Parameters
        ----------
        monitors : mapping of str to SensorMonitor
        t_s : float
            Time; a sensor that is silent for longer than the estimate may be old is not judged [s].
        """
        said = []
        for sensor, monitor in monitors.items():
            if t_s - monitor.stamp_s > self.config.lost_after_s:
                continue
            if monitor.delay is not None and monitor.delay.is_late:
                said.append(self._delay_note(sensor, monitor.delay))
            if monitor.watched > monitor.components:  # else below every bound, whose quantile takes time
                said.append(self._nis_note(sensor, monitor))
        return "; ".join(filter(None, said)) if said else ""

    def _delay_note(self, sensor: str, fit: DelayFit) -> str:
        allowed_ms = 1e3 * self.config.watch.delay_allowed_s
        return (
            f"{sensor}: stamps {1e3 * fit.delay_s:.0f} ms late (+-{1e3 * fit.deviation_s:.0f}), allowed "
            f"{allowed_ms:.0f}: stamp samples when they are taken, or state more damping in the robot file, "
            "which looks the same"
        )

    def _nis_note(self, sensor: str, monitor: SensorMonitor) -> str:
        allowed = monitor.allowed(self.config.watch)
        if monitor.watched <= allowed:
            return ""
        key = "imu" if math.isnan(monitor.position_nis) else "pose"
        return (
            f"{sensor}: NIS {monitor.watched:.1f}, allowed {allowed:.1f}: check its noise ({key}), its place "
            "and the robot file"
        )


def mean_pressure(history: Sequence[Segment], since_s: float, latest: Array) -> Array:
    """Return the mean pressures (n_u,) [Pa gauge] since a time; `latest` (n_u,) without a step since then.

    Parameters
    ----------
    history : sequence of Segment
        Past steps, oldest first.
    since_s : float
        Time [s].
    latest : ndarray (n_u,)
    """
    total, time_s = np.zeros(latest.shape), 0.0
    for part in reversed(history):
        if part.end_s <= since_s + _SAME_S:
            break
        total += (part.end_s - part.start_s) * part.pressure_pa
        time_s += part.end_s - part.start_s
    return total / time_s if time_s > 0.0 else latest
