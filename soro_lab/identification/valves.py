"""Models of regulators and the air behind them, fitted to measured step responses.

Level 1 is the lag of `RegulatorModel`, with one time constant or with one for each direction. Level 2 is the
flow of `ValveModel` (ISO 6358) into a chamber of constant volume, with a dead time for each direction. Both
start at the reading before a step and end at the reading after it.

Parameters that steps do not determine are given, not fitted: only the ratio of conductance to volume has an
effect, and a supply pressure well above the set points is equivalent to a larger conductance.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.pneumatics.chamber import AMBIENT_PA, chamber_pressures, make_gas, masses_at
from soro_core.pneumatics.regulator import RegulatorModel, RegulatorState
from soro_core.pneumatics.regulator import step as regulator_step
from soro_core.pneumatics.valve_model import ValveModel
from soro_lab.identification.candidates import Values
from soro_lab.identification.fit import Fit, Parameter, fit
from soro_lab.identification.steps import Step, crossing

Response: TypeAlias = tuple[Array, Array]
"""Times (n_t,) [s] and gauge pressures (n_t, n_steps) [Pa]."""

# Rows of a simulated response within the shorter typical time to 63.2 %, and the least such time [s].
_ROWS, _SHORTEST_S = 12, 1e-3
# Scale of the robust loss, as a part of the step: larger errors count linearly.
_SCALE = 0.05
# Number of readings that each step is weighted to.
_SAMPLES = 50
# Critical pressure ratio b of ISO 6358.
CRITICAL_RATIO = 0.35
_ITERATIONS = 60


@dataclass(frozen=True)
class FlowModel:
    """A valve with dead times, and a chamber of constant volume.

    Attributes
    ----------
    valves : ValveModel
        Valve.
    volume_m3 : float
        Volume [m^3].
    delay_s, vent_delay_s : float
        Dead time before a fill and before a vent [s].
    """

    valves: ValveModel
    volume_m3: float
    delay_s: float = 0.0
    vent_delay_s: float = 0.0


@dataclass(frozen=True)
class Judged:
    """Result of a model for one step: its time to 63.2 % [s] and its RMS error [Pa]."""

    step: Step
    t63_s: float
    rms_pa: float

    @property
    def error(self) -> float:
        """Relative error of the time to 63.2 %; infinite for a model that never reaches it."""
        return abs(self.t63_s / self.step.t63_s - 1.0) if math.isfinite(self.t63_s) else math.inf


def grid(steps: Sequence[Step]) -> Array:
    """Return the times [s] at which responses to these steps are simulated, from 0.

    The grid ends after four times the longer typical time to 63.2 %, and after twice each measured one; its
    step is a twelfth of the shorter typical time.
    """
    typical = _typical(steps, True), _typical(steps, False)
    end = max(4.0 * max(typical), *(2.0 * step.t63_s for step in steps))
    dt = min(typical) / _ROWS
    return np.arange(math.ceil(end / dt) + 1, dtype=np.float64) * dt


def regulator_response(model: RegulatorModel, steps: Sequence[Step], t: Array | None = None) -> Response:
    """Simulate level 1 over steps, without play, limits and resolution.

    Parameters
    ----------
    model : RegulatorModel
        Dead time and time constants.
    steps : sequence of Step
        Measured steps.
    t : ndarray (n_t,), optional
        Times [s]; those of `grid` by default.
    """
    free = {"hysteresis_pa": 0.0, "command_resolution_pa": 0.0, "minimum_pa": -AMBIENT_PA + 400.0}
    # Not `with_changes`: no bound at all is no allowed value of a file.
    model = model.model_copy(update={**free, "gain": 1.0, "maximum_pa": math.inf})
    start, end = _levels(steps)
    state = RegulatorState(pressure_pa=start, target_pa=start)
    t = grid(steps) if t is None else t
    # The model is exact for any time: each row is one step from the start.
    return t, np.array([regulator_step(model, state, end, float(at)).pressure_pa for at in t])


def flow_response(model: FlowModel, steps: Sequence[Step], t: Array | None = None) -> Response:
    """Simulate level 2 over steps.

    Parameters
    ----------
    model : FlowModel
        Valve, volume and dead times.
    steps : sequence of Step
        Measured steps.
    t : ndarray (n_t,), optional
        Evenly spaced times from 0 [s]; those of `grid` by default.

    Raises
    ------
    ModelError
        If a chamber has no air or no volume.
    """
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
            raise ModelError("a chamber without air or volume", "volume")
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
    """Fit level 1: dead time and time constant, by default one for each direction.

    The search starts from a tenth of the median time to 63.2 % as dead time, and this time as time constant.
    Noise and resolution of the readings, and the range, are those of the steps.
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
    steps: Sequence[Step],
    volume_m3: float,
    supply_pa: float,
    directional: bool = True,
) -> tuple[FlowModel, Fit]:
    """Fit level 2: conductances, band and dead times for a given volume and supply.

    The search starts from the conductance that makes the step in the measured time with choked flow, a band
    of a third of the typical step, and a tenth of the time to 63.2 % as dead time.

    Parameters
    ----------
    steps : sequence of Step
    volume_m3 : float
        Volume of each chamber [m^3].
    supply_pa : float
        Pressure of the supply [Pa gauge].
    directional : bool
        Whether fills and vents have a band each.

    Returns
    -------
    model : FlowModel
    found : Fit

    Raises
    ------
    ModelError
        If there are no steps, or the start cannot be simulated.
    """
    rise, fall = _typical(steps, True), _typical(steps, False)
    change = float(np.median([step.change_pa for step in steps]))
    flow = change * volume_m3 / AMBIENT_PA
    upper = 1e3 * flow / (AMBIENT_PA * min(rise, fall))
    unknown = [
        Parameter("fill_m3_s_pa", flow / ((AMBIENT_PA + supply_pa) * rise), 0.0, upper),
        Parameter("vent_m3_s_pa", flow / (AMBIENT_PA * fall), 0.0, upper),
        Parameter("band_pa", change / 3, 100.0, 1e6),
        Parameter("delay_s", 0.1 * rise, 0.0, 2.0 * rise),
        Parameter("vent_delay_s", 0.1 * fall, 0.0, 2.0 * fall),
    ]
    if directional:
        unknown.append(Parameter("vent_band_pa", change / 3, 100.0, 1e6))
    given = {"supply_pa": supply_pa, "critical_ratio": CRITICAL_RATIO}

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
    """Return the weight that gives all steps the same influence, for any number of readings."""
    return math.sqrt(_SAMPLES / np.count_nonzero(step.t <= t[-1])) / _SCALE


def _error(step: Step, t: Array, simulated: Array) -> Array:
    seen = step.t <= t[-1]
    error: Array = np.interp(step.t[seen], t, simulated) - step.pressure[seen]
    return error


def _levels(steps: Sequence[Step]) -> tuple[Array, Array]:
    if not steps:
        raise ModelError("no steps to simulate: a fit needs one or more", "steps")
    return np.array([step.start_pa for step in steps]), np.array([step.end_pa for step in steps])


def _typical(steps: Sequence[Step], fill: bool) -> float:
    """Return the median time to 63.2 % [s] in one direction, or in the other if the first has no step."""
    times = [step.t63_s for step in steps if step.fill == fill] or [step.t63_s for step in steps]
    if not times:
        raise ModelError("no steps to fit: needs one or more", "steps")
    return max(float(np.median(times)), _SHORTEST_S)


def _resolution(steps: Sequence[Step]) -> float:
    """Return the resolution of the readings [Pa]: the median over steps of their least difference."""
    apart = [np.diff(np.unique(step.pressure)) for step in steps]
    least = [float(one.min()) for one in apart if one.size]
    return float(np.median(least)) if least else 0.0
