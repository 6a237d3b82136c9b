"""A bias of each regulator from measured against modelled pressure; it takes up play, gain and lag."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from soro_core.arrays import Array
from soro_core.frozen import replaced
from soro_core.pneumatics.lag import SHORTEST_S, follow

# Targets that are kept for the dead time.
_KEPT = 100


@dataclass(frozen=True)
class ObserverState:
    """State of the observer.

    Attributes
    ----------
    predicted_pa, bias_pa : ndarray (n_u,)
        Pressures of the observer [Pa gauge], and what each regulator adds to its target [Pa].
    targets : tuple of ndarray (n_u,)
        Last commands after the play, the newest last [Pa gauge].
    play_pa : ndarray (n_u,)
        What the play has added to the last command [Pa].
    """

    predicted_pa: Array
    bias_pa: Array
    targets: tuple[Array, ...]
    play_pa: Array


@dataclass(frozen=True)
class RegulatorObserver:
    """Observer tau p' = target(t - dead time) + bias - p of every chamber; the target follows with play.

    Attributes
    ----------
    lag_s, dead_time_s : float
        Of the regulators; the time until a command reaches them is part of the dead time [s].
    play_pa : float
        Width of the play between command and target [Pa]. What it adds is known when the command turns; the
        bias would be late, and a position at rest goes to and fro by the play.
    bandwidth_per_s, damping : float
        Both poles of its errors. The bias is late by about 2 / bandwidth, and a faster observer passes the
        noise of the readings on to the commands.
    bound_pa : float
        Largest bias [Pa].
    """

    lag_s: float
    dead_time_s: float
    play_pa: float = 0.0
    bandwidth_per_s: float = 50.0
    damping: float = 0.9
    bound_pa: float = 6e3

    @cached_property
    def correction_per_s(self) -> float:
        """Gain of the measured minus the predicted pressure on the prediction [1/s]."""
        lag = max(self.lag_s, SHORTEST_S)
        return max(2.0 * self.damping * self.bandwidth_per_s - 1.0 / lag, 0.0)

    @cached_property
    def bias_per_s(self) -> float:
        """The same on the bias [1/s]; a regulator faster than the observer shows its bias at once."""
        return self.bandwidth_per_s * max(self.bandwidth_per_s * self.lag_s, 0.5 / self.damping)

    def initial_state(self, pressure_pa: Array) -> ObserverState:
        """Return the state at pressures (n_u,) [Pa gauge] that are also the last command."""
        nothing = np.zeros_like(pressure_pa)
        return ObserverState(pressure_pa, nothing, (pressure_pa,), nothing)

    def observe(
        self, state: ObserverState, measured_pa: Array, dt: float, part: float = 1.0
    ) -> ObserverState:
        """Return the state after a measurement.

        Parameters
        ----------
        state : ObserverState
            After the last command.
        measured_pa : ndarray (n_u,)
            Measured pressures, finite [Pa gauge].
        dt : float
            Time since the last measurement [s].
        part : float
            Part of the gain on the bias: of a command that acts later than known, the bias makes a swing.
        """
        back = min(1 + round(self.dead_time_s / dt), len(state.targets))
        acting = state.targets[-back] + state.bias_pa
        predicted = follow(state.predicted_pa, acting, dt, self.lag_s)
        missed = measured_pa - predicted
        bias = state.bias_pa + part * self.bias_per_s * dt * missed
        bias = np.minimum(np.maximum(bias, -self.bound_pa), self.bound_pa)
        corrected = predicted + min(self.correction_per_s * dt, 1.0) * missed
        return replaced(state, predicted_pa=np.asarray(corrected), bias_pa=bias)

    def commanded(self, state: ObserverState, command_pa: Array) -> ObserverState:
        """Return the state after a command (n_u,) [Pa gauge]."""
        half = 0.5 * self.play_pa
        target = np.minimum(np.maximum(state.targets[-1], command_pa - half), command_pa + half)
        targets = (*state.targets, target)[-_KEPT:]
        return replaced(state, targets=targets, play_pa=target - command_pa)
