"""References in the coordinates of the arm, with first and second derivatives."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.errors import ConfigError

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class Point:
    """A reference at one instant: coordinates, rates and accelerations, each (n_q,)."""

    q: Array
    qd: Array
    qdd: Array


class Reference(ABC):
    """A motion that is defined for all times."""

    @abstractmethod
    def sample(self, t: float) -> Point:
        """Return the reference at time `t` [s]."""


@dataclass(frozen=True)
class Hold(Reference):
    """A set point."""

    q: Array

    def sample(self, t: float) -> Point:
        """Return the set point at rest."""
        zero = np.zeros_like(self.q)
        return Point(self.q, zero, zero)


@dataclass(frozen=True)
class Stop(Reference):
    """From a moving point to rest within `duration_s`, twice continuously differentiable."""

    start_s: float
    duration_s: float
    point: Point

    def sample(self, t: float) -> Point:
        """Return the quintic whose velocity fades from the point's to zero."""
        x, T = min(max((t - self.start_s) / self.duration_s, 0.0), 1.0), self.duration_s
        b, db, ddb = smooth_step(x)
        # The start, left as it moves, faded out by the smooth step: value and two derivatives agree at x = 0.
        s = x * T
        q, qd, qdd = self.point.q, self.point.qd, self.point.qdd
        move = qd * s + 0.5 * qdd * s * s
        rate = qd + qdd * s
        # The rest position is where half of the way of a constant velocity would end.
        rest = 0.5 * qd * T
        return Point(
            q + (1.0 - b) * move + b * rest,
            (1.0 - b) * rate + (db / T) * (rest - move),
            (1.0 - b) * qdd - 2.0 * (db / T) * rate + (ddb / (T * T)) * (rest - move),
        )


@dataclass(frozen=True)
class Blend(Reference):
    """Smooth passage from one reference to another within `duration_s`."""

    first: Reference
    second: Reference
    start_s: float
    duration_s: float

    def sample(self, t: float) -> Point:
        """Return the blend; after the passage, the second reference alone."""
        x = (t - self.start_s) / self.duration_s
        if x >= 1.0:
            return self.second.sample(t)
        one, two, T = self.first.sample(t), self.second.sample(t), self.duration_s
        b, db, ddb = smooth_step(max(x, 0.0))
        gap, dgap = two.q - one.q, two.qd - one.qd
        return Point(
            one.q + b * gap,
            one.qd + b * dgap + (db / T) * gap,
            one.qdd + b * (two.qdd - one.qdd) + 2.0 * (db / T) * dgap + (ddb / (T * T)) * gap,
        )


@dataclass(frozen=True)
class Circle(Reference):
    """The tip runs a circle: curvature of constant magnitude that turns once a period.

    q = centre + curvature (cos(2 pi (t - start) / period) across + sin(...) along)
    """

    centre: Array
    across: Array
    along: Array
    curvature_per_m: float
    period_s: float
    start_s: float

    def sample(self, t: float) -> Point:
        """Return the point on the circle."""
        w = 2.0 * math.pi / self.period_s
        phase = w * (t - self.start_s)
        out = self.curvature_per_m * (math.cos(phase) * self.across + math.sin(phase) * self.along)
        side = self.curvature_per_m * (math.cos(phase) * self.along - math.sin(phase) * self.across)
        return Point(self.centre + out, w * side, -w * w * out)


