"""Model of a closed-loop pressure regulator: delay, hysteresis, lag, rate limit, noise.

The default lag is that identified on a Festo VEAB proportional valve (first order, 52 ms); delay, hysteresis
and noise are assumptions, see docs/hardware.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from pydantic import Field, model_validator

from soro_core.arrays import Array
from soro_core.config import Strict
from soro_core.pneumatics.lag import follow

_MOST_PA = 1e8  # no pneumatic regulator has more


class RegulatorModel(Strict):
    """Parameters of one kind of regulator; the same for every chamber that it feeds."""

    delay_s: float = Field(0.005, ge=0, le=1, description="dead time from set point to first effect")
    tau_s: float = Field(0.052, ge=0, le=10, description="time constant of the first-order lag; 0 for none")
    vent_tau_s: float = Field(
        0.0, ge=0, le=10, description="time constant while the pressure falls; 0 for tau_s"
    )
    gain: float = Field(1.0, gt=0, le=2, description="ratio of reached pressure to set point")
    rate_limit_pa_s: float = Field(0.0, ge=0, le=1e12, description="largest rate of pressure; 0 for no limit")
    hysteresis_pa: float = Field(
        900.0, ge=0, le=_MOST_PA, description="width of the play between set point and pressure; 0 for none"
    )
    command_resolution_pa: float = Field(
        50.0, ge=0, le=_MOST_PA, description="step of the set point; 0 for continuous"
    )
    reading_resolution_pa: float = Field(
        100.0, ge=0, le=_MOST_PA, description="step of the measured pressure; 0 for continuous"
    )
    reading_noise_pa: float = Field(
        100.0, ge=0, le=_MOST_PA, description="standard deviation of the measured pressure"
    )
    minimum_pa: float = Field(
        0.0, ge=-101e3, le=_MOST_PA, description="lowest gauge pressure that the regulator can reach"
    )
    maximum_pa: float = Field(
        90e3, ge=-101e3, le=_MOST_PA, description="highest gauge pressure that the regulator can reach"
    )

    @model_validator(mode="after")
    def _ordered(self) -> RegulatorModel:
        if not self.minimum_pa < self.maximum_pa:
            raise ValueError("minimum_pa must be below maximum_pa")
        return self

    @property
    def falling_tau_s(self) -> float:
        """Time constant while the pressure falls [s]; the exhaust has the smaller pressure difference."""
        return self.vent_tau_s or self.tau_s


@dataclass(frozen=True)
class RegulatorState:
    """State of regulators.

    Attributes
    ----------
    pressure_pa, target_pa : ndarray (n,)
        Pressures, and set points after dead time, resolution, play and range [Pa gauge].
    pending : tuple of (float, ndarray (n,))
        Set points within the dead time [Pa gauge], each with the time left [s].
    """

    pressure_pa: Array
    target_pa: Array
    pending: tuple[tuple[float, Array], ...] = ()


def initial_state(model: RegulatorModel, n: int, pressure_pa: float = 0.0) -> RegulatorState:
    """Return the state of chambers at rest.

    Parameters
    ----------
    model : RegulatorModel
        Parameters of the regulators.
    n : int
        Number of chambers.
    pressure_pa : float
        Pressure of all chambers [Pa gauge], limited to the range.

    Returns
    -------
    RegulatorState
    """
    start = np.full(n, min(max(pressure_pa, model.minimum_pa), model.maximum_pa))
    return RegulatorState(pressure_pa=start, target_pa=start)


def step(model: RegulatorModel, state: RegulatorState, setpoint_pa: Array, dt: float) -> RegulatorState:
    """Return the state after `dt` with the set points held; exact for any `dt`.

    Parameters
    ----------
    model : RegulatorModel
        Parameters of the regulators.
    state : RegulatorState
        State at the start.
    setpoint_pa : ndarray (n,)
        Set points [Pa gauge], finite; the regulator clips them to its range, as the device does.
    dt : float
        Time step [s], >= 0.

    Returns
    -------
    RegulatorState
    """
    after, spans = targets(model, state, setpoint_pa, dt)
    pressure = state.pressure_pa
    for span, target in spans:
        pressure = _follow(model, pressure, target, span)
    return RegulatorState(pressure_pa=pressure, target_pa=after.target_pa, pending=after.pending)


def targets(
    model: RegulatorModel, state: RegulatorState, setpoint_pa: Array, dt: float
) -> tuple[RegulatorState, list[tuple[float, Array]]]:
    """Return the targets over `dt`: the set points after dead time, resolution, play and range.

    Parameters
    ----------
    model : RegulatorModel
        Parameters of the regulators.
    state : RegulatorState
        State at the start.
    setpoint_pa : ndarray (n,)
        Set points [Pa gauge].
    dt : float
        Time step [s], >= 0.

    Returns
    -------
    state : RegulatorState
        State at the end, but with the pressures of the start.
    spans : list of (float, ndarray (n,))
        Times [s], 0 or more, that add up to `dt`, each with the target [Pa gauge] held over it.
    """
    target = state.target_pa
    events = [*state.pending, (model.delay_s, np.asarray(setpoint_pa, dtype=np.float64))]
    now, later, spans = 0.0, [], []
    for due, setpoint in events:
        if due > dt:
            later.append((due - dt, setpoint))
            continue
        spans.append((max(due - now, 0.0), target))
        target, now = _play(model, target, setpoint), max(due, now)
    spans.append((dt - now, target))
    return RegulatorState(pressure_pa=state.pressure_pa, target_pa=target, pending=tuple(later)), spans


def reading(model: RegulatorModel, state: RegulatorState, rng: np.random.Generator) -> Array:
    """Return the pressures that the devices report: with noise, then quantised.

    Parameters
    ----------
    model : RegulatorModel
        Noise and resolution.
    state : RegulatorState
        True pressures.
    rng : numpy.random.Generator
        Source of the noise.

    Returns
    -------
    ndarray (n,)
        Readings [Pa gauge].
    """
    noise = model.reading_noise_pa * rng.standard_normal(state.pressure_pa.shape[0])
    return _quantise(state.pressure_pa + noise, model.reading_resolution_pa)


def vent_time(model: RegulatorModel, from_pa: float, to_pa: float) -> float:
    """Return the time of a vent from one gauge pressure to a lower one.

    Parameters
    ----------
    model : RegulatorModel
        Parameters of the regulator.
    from_pa, to_pa : float
        Pressures at the start and at the end [Pa gauge].

    Returns
    -------
    float
        Time [s]; infinite if the play stops the vent above `to_pa`.
    """
    target = model.hysteresis_pa / 2
    if to_pa <= target:
        return math.inf
    if from_pa <= to_pa:
        return 0.0
    fall = model.delay_s
    if model.rate_limit_pa_s > 0:
        corner = model.rate_limit_pa_s * model.falling_tau_s + target
        if from_pa > corner:
            end = max(corner, to_pa)
            fall += (from_pa - end) / model.rate_limit_pa_s
            from_pa = end
    if from_pa > to_pa:
        fall += model.falling_tau_s * math.log((from_pa - target) / (to_pa - target))
    return fall


def _play(model: RegulatorModel, target: Array, setpoint: Array) -> Array:
    """Return the target after backlash: the set point moves it only beyond half the width of the play."""
    wanted = model.gain * _quantise(setpoint, model.command_resolution_pa)
    half = model.hysteresis_pa / 2
    moved = np.minimum(np.maximum(target, wanted - half), wanted + half)
    return np.minimum(np.maximum(moved, model.minimum_pa), model.maximum_pa)


def _follow(model: RegulatorModel, pressure: Array, target: Array, dt: float) -> Array:
    """First-order lag with limited rate, solved exactly over `dt`."""
    if dt <= 0.0:
        return pressure
    gap = target - pressure
    # The gap never changes its sign, so that one time constant holds for each chamber.
    rising, falling = model.tau_s, model.falling_tau_s
    tau = rising if rising == falling else np.where(gap < 0.0, falling, rising)
    if model.rate_limit_pa_s == 0:
        return follow(pressure, target, dt, tau)
    # While the lag asks for more than the limit the gap closes linearly, then exponentially.
    corner = model.rate_limit_pa_s * tau
    linear = np.clip((np.abs(gap) - corner) / model.rate_limit_pa_s, 0.0, dt)
    return follow(pressure + np.sign(gap) * model.rate_limit_pa_s * linear, target, dt - linear, tau)


def _quantise(value: Array, resolution: float) -> Array:
    return np.rint(value / resolution) * resolution if resolution > 0 else value
