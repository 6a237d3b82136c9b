"""Model of a pump whose duty cycle a PI controller sets, fitted to recorded steps.

The air is that of `ValveModel`: the pump is a supply at its stall pressure behind a sonic conductance in
proportion to the duty cycle; the loss through its check valves is a leak. The controller saturates, and stops
integrating in saturation. Far from the set point it may give full power without integrating, the anti-wind-up
of small boards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.pneumatics.chamber import chamber_pressures, make_gas, masses_at
from soro_core.pneumatics.valve_model import ValveModel
from soro_lab.identification.candidates import Values
from soro_lab.identification.fit import Fit, Parameter, fit
from soro_lab.identification.steps import crossing
from soro_lab.identification.valves import CRITICAL_RATIO

# Time step of a pump that a recorded duty cycle drives [s].
PERIOD_S = 0.01
# Scale of the robust loss: larger errors count linearly [Pa].
_SCALE_PA = 1e3


@dataclass(frozen=True)
class InnerPI:
    """PI controller of a duty cycle, sampled.

    Attributes
    ----------
    proportional : float
        Proportional gain: duty cycle, 0 to 1, per error [1/Pa].
    integral : float
        Integral gain [1/(Pa s)].
    full_above_pa : float
        Beyond this error the duty cycle is 1 and the integral 0 [Pa]; infinite for never.
    period_s : float
        Sampling period [s].
    """

    proportional: float
    integral: float
    full_above_pa: float = np.inf
    period_s: float = 0.01

    def duty(self, error_pa: float, integrated: float) -> tuple[float, float]:
        """Return the duty cycle for an error [Pa], and the integral of the error [Pa s] after this period."""
        if error_pa > self.full_above_pa:
            return 1.0, 0.0
        after = integrated + error_pa * self.period_s
        wanted = self.proportional * error_pa + self.integral * after
        winds_up = (wanted > 1.0 and error_pa > 0.0) or (wanted < 0.0 and error_pa < 0.0)
        return min(max(wanted, 0.0), 1.0), integrated if winds_up else after


@dataclass(frozen=True)
class PumpRun:
    """One recorded step of the set point from rest.

    Attributes
    ----------
    run : str
        Name of the run.
    control : InnerPI or None
        Controller of the run; None where the recorded duty cycle drives the pump.
    target_pa : float
        Set point [Pa gauge].
    t, pressure, duty : arrays of shape (n,)
        Time [s], pressure [Pa gauge], duty cycle, 0 to 1.
    """

    run: str
    control: InnerPI | None
    target_pa: float
    t: Array
    pressure: Array
    duty: Array

    @property
    def levels_pa(self) -> tuple[float, float]:
        """Pressures at the start and over the last tenth of the run [Pa gauge]."""
        return float(self.pressure[0]), float(np.median(self.pressure[self.t >= 0.9 * self.t[-1]]))

    @property
    def period_s(self) -> float:
        """Time between two values of the duty cycle in a simulation [s]."""
        return PERIOD_S if self.control is None else self.control.period_s

    @property
    def t63_s(self) -> float:
        """Time to 63.2 % of the change of pressure [s]."""
        return crossing(self.t, part_of(self.pressure, self.levels_pa))


@dataclass(frozen=True)
class PumpModel:
    """Air, volume and dead time of a pump and its chamber."""

    valves: ValveModel
    volume_m3: float
    delay_s: float


def model_t63(model: PumpModel, run: PumpRun) -> float:
    """Return the time of the model to 63.2 % of its own way, from its start to its last tenth [s]."""
    t, pressure, _ = pump_response(model, run)
    levels = float(pressure[0]), float(np.median(pressure[t >= 0.9 * run.t[-1]]))
    return crossing(t, part_of(pressure, levels))


def part_of(pressure: Array, levels_pa: tuple[float, float]) -> Array:
    """Return pressures relative to two levels: 0 at the first, 1 at the second."""
    start, end = levels_pa
    part: Array = (pressure - start) / (end - start)
    return part


def pump_response(model: PumpModel, run: PumpRun) -> tuple[Array, Array, Array]:
    """Simulate a run.

    Returns
    -------
    t, pressure, duty : ndarray (n,)
        Times [s], pressures [Pa gauge] and duty cycles, one for each period of the controller.

    Raises
    ------
    ModelError
        If the chamber has no air or no volume.
    """
    control = run.control
    t = np.arange(0.0, run.t[-1] + run.period_s, run.period_s)
    volume = np.array([model.volume_m3])
    gas = make_gas(model.valves, volume)
    mass, mass_end, slope = np.empty(1), np.empty(1), np.empty(1)
    pressure, duties = np.full((len(t), 1), run.pressure[0]), np.zeros(len(t))
    masses_at(gas, pressure[0], volume, mass)
    stall = np.array([model.valves.supply_pa])
    integrated = 0.0
    if control is None:
        duties = run.duty[np.clip(np.searchsorted(run.t, t, side="right") - 1, 0, None)]
    for k in range(1, len(t)):
        if control is not None:
            duties[k - 1], integrated = control.duty(run.target_pa - float(pressure[k - 1, 0]), integrated)
        # The conductance stands for the opening: the set point is the stall pressure, and the band is narrow.
        driven = gas._replace(fill=gas.fill * duties[k - 1])
        if not chamber_pressures(
            driven, mass, volume, volume, stall, run.period_s, mass_end, pressure[k], slope
        ):
            raise ModelError("a chamber without air or volume", "volume")
        mass, mass_end = mass_end, mass
    duties[-1] = duties[-2]
    late = t - model.delay_s
    return t, np.interp(late, t, pressure[:, 0]), np.where(late < 0.0, 0.0, np.interp(late, t, duties))


def fit_pump(runs: Sequence[PumpRun], volume_m3: float) -> tuple[PumpModel, Fit]:
    """Fit conductance, stall pressure, leak and dead time to recorded steps, for a given volume [m^3].

    The search starts from a stall pressure 2 kPa above the highest level, the conductance that fills the
    volume at the measured rate, a leak of a hundredth of it, and a dead time of 30 ms.

    Returns
    -------
    model : PumpModel
    found : Fit

    Raises
    ------
    ModelError
        If the start cannot be simulated.
    """
    top = max(run.levels_pa[1] for run in runs)
    rate = float(np.median([(run.levels_pa[1] - run.levels_pa[0]) / run.t63_s for run in runs]))
    flow = volume_m3 * rate / 1e10
    unknown = (
        Parameter("fill_m3_s_pa", flow, 0.01 * flow, 100.0 * flow),
        Parameter("leak_m3_s_pa", 0.01 * flow, 0.0, 10.0 * flow),
        Parameter("supply_pa", top + 2e3, 0.5 * top, 3.0 * top),
        Parameter("delay_s", 0.03, 0.0, 0.5),
    )

    def model(values: Values) -> PumpModel:
        valves = {name: value for name, value in values.items() if name != "delay_s"}
        given = {"critical_ratio": CRITICAL_RATIO, "vent_m3_s_pa": 0.0, "band_pa": 1.0}
        return PumpModel(ValveModel.model_validate({**given, **valves}), volume_m3, values["delay_s"])

    def residuals(values: Values) -> Array:
        built = model(values)
        return np.concatenate([errors(run, pump_response(built, run)) / _SCALE_PA for run in runs])

    found = fit(unknown, residuals)
    return model(found.values), found


def errors(run: PumpRun, response: tuple[Array, Array, Array]) -> Array:
    """Return simulated minus measured pressures [Pa] at the times of the readings."""
    difference: Array = np.interp(run.t, response[0], response[1]) - run.pressure
    return difference
