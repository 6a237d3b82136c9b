"""What a fit compares: whole runs, and states at rest, with the coordinates of an arm at their samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.errors import ModelError
from soro_core.identification.recording.recording import Recording
from soro_core.identification.recording.streams import Shape
from soro_core.integrate import simulate
from soro_core.model import SoftArm
from soro_core.model.statics import equilibrium

Array: TypeAlias = NDArray[np.float64]
Interval: TypeAlias = tuple[float, float]
ALWAYS: tuple[Interval, ...] = ((-np.inf, np.inf),)


class Case(Protocol):
    """Measured streams, and the coordinates that an arm has at their samples."""

    @property
    def name(self) -> str:
        """Name of the case, for messages and reports."""
        ...

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """What was seen, without what is not compared."""
        ...

    @property
    def block_s(self) -> float:
        """Length [s] of what counts as one witness."""
        ...

    def coordinates(self, arm: SoftArm) -> list[Array]:
        """Return the coordinates (n, n_q) at the samples of each shape.

        Raises
        ------
        ModelError
            If the arm has none there: no balance, or a simulation that fails.
        """
        ...


@dataclass(frozen=True)
class Whole:
    """A run, simulated under its measured pressures from the balance of the first.

    Attributes
    ----------
    recording : Recording
    dt : float
        Step of the simulation [s].
    judged : tuple of (start, end)
        Times [s] that are compared; the simulation covers all before them too.
    rate_hz : float
        Largest number of samples a second that are compared.
    block_s : float
        Length [s] of what counts as one witness.
    """

    recording: Recording
    dt: float = 0.005
    judged: tuple[Interval, ...] = ALWAYS
    rate_hz: float = 50.0
    block_s: float = 1.0

    @property
    def name(self) -> str:
        """Name of the run."""
        return self.recording.name

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """Samples within the intervals, thinned."""
        first, last = self.recording.span
        return tuple(
            s.rows(_within(s.t, self.judged) & _within(s.t, ((first, last),)) & _thinned(s.t, self.rate_hz))
            for s in self.recording.shapes
        )

    def coordinates(self, arm: SoftArm) -> list[Array]:
        """Return the coordinates of a simulation from rest."""
        times, table = self._pressures
        q0 = equilibrium(arm, table[0, 0])
        dt = self.dt
        result = simulate(arm, q0, np.zeros(arm.n_q), t_end=(len(times) - 1) * dt, dt=dt, pressure=table)
        q = np.asarray(result.q, float)
        if len(q) != len(times) or not np.isfinite(q).all():
            raise ModelError(
                f"{self.name} failed after {result.t[-1]:.3g} s: {result.status.message}", self.name
            )
        return [np.column_stack([np.interp(s.t, times, column) for column in q.T]) for s in self.shapes]

    @cached_property
    def _pressures(self) -> tuple[Array, Array]:
        """Times of the steps, and pressures (n, 3, n_u) at the start, the middle and the end of each."""
        begin = float(self.recording.pressure.t[0])
        end = max((float(s.t[-1]) for s in self.shapes if s.t.size), default=begin)
        steps = max(1, int(np.ceil((end - begin) / self.dt - 1e-9)))
        times: Array = begin + self.dt * np.arange(steps + 1, dtype=np.float64)
        at = self.recording.pressure.at
        start, middle = at(times), at(times + 0.5 * self.dt)
        return times, np.stack([start, middle, np.vstack([start[1:], start[-1:]])], axis=1)


@dataclass(frozen=True)
class Rests:
    """States at rest.

    Attributes
    ----------
    name : str
    pressure : (n, n_u)
        Of each state [Pa gauge].
    shapes : tuple of Shape
        What was seen; sample k belongs to state `t[k]`.
    """

    name: str
    pressure: Array
    shapes: tuple[Shape, ...]
    block_s: float = field(default=1.0, init=False)

    def coordinates(self, arm: SoftArm) -> list[Array]:
        """Return the coordinates at balance, each search started at the nearest state that was found."""
        q = np.zeros((len(self.pressure), arm.n_q))
        for k, p in enumerate(self.pressure):
            near = int(np.argmin(np.linalg.norm(self.pressure[:k] - p, axis=1))) if k else 0
            q[k] = equilibrium(arm, p, q[near] if k else None)
        return [q[s.t.astype(int)] for s in self.shapes]


def _within(t: Array, intervals: Sequence[Interval]) -> NDArray[np.bool_]:
    inside = [(t >= start) & (t <= end) for start, end in intervals]
    return np.any(inside, axis=0) if inside else np.zeros(len(t), bool)


def _thinned(t: Array, rate_hz: float) -> NDArray[np.bool_]:
    """Whether a sample is the first of its interval."""
    keep = np.zeros(len(t), bool)
    if len(t):
        keep[np.unique(np.floor((t - t[0]) * rate_hz + 1e-6), return_index=True)[1]] = True
    return keep
