"""References in the coordinates of the arm, with first and second derivatives."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ConfigError
from soro_core.frozen import quick

# Samples between two waypoints, both included, at which strains and rates are checked.
_SAMPLES = 11
# Largest difference of two set points that are equal, relative and in the units of the strains.
_ROUNDING = 1e-9


@quick
@dataclass(frozen=True)
class Point:
    """A reference at one instant: what the arm is to follow.

    Attributes
    ----------
    q, qd, qdd : ndarray (n_q,)
        Coordinates, rates [1/s] and accelerations [1/s^2] in units of the coordinates.
    """

    q: Array
    qd: Array
    qdd: Array


class Reference(ABC):
    """A motion that is defined for all times."""

    @abstractmethod
    def sample(self, t: float) -> Point:
        """Return the reference at time `t` [s]."""

    @property
    def end_s(self) -> float:
        """Time from which on it rests [s]; infinite if it never does."""
        return math.inf

    def is_repeated_by(self, other: Reference, t: float) -> bool:
        """Whether `other`, given at time `t` [s] while this reference is in force, is the same motion."""
        return other is self

    def started_at(self, t: float) -> Reference:
        """Return the same motion with its begin at time `t` [s]; a set point has none."""
        return self


@dataclass(frozen=True)
class Hold(Reference):
    """A set point."""

    q: Array

    @property
    def end_s(self) -> float:
        """It always rests."""
        return -math.inf

    def sample(self, t: float) -> Point:
        """Return the set point at rest."""
        zero = np.zeros_like(self.q)
        return Point(self.q, zero, zero)

    def is_repeated_by(self, other: Reference, t: float) -> bool:
        """Whether `other` is the same set point up to rounding."""
        return isinstance(other, Hold) and bool(np.allclose(self.q, other.q, rtol=_ROUNDING, atol=_ROUNDING))


@dataclass(frozen=True)
class Blend(Reference):
    """Smooth transition from one reference to another within `duration_s`."""

    first: Reference
    second: Reference
    start_s: float
    duration_s: float

    @property
    def end_s(self) -> float:
        """Time of the end of both [s]."""
        return max(self.start_s + self.duration_s, self.second.end_s)

    def sample(self, t: float) -> Point:
        """Return the blend; after the transition, the second reference alone."""
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
    """Circle of the tip: curvature of constant magnitude, whose direction turns once in a period.

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

    def started_at(self, t: float) -> Reference:
        """Return the circle with its phase 0 at time `t` [s]."""
        return replace(self, start_s=t)


class Waypoints(Reference):
    """Coordinates at given times, from the fields of a JointTrajectory.

    Positions alone give a cubic spline that starts and ends at rest (twice continuously differentiable);
    positions and velocities give a cubic, with accelerations a quintic, between neighbouring points. The
    first point holds before its time, the last one after.

    Parameters
    ----------
    coordinates : sequence of str
        Names of the arm's coordinates, in order.
    names : sequence of str
        Coordinate of each column: every coordinate once, in any order.
    times_s : sequence of float (n_t,)
        Increasing times [s], at least one.
    positions, velocities, accelerations : array_like (n_t, n_q)
        Coordinates and their derivatives, columns in the order of `names`; the last two may be None.
    start_s : float
        Time that `times_s` counts from [s].
    stamp_ns : int
        Stamp of the message [ns]. A trajectory that has ended starts again if it is given with another stamp.
    limit : Callable or None
        Called with positions (n_q,) in the order of `coordinates`; raises ConfigError if they are too large.

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
        stamp_ns: int = 0,
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
        self._given = (times, *(table for table in (q, qd, qdd) if table is not None))
        self._stamp_ns = stamp_ns
        self._first, self._last = float(start_s + times[0]), float(start_s + times[-1])
        self._begin, self._end = q[0].copy(), q[-1].copy()
        self._curves = None
        if times.size > 1:
            from scipy.interpolate import (  # imported here: most references have no waypoints
                BPoly,
                CubicSpline,
            )

            if qd is None:
                curve = CubicSpline(start_s + times, q, bc_type="clamped")
            else:
                parts = [q, qd] if qdd is None else [q, qd, qdd]
                curve = BPoly.from_derivatives(start_s + times, np.stack(parts, axis=1))
            self._curves = (curve, curve.derivative(1), curve.derivative(2))

    @property
    def end_s(self) -> float:
        """Time of the last point [s]; a single one is a set point."""
        return -math.inf if self._curves is None else self._last

    def is_repeated_by(self, other: Reference, t: float) -> bool:
        """Whether `other` has the same points, and does not start an ended trajectory again."""
        if not isinstance(other, Waypoints) or len(self._given) != len(other._given):
            return False
        if self._curves is not None and t >= self._last and other._stamp_ns != self._stamp_ns:
            return False
        return all(map(np.array_equal, self._given, other._given))

    @property
    def times_s(self) -> Array:
        """Times (n_t,) of the points [s]."""
        return np.array([self._first]) if self._curves is None else np.asarray(self._curves[0].x)

    def between(self) -> tuple[Array, Array]:
        """Return coordinates and rates at the points and at samples between them, (n, n_q) each."""
        if self._curves is None:
            return self._begin[None], np.zeros((1, self._begin.size))
        times = self._curves[0].x
        parts = np.linspace(times[:-1], times[1:], _SAMPLES).ravel()
        return self._curves[0](parts), self._curves[1](parts)

    def sample(self, t: float) -> Point:
        """Return the interpolated point; held at the ends."""
        if self._curves is None or t <= self._first or t >= self._last:
            return Hold(self._begin if t <= self._first else self._end).sample(t)
        return Point(*(np.asarray(curve(t), dtype=np.float64) for curve in self._curves))


def smooth_step(x: float) -> tuple[float, float, float]:
    """Return the quintic from 0 to 1 on [0, 1], with its two derivatives, which are 0 at both ends."""
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
