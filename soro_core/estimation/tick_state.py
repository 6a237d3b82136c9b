"""State of the estimator under way: what one tick changes."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from soro_core.arrays import Array
from soro_core.estimation.force.state import ForceState
from soro_core.estimation.kernel.belief import Belief
from soro_core.estimation.learned_input import LearnedInput
from soro_core.estimation.sensors.monitor import Innovation, SensorMonitor
from soro_core.estimation.sensors.samples import Sample
from soro_core.estimation.state import EstimatorState, Segment, Sensor
from soro_core.estimation.status import Counts

# Place of each count.
_PLACES = {name: i for i, name in enumerate(Counts._fields)}


class TickState:
    """A copy of the state that may change; its attributes are those of `EstimatorState`.

    A new frozen value at each change would take longer than the change.

    Parameters
    ----------
    state : EstimatorState
        State after the last tick.
    dt : float
        Time since then [s].
    """

    def __init__(self, state: EstimatorState, dt: float) -> None:
        self.start_s, self.dt = state.t_s, dt
        self.t_s = state.t_s + dt
        self.belief: Belief = state.belief
        self.pressure_pa: Array = state.pressure_pa
        self.history: list[Segment] = [*state.history]
        self.waiting: tuple[Sample, ...] = state.waiting
        self.stamps: dict[str, float] = dict(state.stamps)
        self.last_s = state.last_s
        self.position_s = state.position_s
        self.sensors: dict[str, Sensor] = dict(state.sensors)
        self.known: LearnedInput = state.known
        self.monitors: Mapping[str, SensorMonitor] = state.monitors
        self.counts = [*state.counts]
        self.force: ForceState = state.force
        self.innovations: list[Innovation] = []
        """Of the new samples, in the order of their stamps."""

    def count(self, *names: str) -> None:
        """Add one to each of these counts."""
        for name in names:
            self.counts[_PLACES[name]] += 1

    def read(self, measured: Array) -> None:
        """Take the measured pressures (n_u,), and the last good one of a chamber without a finite reading."""
        if all(map(math.isfinite, measured.tolist())):
            self.pressure_pa = measured
            return
        self.pressure_pa = np.where(np.isfinite(measured), measured, self.pressure_pa)
        self.count("pressures")

    def extend(self, pressure_pa: Array, parts: int, kept: int) -> None:
        """Append the new step to the history, to be predicted by `replay`.

        Parameters
        ----------
        pressure_pa : ndarray (n_u,)
            Pressures in the step [Pa gauge].
        parts : int
            Segments into which it is divided.
        kept : int
            Segments to keep.
        """
        start_s, dt, history = self.start_s, self.dt, self.history
        for i in range(parts):
            begin_s, end_s = start_s + dt * i / parts, start_s + dt * (i + 1) / parts
            history.append(Segment(begin_s, end_s, pressure_pa, self.belief, (), self.known))
        del history[:-kept]

    def result(self) -> EstimatorState:
        """Return the state after the tick."""
        return EstimatorState(
            self.t_s,
            self.belief,
            self.pressure_pa,
            tuple(self.history),
            self.waiting,
            self.stamps,
            self.last_s,
            self.position_s,
            self.sensors,
            self.known,
            self.monitors,
            Counts(*self.counts),
            self.force,
        )
