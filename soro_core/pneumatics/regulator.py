"""A closed-loop pressure regulator as the plant sees it: delay, hysteresis, lag, rate limit, noise.

The defaults are those identified on a Festo VEAB proportional valve (first order, 52 ms) with assumptions for
what was not published (delay, hysteresis, noise); see docs/hardware.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from soro_core.config import Strict

Array: TypeAlias = NDArray[np.float64]

# In place of a time constant of 0 [s]: nothing is left of a gap after any time that a float can tell.
SHORTEST_S = 1e-200


class RegulatorModel(Strict):
    """Parameters of one kind of regulator; the same for every chamber that it feeds."""

    delay_s: float = Field(0.005, ge=0, le=1, description="dead time from set point to first effect")
    tau_s: float = Field(0.052, ge=0, le=10, description="time constant of the first-order lag; 0 for none")
    vent_tau_s: float = Field(
        0.0, ge=0, le=10, description="time constant while the pressure falls; 0 for tau_s"
    )
    gain: float = Field(1.0, gt=0, le=2, description="pressure reached over set point")
    rate_limit_pa_s: float = Field(0.0, ge=0, description="largest rate of pressure; 0 for no limit")
    hysteresis_pa: float = Field(
        900.0, ge=0, description="width of the play between set point and pressure; 0 for none"
    )
    command_resolution_pa: float = Field(50.0, ge=0, description="step of the set point; 0 for continuous")
    reading_resolution_pa: float = Field(
        100.0, ge=0, description="step of the measured pressure; 0 for continuous"
    )
    reading_noise_pa: float = Field(100.0, ge=0, description="standard deviation of the measured pressure")
    minimum_pa: float = Field(0.0, ge=-101e3, description="lowest gauge pressure that it can reach")
    maximum_pa: float = Field(90e3, description="highest gauge pressure that it can reach")

    @model_validator(mode="after")
    def _ordered(self) -> RegulatorModel:
        if not self.minimum_pa < self.maximum_pa:
            raise ValueError("minimum_pa must be below maximum_pa")
        return self

    @property
    def falling_tau_s(self) -> float:
        """Time constant while the pressure falls [s]: an exhaust is driven by less than a supply."""
        return self.vent_tau_s or self.tau_s


@dataclass(frozen=True)
class RegulatorState:
    """Pressures [Pa gauge] and what is on its way to them; every array has one entry a chamber."""

    pressure_pa: Array
    target_pa: Array
    pending: tuple[tuple[float, Array], ...] = ()


def initial_state(model: RegulatorModel, n: int, pressure_pa: float = 0.0) -> RegulatorState:
    """Return `n` chambers at rest at one pressure."""
    start = np.full(n, min(max(pressure_pa, model.minimum_pa), model.maximum_pa))
    return RegulatorState(pressure_pa=start, target_pa=start)


def step(model: RegulatorModel, state: RegulatorState, setpoint_pa: Array, dt: float) -> RegulatorState:
    """Advance by `dt` with the set points held; exact for any `dt`.

    Parameters
    ----------
    setpoint_pa : ndarray (n,)
        Set points [Pa gauge], finite; the regulator clips them to its own range as the device does.
    dt : float
        Time step [s], >= 0.
    """
    after, spans = targets(model, state, setpoint_pa, dt)
    pressure = state.pressure_pa
    for span, target in spans:
        pressure = _follow(model, pressure, target, span)
    return RegulatorState(pressure_pa=pressure, target_pa=after.target_pa, pending=after.pending)


def targets(
    model: RegulatorModel, state: RegulatorState, setpoint_pa: Array, dt: float
) -> tuple[RegulatorState, list[tuple[float, Array]]]:
    """What the regulators aim at over `dt`: the set points after dead time, resolution, play and range.

    Returns
    -------
    state : RegulatorState
        At the end, with the pressures as they were.
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
    """Pressure [Pa gauge] (n,) as the device reports it: noisy, then quantised."""
    noise = model.reading_noise_pa * rng.standard_normal(state.pressure_pa.shape[0])
    return _quantise(state.pressure_pa + noise, model.reading_resolution_pa)


def vent_time(model: RegulatorModel, from_pa: float, to_pa: float) -> float:
    """Time [s] that a vent from one gauge pressure to a lower one takes, for bounds in tests and reports."""
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
    """Backlash: the target moves only as the set point pushes it past half the width."""
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
    tau = np.where(gap < 0.0, model.falling_tau_s, model.tau_s)
    if model.rate_limit_pa_s > 0:
        # While the lag asks for more than the limit the gap closes linearly, then exponentially.
        corner = model.rate_limit_pa_s * tau
        linear = np.clip((np.abs(gap) - corner) / model.rate_limit_pa_s, 0.0, dt)
        gap = gap - np.sign(gap) * model.rate_limit_pa_s * linear
        remaining = dt - linear
    else:
        remaining = np.full_like(gap, dt)
    return target - gap * np.exp(-remaining / np.maximum(tau, SHORTEST_S))


def _quantise(value: Array, resolution: float) -> Array:
    return np.round(value / resolution) * resolution if resolution > 0 else value
