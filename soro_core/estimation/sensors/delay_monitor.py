"""The monitor of delays that stamps do not declare: it runs beside the loop, ten times a second.

The tick of the filter does nothing for it: whoever steps the filter keeps the states since the last look.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.estimation.kernel.advance import FUSED_POSES, RESIDUALS
from soro_core.estimation.sensors.delay import DelayFit, DelayModel, Instant

if TYPE_CHECKING:
    from soro_core.estimation.config import EstimatorConfig
    from soro_core.estimation.state import EstimatorState, Segment
    from soro_core.model import SoftArm


# Time between two looks [s].
PERIOD_S = 0.1
# Rows of the delay come at most so often [s]: the filter's errors last longer.
_ROW_S = 0.04
# Round-off of times [s].
_SAME_S = 1e-9
# Never written: a step copies it.
_NONE: Mapping[str, DelayFit] = {}


class Delays(NamedTuple):
    """State of the monitor.

    Attributes
    ----------
    fits : mapping of str to DelayFit
        Of each sensor whose poses were fused.
    last : EstimatorState or None
        The last state of the filter that was seen; None before the first.
    """

    fits: Mapping[str, DelayFit] = _NONE
    last: EstimatorState | None = None


class DelayMonitor:
    """The monitor of one estimator.

    Parameters
    ----------
    arm : SoftArm
        Model of the filter.
    config : EstimatorConfig
        Of the filter, as that has scaled it.
    """

    def __init__(self, arm: SoftArm, config: EstimatorConfig) -> None:
        self.config, self.delay = config, DelayModel(arm, config)

    def step(self, before: Delays, passed: Sequence[EstimatorState]) -> Delays:
        """Return the state after a look.

        Parameters
        ----------
        before : Delays
            After the last look; ``Delays()`` before the first.
        passed : sequence of EstimatorState
            States of the filter since then, oldest first; a tick that is left out costs its row only.
        """
        if not (self.delay.usable and passed):
            return before
        fits, last = dict(before.fits), before.last
        for state in passed:
            for name in state.sensors:
                if _fused(state, name) > _fused(last, name):
                    fits[name] = self._with_row(fits.get(name), name, state)
            last = state
        return Delays(fits, last)

    def _with_row(self, fit: DelayFit | None, sensor: str, state: EstimatorState) -> DelayFit:
        """Return the fit with one more row where it is time for one."""
        t_s = state.t_s
        if fit is None:
            return self.delay.start(t_s)
        if t_s - fit.t_s < _ROW_S - _SAME_S:
            return fit
        sample, record = state.sensors[sensor]
        residuals, pressure = record[RESIDUALS : FUSED_POSES + 1], state.pressure_pa
        mean = mean_pressure(state.history, fit.t_s, pressure)
        at = Instant(t_s, state.belief, pressure, mean, state.known.share, sample.s, residuals)
        try:
            return self.delay.step(fit, at)
        except (ModelError, np.linalg.LinAlgError):  # where the model has no value there is no delay
            return self.delay.start(t_s, residuals)

    def note(self, state: Delays) -> str:
        """Return what the user must know of delays, or an empty string; a silent sensor is not judged."""
        if state.last is None:
            return ""
        allowed_ms, silent_s = 1e3 * self.config.watch.delay_allowed_s, self.config.lost_after_s
        return "; ".join(
            f"{sensor}: stamps {1e3 * fit.delay_s:.0f} ms late (+-{1e3 * fit.deviation_s:.0f}), allowed "
            f"{allowed_ms:.0f}: stamp samples when they are taken, or state more damping in the robot file, "
            "which looks the same"
            for sensor, fit in state.fits.items()
            if fit.is_late and state.last.t_s - state.last.monitors[sensor].stamp_s <= silent_s
        )


def _fused(state: EstimatorState | None, sensor: str) -> float:
    """Return how many poses of a sensor were fused until a state."""
    if state is None or sensor not in state.sensors:
        return 0.0
    return float(state.sensors[sensor].record[FUSED_POSES])


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