class Waypoints(Reference):
    """Coordinates at given times, as a JointTrajectory brings them.

    Positions alone give a cubic spline that starts and ends at rest (twice continuously differentiable), with
    velocities a cubic, with accelerations as well a quintic, between neighbours. Before the first and after
    the last point the ends are held.

    Parameters
    ----------
    coordinates : sequence of str
        Names of the arm's coordinates, in order.
    names : sequence of str
        The names that the columns belong to: each coordinate once, in any order.
    times_s : sequence of float
        Increasing, at least one.
    positions, velocities, accelerations : array_like (n_t, n_q)
        Columns in the order of `names`; the last two may be None.
    start_s : float
        Time that ``times_s`` counts from.
    limit : Callable or None
        Raises ConfigError for positions (n_q,), in the order of `coordinates`, that are too far out.

    Raises
    ------
    ConfigError
        If names, times or numbers are not as above, or a position is beyond its limit.
    """

    def __init__(
        self,
        coordinates: Sequence[str],
        names: Sequence[str],
        times_s: Sequence[float],
        positions: Array | Sequence[Sequence[float]],
        velocities: Array | Sequence[Sequence[float]] | None = None,
        accelerations: Array | Sequence[Sequence[float]] | None = None,
        start_s: float = 0.0,
        limit: Callable[[Array], None] | None = None,
    ) -> None:
        if sorted(names) != sorted(coordinates):
            raise ConfigError(
                "trajectory", "joint_names", list(names), f"each once: {', '.join(coordinates)}"
            )
        order = [list(names).index(name) for name in coordinates]
        times = np.asarray(times_s, dtype=np.float64)
        if (
            times.ndim != 1
            or times.size == 0
            or not np.all(np.isfinite(times))
            or np.any(np.diff(times) <= 0.0)
        ):
            raise ConfigError(
                "trajectory", "time_from_start", list(times_s), "one or more increasing times [s]"
            )
        if times[0] < 0.0:
            raise ConfigError("trajectory", "time_from_start", float(times[0]), "times from 0 s on")
        shape = (times.size, len(coordinates))
        q = _table("positions", positions, shape)[:, order]
        if limit is not None:
            for row in q:
                limit(row)
        qd = None if velocities is None else _table("velocities", velocities, shape)[:, order]
        qdd = None if accelerations is None else _table("accelerations", accelerations, shape)[:, order]
        if qdd is not None and qd is None:
            raise ConfigError("trajectory", "accelerations", "no velocities", "accelerations with velocities")
        self._first, self._last = float(start_s + times[0]), float(start_s + times[-1])
        self._begin, self._end = q[0].copy(), q[-1].copy()
        self._curves = None
        if times.size > 1:
            from scipy.interpolate import BPoly, CubicSpline  # loaded late: most references have no waypoints

            if qd is None:
                curve = CubicSpline(start_s + times, q, bc_type="clamped")
            else:
                parts = [q, qd] if qdd is None else [q, qd, qdd]
                curve = BPoly.from_derivatives(start_s + times, np.stack(parts, axis=1))
            self._curves = (curve, curve.derivative(1), curve.derivative(2))

    def sample(self, t: float) -> Point:
        """Return the interpolated point; held at the ends."""
        if self._curves is None or t <= self._first or t >= self._last:
            return Hold(self._begin if t <= self._first else self._end).sample(t)
        return Point(*(np.asarray(curve(t), dtype=np.float64) for curve in self._curves))


def smooth_step(x: float) -> tuple[float, float, float]:
    """Return the quintic from 0 to 1 on [0, 1], flat and uncurved at both ends, and its derivatives."""
    x = min(max(x, 0.0), 1.0)
    rest = 1.0 - x
    return (
        x**3 * (10.0 - 15.0 * x + 6.0 * x * x),
        30.0 * x * x * rest * rest,
        60.0 * x * rest * (1.0 - 2.0 * x),
    )


def _table(key: str, rows: Array | Sequence[Sequence[float]], shape: tuple[int, int]) -> Array:
    try:
        table = np.asarray(rows, dtype=np.float64)
    except (TypeError, ValueError):
        raise ConfigError(
            "trajectory", key, "rows of different lengths", f"{shape[0]} rows of {shape[1]}"
        ) from None
    if table.shape != shape:
        raise ConfigError("trajectory", key, f"shape {table.shape}", f"{shape[0]} rows of {shape[1]} numbers")
    if not np.all(np.isfinite(table)):
        raise ConfigError("trajectory", key, "a number that is not finite", "finite numbers")
    return table
