"""Parts of a motion, in coordinates over time, and the motion that they make."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from soro_core.arrays import Array
from soro_core.control.motions.speed_law import SpeedLaw
from soro_core.control.reference.trajectory import Hold, Point, Reference

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline


class MotionSegment(Protocol):
    """A motion that ends at rest."""

    @property
    def duration_s(self) -> float:
        """Time from begin to end [s]."""

    def at(self, t: float) -> Point:
        """Return the reference `t` seconds after the begin, 0 to `duration_s`."""


@dataclass(frozen=True)
class AlongPath:
    """Coordinates along a curve of the tip, passed by a speed law.

    Attributes
    ----------
    coordinates : CubicSpline
        Coordinates over the distance along the curve [m], twice continuously differentiable.
    law : SpeedLaw
        Distance over time.
    """

    coordinates: CubicSpline
    law: SpeedLaw

    @property
    def duration_s(self) -> float:
        """Time from rest to rest [s]."""
        return self.law.duration_s

    def at(self, t: float) -> Point:
        """Return the reference `t` seconds after the begin."""
        s, ds, dds = self.law.at(t)
        slope = np.asarray(self.coordinates(s, 1))
        return Point(
            np.asarray(self.coordinates(s)),
            slope * ds,
            slope * dds + np.asarray(self.coordinates(s, 2)) * (ds * ds),
        )


@dataclass(frozen=True)
class ToRest:
    """The quintic from a moving point to rest at `end` (n_q,).

    Attributes
    ----------
    begin : Point
        Coordinates, rates and accelerations at the begin.
    end : ndarray (n_q,)
        Coordinates at rest.
    duration_s : float
        Time [s].
    """

    begin: Point
    end: Array
    duration_s: float

    @cached_property
    def _rows(self) -> Array:
        """Coefficients (6, n_q) of the powers of t / duration."""
        T = self.duration_s
        q, v, a = self.begin.q, T * self.begin.qd, 0.5 * T * T * self.begin.qdd
        gap = self.end - q - v - a  # by position, rate and acceleration at the end
        rate, bend = -v - 2.0 * a, -2.0 * a
        return np.stack(
            [
                q,
                v,
                a,
                10.0 * gap - 4.0 * rate + 0.5 * bend,
                -15.0 * gap + 7.0 * rate - bend,
                6.0 * gap - 3.0 * rate + 0.5 * bend,
            ]
        )

    def at(self, t: float) -> Point:
        """Return the reference `t` seconds after the begin."""
        x, T = t / self.duration_s, self.duration_s
        powers = np.array([1.0, x, x * x, x**3, x**4, x**5])
        first = np.array([0.0, 1.0, 2.0 * x, 3.0 * x * x, 4.0 * x**3, 5.0 * x**4])
        second = np.array([0.0, 0.0, 2.0, 6.0 * x, 12.0 * x * x, 20.0 * x**3])
        rows = self._rows
        return Point(powers @ rows, first @ rows / T, second @ rows / (T * T))


@dataclass(frozen=True)
class Slower:
    """A part that takes `factor` times as long; its begin must be at rest."""

    part: MotionSegment
    factor: float

    @property
    def duration_s(self) -> float:
        """Time from rest to rest [s]."""
        return self.factor * self.part.duration_s

    def at(self, t: float) -> Point:
        """Return the reference `t` seconds after the begin."""
        k = self.factor
        point = self.part.at(t / k)
        return Point(point.q, point.qd / k, point.qdd / (k * k))


@dataclass(frozen=True)
class PiecewiseMotion(Reference):
    """Parts one after the other, held at both ends.

    Attributes
    ----------
    parts : sequence of MotionSegment
        Each begins where the one before ends, which is at rest. The first may begin in motion.
    start_s : float
        Time of the begin [s].
    first : int
        Number of parts that lead to the path.
    factor : float
        How many times longer the path takes than at the speed and acceleration that were asked for.
    note : str
        What the motion leaves out; empty if nothing.
    """

    parts: Sequence[MotionSegment]
    start_s: float
    first: int = 0
    factor: float = 1.0
    note: str = ""

    @cached_property
    def _begins(self) -> list[float]:
        begins = [self.start_s]
        for part in self.parts:
            begins.append(begins[-1] + part.duration_s)
        return begins

    def times(self, each: int) -> Array:
        """Return `each` times [s] a part, from its begin on, and that of the end."""
        shares = np.arange(each) / each
        parts = zip(self._begins, self.parts, strict=False)
        return np.array([begin + x * part.duration_s for begin, part in parts for x in shares] + [self.end_s])

    @property
    def path_s(self) -> float:
        """Time at which the path begins [s]."""
        return self._begins[self.first]

    @property
    def end_s(self) -> float:
        """Time of the end [s]."""
        return self._begins[-1]

    def started_at(self, t: float) -> Reference:
        """Return the motion with its begin at time `t` [s]."""
        return replace(self, start_s=t)

    def sample(self, t: float) -> Point:
        """Return the reference at time `t` [s]; at rest before the begin and after the end."""
        if t < self.start_s:
            return Hold(self.parts[0].at(0.0).q).sample(t)
        if t >= self.end_s:
            return Hold(self.parts[-1].at(self.parts[-1].duration_s).q).sample(t)
        k = bisect_right(self._begins, t) - 1
        return self.parts[k].at(t - self._begins[k])
