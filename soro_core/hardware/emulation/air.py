"""The air behind the registers: one regulated pressure a valve, advanced to the time it is asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from soro_core.hardware.port import Array
from soro_core.pneumatics.regulator import RegulatorModel, initial_state, reading, step


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
    """

    def __init__(
        self, model: RegulatorModel, demands: Sequence[Callable[[], float | None]], rng: np.random.Generator
    ) -> None:
        self._model, self._demands, self._rng = model, demands, rng
        self._state = initial_state(model, len(demands))
        self._now_ns = 0
        self._reading_ns = -1
        self._reading: list[float] = []

    @property
    def pressure_pa(self) -> Array:
        """True pressures [Pa gauge] at the time last advanced to."""
        return self._state.pressure_pa

    def advance(self, now_ns: int) -> None:
        """Advance to a time with what the valves do now; call it before that changes."""
        if now_ns > self._now_ns:
            setpoint = np.array([self._setpoint(n, demand()) for n, demand in enumerate(self._demands)])
            self._state = step(self._model, self._state, setpoint, (now_ns - self._now_ns) * 1e-9)
            self._now_ns = now_ns

    def reading_pa(self, valve: int) -> float:
        """Measured pressure of one valve [Pa gauge]; all valves are sampled together, once for each time."""
        if self._reading_ns != self._now_ns:
            self._reading = reading(self._model, self._state, self._rng).tolist()
            self._reading_ns = self._now_ns
        return self._reading[valve]

    def _setpoint(self, valve: int, demand_pa: float | None) -> float:
        if demand_pa is not None:
            return demand_pa
        # An open exhaust ends at 0 gauge, without the half width by which a closed loop's play stops short.
        half = self._model.hysteresis_pa / 2
        return -half if self._state.pressure_pa[valve] >= 0 else half
