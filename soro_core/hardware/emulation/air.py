"""The air behind the registers: one regulated pressure a valve, advanced to the time it is asked for.

By default each follows its valve's set point with a lag. A twin whose chambers hold air moves it in place of
this one: it is told what the valves do, and gives back the pressures (`Air.connect_plant`, ADR 0001).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from soro_core.hardware.emulation.air_faults import (
    PNEUMATIC,
    SENSOR,
    condition_of,
    faulty_pressure,
    faulty_reading,
    faulty_target,
)
from soro_core.hardware.emulation.faults import Faults
from soro_core.hardware.port import Array
from soro_core.pneumatics.regulator import (
    RegulatorModel,
    RegulatorState,
    initial_state,
    reading,
    step,
    targets,
)
from soro_core.pneumatics.valve_condition import ValveAction, healthy


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
        self._plant_pa: Callable[[], Array | None] = lambda: None
        self._places = list(range(len(demands)))
        self._condition = healthy(len(demands))
        self._spans: list[tuple[float, Array]] = []

    def connect_plant(self, plant_pa: Callable[[], Array | None], places: Sequence[int]) -> None:
        """Let a plant move the air of the chambers at these places.

        Parameters
        ----------
        plant_pa : callable
            Gives the pressures [Pa gauge] of these chambers after the last action that was taken, or None
            while no plant moves their air: it then follows with the lag, from where it is.
        places : sequence of int
            Valve of each of these chambers.
        """
        self._plant_pa, self._places = plant_pa, list(places)

    def take_action(self) -> ValveAction:
        """What the valves of the chambers have done since the last call; no spans without a plant.

        Their condition is the one at the end: a fault or a vent within the time counts from its start.
        """
        spans, self._spans = tuple(self._spans), []
        return ValveAction(spans, self._condition).at(self._places)

    @property
    def pressure_pa(self) -> Array:
        """True pressures [Pa gauge] at the time last advanced to."""
        self._settle()
        return self._state.pressure_pa

    def advance(self, now_ns: int) -> None:
        """Advance to a time with what the valves do now; call it before that changes."""
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
        """Measured pressure of one valve [Pa gauge]; all valves are sampled together, once for each time."""
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
        """What a valve has left of a supply [Pa gauge]."""
        return min(supply_pa, self.faults.of(valve).get("supply_drop", supply_pa))

    def _settle(self) -> bool:
        """Take the pressures that a plant gives; False where there is none."""
        held = self._plant_pa()
        if held is not None:
            self._take(held)
        return held is not None

    def _take(self, pressure_pa: Array) -> None:
        pressure = self._state.pressure_pa.copy()
        pressure[self._places] = pressure_pa
        self._state = replace(self._state, pressure_pa=pressure)

    def _act(self, setpoint_pa: Array, demands: Sequence[float | None], dt: float) -> None:
        """Note what the valves do over `dt`."""
        _, spans = targets(self._model, self._state, setpoint_pa, dt)
        faults = [self.faults.of(n) for n in range(len(demands))]
        for span, target in spans:
            followed = [faulty_target(active, pa) for active, pa in zip(faults, target, strict=True)]
            self._spans.append((span, np.array(followed)))
        self._condition = condition_of(faults, [demand is None for demand in demands])

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
