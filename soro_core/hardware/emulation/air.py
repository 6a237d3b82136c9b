"""The air behind the registers: one regulated pressure a valve, advanced to the time it is asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from soro_core.hardware.emulation.air_faults import PNEUMATIC, SENSOR, faulty_pressure, faulty_reading
from soro_core.hardware.emulation.faults import Faults
from soro_core.hardware.port import Array
from soro_core.pneumatics.regulator import RegulatorModel, RegulatorState, initial_state, reading, step


class Air:
    """Chamber pressures of all valves of a platform.

    Parameters
    ----------
    model : RegulatorModel
        Dynamics of every valve.
    demands : sequence of callables
        For each valve what it does now: a set point [Pa gauge], or None while it vents (fail-safe).
    rng : numpy Generator
        Noise of the readings.

    Attributes
    ----------
    faults : Faults
        Of valves, lines, chambers and sensors.
    """

    def __init__(
        self, model: RegulatorModel, demands: Sequence[Callable[[], float | None]], rng: np.random.Generator
    ) -> None:
        self._model, self._demands, self._rng = model, demands, rng
        self.faults = Faults()
        self._state = initial_state(model, len(demands))
        self._now_ns = 0
        self._reading_ns = -1
        self._reading: list[float] = [0.0] * len(demands)
        self._followed: list[float] = [0.0] * len(demands)

    @property
    def pressure_pa(self) -> Array:
        """True pressures [Pa gauge] at the time last advanced to."""
        return self._state.pressure_pa

    def advance(self, now_ns: int) -> None:
        """Advance to a time with what the valves do now; call it before that changes."""
        if now_ns > self._now_ns:
            demands = [self._demand(n, demand()) for n, demand in enumerate(self._demands)]
            setpoint = np.array([self._setpoint(n, demand) for n, demand in enumerate(demands)])
            dt = (now_ns - self._now_ns) * 1e-9
            before, self._state = self._state, step(self._model, self._state, setpoint, dt)
            if self.faults.is_active:
                self._distort(before, demands, dt)
            self._now_ns = now_ns

    def reading_pa(self, valve: int) -> float:
        """Measured pressure of one valve [Pa gauge]; all valves are sampled together, once for each time."""
        if self._reading_ns != self._now_ns:
            sampled = reading(self._model, self._state, self._rng).tolist()
            if self.faults.is_active:
                for n, held in enumerate(self._reading):
                    if not SENSOR.isdisjoint(active := self.faults.of(n)):
                        sampled[n] = faulty_reading(active, sampled[n], held, self.faults.rng)
            self._reading, self._reading_ns = sampled, self._now_ns
        return self._reading[valve]

    def supply_pa(self, valve: int, supply_pa: float) -> float:
        """What a valve has left of a supply [Pa gauge]."""
        return min(supply_pa, self.faults.of(valve).get("supply_drop", supply_pa))

    def _demand(self, valve: int, demand_pa: float | None) -> float | None:
        """What a valve really follows: one that ignores its set points keeps the last, and still lets go."""
        if demand_pa is None:
            return None
        if "setpoint_ignored" not in self.faults.of(valve):
            self._followed[valve] = demand_pa
        return self._followed[valve]

    def _setpoint(self, valve: int, demand_pa: float | None) -> float:
        if demand_pa is not None:
            return demand_pa
        # An open exhaust ends at 0 gauge, without the half width by which a closed loop's play stops short.
        half = self._model.hysteresis_pa / 2
        return -half if self._state.pressure_pa[valve] >= 0 else half

    def _distort(self, before: RegulatorState, demands: Sequence[float | None], dt: float) -> None:
        pressure = self._state.pressure_pa.copy()
        for n, demand in enumerate(demands):
            if not PNEUMATIC.isdisjoint(active := self.faults.of(n)):
                was, target = float(before.pressure_pa[n]), float(self._state.target_pa[n])
                pressure[n] = faulty_pressure(active, self._model, was, target, demand is None, dt)
        self._state = replace(self._state, pressure_pa=pressure)
