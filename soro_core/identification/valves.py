"""Regulators and the air behind them, fitted to measured step responses and judged by them.

Level 1 is the lag of `RegulatorModel`, with one time constant or with one for each direction. Level 2 is the
flow of `ValveModel` (ISO 6358) into a chamber of constant volume, with a dead time for each direction. Both
start at the reading before a step and go to the one after it.

What steps do not tell is not fitted: of the conductances only the ratio to the volume counts, and a supply
pressure well above the set points is hidden behind the conductance.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.errors import ModelError
from soro_core.identification.fit import Fit, Parameter, Values, fit
from soro_core.identification.steps import Step, crossing
from soro_core.pneumatics.chamber import AMBIENT_PA, chamber_pressures, make_gas, masses_at
from soro_core.pneumatics.regulator import RegulatorModel, RegulatorState
from soro_core.pneumatics.regulator import step as regulator_step
from soro_core.pneumatics.valve_model import ValveModel

Array: TypeAlias = NDArray[np.float64]
Response: TypeAlias = tuple[Array, Array]
"""Times (n_t,) [s] and gauge pressures (n_t, n_steps) [Pa]."""

# Rows of a simulated response in the shorter of the two typical times to 63.2 %, which also floors them [s].
_ROWS, _SHORTEST_S = 12, 1e-3
# Error of a response, of its step, from which on it counts by its size, not its square.
_SCALE = 0.05
# Readings that a step counts for.
_SAMPLES = 50
_ITERATIONS = 60


@dataclass(frozen=True)
class FlowModel:
    """A valve, a chamber of constant volume, and the time until the valve does anything.

    Attributes
    ----------
    valves : ValveModel
    volume_m3 : float
    delay_s, vent_delay_s : float
        Dead time before a fill and before a vent [s].
    """

    valves: ValveModel
    volume_m3: float
    delay_s: float = 0.0
    vent_delay_s: float = 0.0


@dataclass(frozen=True)
class Judged:
    """A model against one step: its own time to 63.2 % [s] and its RMS error [Pa]."""

    step: Step
    t63_s: float
    rms_pa: float

    @property
    def error(self) -> float:
        """Error of the time to 63.2 %, of the measured one; infinite for a model that never gets there."""
        return abs(self.t63_s / self.step.t63_s - 1.0) if math.isfinite(self.t63_s) else math.inf


def grid(steps: Sequence[Step]) -> Array:
    """Times [s] at which responses to these steps are simulated, fitted and judged, from 0.

    To four times the longer of the typical times to 63.2 %, and past every one, in twelfths of the shorter.
    """
    typical = _typical(steps, True), _typical(steps, False)
    end = max(4.0 * max(typical), *(2.0 * step.t63_s for step in steps))
    dt = min(typical) / _ROWS
    return np.arange(math.ceil(end / dt) + 1, dtype=np.float64) * dt


def regulator_response(model: RegulatorModel, steps: Sequence[Step], t: Array | None = None) -> Response:
    """Level 1 over the steps, by default at the times of `grid`; without play, limits and resolution."""
    free = {"hysteresis_pa": 0.0, "command_resolution_pa": 0.0, "minimum_pa": -AMBIENT_PA + 400.0}
    model = model.model_copy(update={**free, "gain": 1.0, "maximum_pa": math.inf})
    start, end = _levels(steps)
    state = RegulatorState(pressure_pa=start, target_pa=start)
    t = grid(steps) if t is None else t
    # The model is exact for any time, so that each row is one step from the start.
    return t, np.array([regulator_step(model, state, end, float(at)).pressure_pa for at in t])


def flow_response(model: FlowModel, steps: Sequence[Step], t: Array | None = None) -> Response:
    """Level 2 over the steps, by default at the times of `grid`; times are evenly spaced from 0."""
    start, end = _levels(steps)
    volume = np.full(len(steps), model.volume_m3)
    gas = make_gas(model.valves, volume)
    mass, mass_end, slope = np.empty_like(volume), np.empty_like(volume), np.empty_like(volume)
    masses_at(gas, start, volume, mass)
    t = grid(steps) if t is None else t
    dt = float(t[1])
    pressure = np.tile(start, (len(t), 1))
    for k in range(1, len(t)):
        if not chamber_pressures(gas, mass, volume, volume, end, dt, mass_end, pressure[k], slope):
            raise ModelError("a chamber without air or volume")
        mass, mass_end = mass_end, mass
    for n, step in enumerate(steps):
        delay = model.delay_s if step.fill else model.vent_delay_s
        pressure[:, n] = np.interp(t - delay, t, pressure[:, n])
    return t, pressure


def judge(steps: Sequence[Step], response: Response) -> list[Judged]:
    """Compare responses with measured steps."""
    t, pressure = response
    judged = []
    for step, simulated in zip(steps, pressure.T, strict=True):
        part = (simulated - step.start_pa) / (step.end_pa - step.start_pa)
        error = _error(step, t, simulated)
        judged.append(Judged(step, crossing(t, part), float(np.sqrt(np.mean(error**2)))))
    return judged


def fit_regulator(steps: Sequence[Step], directional: bool = True) -> tuple[RegulatorModel, Fit]:
    """Level 1: dead time and time constant, by default one for each direction.

    The search starts from a tenth of the median time to 63.2 % as dead time and the rest as time constant.
    Noise and steps of the readings, and the range, are taken from the steps.
    """
    rise, fall = _typical(steps, True), _typical(steps, False)
    unknown = [Parameter("delay_s", 0.1 * min(rise, fall), 0.0, 1.0), Parameter("tau_s", rise, 1e-3, 10.0)]
    if directional:
        unknown.append(Parameter("vent_tau_s", fall, 1e-3, 10.0))
    noise = float(np.median([step.noise_pa for step in steps]))
    seen = {
        "hysteresis_pa": 0.0,
        "command_resolution_pa": 0.0,
        "reading_resolution_pa": _resolution(steps),
        "reading_noise_pa": noise,
        "maximum_pa": max(max(step.setpoint_pa) for step in steps),
    }

    def model(values: Values) -> RegulatorModel:
        return RegulatorModel.model_validate({**seen, **values})

    residuals = _residuals(steps, lambda values: regulator_response(model(values), steps))
    found = fit(unknown, residuals, max_iterations=_ITERATIONS)
    return model(found.values), found


def fit_flow(
    steps: Sequence[Step], volume_m3: float, supply_pa: float, critical_ratio: float = 0.35
) -> tuple[FlowModel, Fit]:
    """Level 2: conductances, band and dead times, for a volume and a supply that are given.

    The search starts from the conductance that would make the step in the measured time if the flow stayed
    choked, a band of a third of the typical step, and a tenth of the time to 63.2 % as dead time.
    """
    rise, fall = _typical(steps, True), _typical(steps, False)
    change = float(np.median([step.change_pa for step in steps]))
    flow = change * volume_m3 / AMBIENT_PA
    upper = 1e3 * flow / (AMBIENT_PA * min(rise, fall))
    unknown = (
        Parameter("fill_m3_s_pa", flow / ((AMBIENT_PA + supply_pa) * rise), 0.0, upper),
        Parameter("vent_m3_s_pa", flow / (AMBIENT_PA * fall), 0.0, upper),
        Parameter("band_pa", change / 3, 100.0, 1e6),
        Parameter("delay_s", 0.1 * rise, 0.0, 2.0 * rise),
        Parameter("vent_delay_s", 0.1 * fall, 0.0, 2.0 * fall),
    )
    given = {"supply_pa": supply_pa, "critical_ratio": critical_ratio}

    def model(values: Values) -> FlowModel:
        valves = {name: value for name, value in values.items() if not name.endswith("delay_s")}
        delays = {name: value for name, value in values.items() if name.endswith("delay_s")}
        return FlowModel(ValveModel.model_validate({**given, **valves}), volume_m3, **delays)

    residuals = _residuals(steps, lambda values: flow_response(model(values), steps))
    found = fit(unknown, residuals, max_iterations=_ITERATIONS)
    return model(found.values), found


def _residuals(steps: Sequence[Step], response: Callable[[Values], Response]) -> Callable[[Values], Array]:
    def of(values: Values) -> Array:
        t, pressure = response(values)
        errors = (
            _error(step, t, simulated) * (_weight(step, t) / step.change_pa)
            for step, simulated in zip(steps, pressure.T, strict=True)
        )
        return np.concatenate(list(errors))

    return of


def _weight(step: Step, t: Array) -> float:
    """So that every step counts the same, however many readings there are of it."""
    return math.sqrt(_SAMPLES / np.count_nonzero(step.t <= t[-1])) / _SCALE


def _error(step: Step, t: Array, simulated: Array) -> Array:
    seen = step.t <= t[-1]
    error: Array = np.interp(step.t[seen], t, simulated) - step.pressure[seen]
    return error


def _levels(steps: Sequence[Step]) -> tuple[Array, Array]:
    if not steps:
        raise ModelError("no steps to simulate: a fit needs one or more")
    return np.array([step.start_pa for step in steps]), np.array([step.end_pa for step in steps])


def _typical(steps: Sequence[Step], fill: bool) -> float:
    """Median time to 63.2 % in one direction, or in the other where there is none."""
    times = [step.t63_s for step in steps if step.fill == fill] or [step.t63_s for step in steps]
    if not times:
        raise ModelError("no steps to fit: needs one or more")
    return max(float(np.median(times)), _SHORTEST_S)


def _resolution(steps: Sequence[Step]) -> float:
    """Step of the readings [Pa], as far as numbers in a file tell it: least difference, of a typical step."""
    apart = [np.diff(np.unique(step.pressure)) for step in steps]
    least = [float(one.min()) for one in apart if one.size]
    return float(np.median(least)) if least else 0.0
