"""Chamber pressures of the emulated valves, one for each valve.

By default each pressure follows the set point of its valve with a lag. A twin that models the air of its
chambers computes the pressures instead, from the actions of the valves (ADR 0001), see
`EmulatedPressures.connect_plant`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from soro_core.arrays import Array
from soro_core.pneumatics.regulator import (
    RegulatorModel,
    RegulatorState,
    initial_state,
    reading,
    step,
    targets,
)
from soro_core.pneumatics.valve_condition import ValveAction, healthy
from soro_hardware.emulation.faults.air_faults import (
    PNEUMATIC,
    SENSOR,
    condition_of,
    faulty_pressure,
    faulty_reading,
    faulty_target,
)
from soro_hardware.emulation.faults.schedule import FaultSchedule


class EmulatedPressures:
    """Chamber pressures of all valves of a platform.

    Parameters
    ----------
    model : RegulatorModel
        Dynamics of every valve.
    demands : sequence of callables
        One for each valve; returns its present set point [Pa gauge], or None while it vents (fail-safe).
    rng : numpy Generator
        Noise of the readings.
    faults : FaultSchedule, optional
        Faults of valves, lines, chambers and sensors.
    """

    def __init__(
        self,
        model: RegulatorModel,
        demands: Sequence[Callable[[], float | None]],
        rng: np.random.Generator,
        faults: FaultSchedule | None = None,
    ) -> None:
        self._model, self._demands, self._rng = model, demands, rng
        self.faults = faults or FaultSchedule()
        self._state = initial_state(model, len(demands))
        self._now_ns = 0
        self._reading_ns = -1
        self._reading: list[float] = [0.0] * len(demands)
        self._followed: list[float] = [0.0] * len(demands)
        self._plant_pa: Callable[[], Array | None] = lambda: None
        self._places = list(range(len(demands)))
        self._condition = healthy(len(demands))
        self._spans: list[tuple[float, Array]] = []

    def connect_plant(self, plant_pa: Callable[[], Array | None], places: Sequence[int]) -> None:
        """Let a plant compute the pressures of some chambers.

        Parameters
        ----------
        plant_pa : callable
            Returns the pressures (n,) [Pa gauge] of these chambers after the last `take_action`, or None
            while no plant computes them: they then follow the set points with the lag.
        places : sequence of int
            Number of the valve of each of these n chambers.
        """
        self._plant_pa, self._places = plant_pa, list(places)

    def take_action(self) -> ValveAction:
        """Return targets and condition of the valves since the last call; targets only with a plant.

        The condition is that at the end of the time, and holds for the whole of it.
        """
        spans, self._spans = tuple(self._spans), []
        return ValveAction(spans, self._condition).at(self._places)

    @property
    def pressure_pa(self) -> Array:
        """True pressures (n,) [Pa gauge] at the time of the last `advance`."""
        self._settle()
        return self._state.pressure_pa

    @property
    def demand_pa(self) -> Array:
        """Set points (n,) [Pa gauge] of the valves now, without faults of the valves; NaN while one vents."""
        demands = [demand() for demand in self._demands]
        return np.array([np.nan if demand is None else demand for demand in demands])

    def advance(self, now_ns: int) -> None:
        """Advance to a time [ns] with the present demands; call it before a demand changes."""
        if now_ns > self._now_ns:
            is_plant = self._settle()
            demands = [self._demand(n, demand()) for n, demand in enumerate(self._demands)]
            setpoint = np.array([self._setpoint(n, demand) for n, demand in enumerate(demands)])
            dt = (now_ns - self._now_ns) * 1e-9
            if is_plant:
                self._act(setpoint, demands, dt)
            before, self._state = self._state, step(self._model, self._state, setpoint, dt)
            if self.faults.is_active:
                self._distort(before, demands, dt)
            if is_plant:
                self._take(before.pressure_pa[self._places])
            self._now_ns = now_ns

    def reading_pa(self, valve: int) -> float:
        """Return the measured pressure of a valve [Pa gauge]; all valves are sampled once at each time."""
        if self._reading_ns != self._now_ns:
            self._settle()
            sampled = reading(self._model, self._state, self._rng).tolist()
            if self.faults.is_active:
                for n, held in enumerate(self._reading):
                    if not SENSOR.isdisjoint(active := self.faults.of(n)):
                        sampled[n] = faulty_reading(active, sampled[n], held, self.faults.rng)
            self._reading, self._reading_ns = sampled, self._now_ns
        return self._reading[valve]

    def supply_pa(self, valve: int, supply_pa: float) -> float:
        """Return the supply pressure [Pa gauge] at a valve, with its faults."""
        faults = self.faults.of(valve)
        supply_pa = faults.get("supply_rise", supply_pa)
        return min(supply_pa, faults.get("supply_drop", supply_pa))

    def _settle(self) -> bool:
        """Take the pressures of the plant; return False if there is none."""
        held = self._plant_pa()
        if held is not None:
            self._take(held)
        return held is not None

    def _take(self, pressure_pa: Array) -> None:
        pressure = self._state.pressure_pa.copy()
        pressure[self._places] = pressure_pa
        self._state = replace(self._state, pressure_pa=pressure)

    def _act(self, setpoint_pa: Array, demands: Sequence[float | None], dt: float) -> None:
        """Record the targets of the valves over `dt`."""
        _, spans = targets(self._model, self._state, setpoint_pa, dt)
        faults = [self.faults.of(n) for n in range(len(demands))]
        for span, target in spans:
            followed = [faulty_target(active, pa) for active, pa in zip(faults, target, strict=True)]
            self._spans.append((span, np.array(followed)))
        self._condition = condition_of(faults, [demand is None for demand in demands])

    def _demand(self, valve: int, demand_pa: float | None) -> float | None:
        """Return the set point that a valve follows, or None if it vents."""
        if demand_pa is None:
            return None
        if "setpoint_ignored" not in self.faults.of(valve):
            self._followed[valve] = demand_pa
        return self._followed[valve]

    def _setpoint(self, valve: int, demand_pa: float | None) -> float:
        if demand_pa is not None:
            return demand_pa
        # An open exhaust reaches 0 Pa gauge: cancel the hysteresis, by half of which a set point is missed.
        half = self._model.hysteresis_pa / 2
        return -half if self._state.pressure_pa[valve] >= 0 else half

    def _distort(self, before: RegulatorState, demands: Sequence[float | None], dt: float) -> None:
        pressure = self._state.pressure_pa.copy()
        for n, demand in enumerate(demands):
            if not PNEUMATIC.isdisjoint(active := self.faults.of(n)):
                was, target = float(before.pressure_pa[n]), float(self._state.target_pa[n])
                pressure[n] = faulty_pressure(active, self._model, was, target, demand is None, dt)
        self._state = replace(self._state, pressure_pa=pressure)
