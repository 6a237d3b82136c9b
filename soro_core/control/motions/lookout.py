"""Refuse references on whose way the arm meets an obstacle that its robot file knows.

The whole arm is looked at, in the shape in which it rests under the learned load. Samples along arm and way
are so dense that no obstacle, however small, comes nearer between them by more than `ERROR_M`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.control.motions.motion_parts import AlongPath, MotionSegment, PiecewiseMotion
from soro_core.control.motions.motion_time import ON_THE_WAY
from soro_core.control.motions.resting_shape import RestingShape
from soro_core.control.motions.speed_law import SpeedLaw
from soro_core.control.reference.trajectory import Circle, Reference, Waypoints
from soro_core.planning.motion_error import MotionError
from soro_core.planning.obstacles import ERROR_M, Obstacles
from soro_core.planning.steps import Planning

# Pieces of a way, at whose ends the shape is found; samples that are looked at in one step; most of them.
_FEWEST, _AT_ONCE, _MOST = 8, 16, 20_000
_SHARES = tuple(np.linspace(0.0, 1.0, _FEWEST + 1).tolist())


@dataclass(frozen=True)
class ReferenceCourse:
    """Coordinates that a reference passes.

    Attributes
    ----------
    at : callable
        Coordinates (n_q,) at a place or time.
    places : sequence of float
        Places or times of the first samples.
    where : callable
        Names a place or time, for an error.
    """

    at: Callable[[float], Array]
    places: Sequence[float]
    where: Callable[[float], str]


class Lookout:
    """Looks, sample by sample, at the way of an arm; refuses what meets an obstacle.

    Where the arm touches something at the begin, it may stay or move away, but neither sink in further nor
    come back.

    Parameters
    ----------
    obstacles : Obstacles
    shape : RestingShape
        Of the backbone.
    start : ndarray (n_q,)
        Coordinates of the reference at the begin.
    """

    def __init__(self, obstacles: Obstacles, shape: RestingShape, start: Array) -> None:
        self.obstacles, self.shape = obstacles, shape
        first = obstacles.clearance(self._seen(start[None], shape.offset(start)[None])[0])
        self._floor = np.minimum(first, 0.0)

    def follow(self, way: ReferenceCourse) -> Planning[None]:
        """Refuse a way on which the arm meets an obstacle.

        Raises
        ------
        MotionError
        """
        knots = np.asarray(way.places, dtype=np.float64)
        offsets = []
        for x in knots:
            offsets.append(self.shape.offset(way.at(x)))
            yield
        bent = np.array(offsets)
        x, seen = knots, (yield from self._looked(way, knots, knots, bent))
        while True:
            moved = np.linalg.norm(np.diff(seen, axis=0), axis=2).max(axis=1, initial=0.0)
            pieces = np.ceil(moved / self.obstacles.step_m)
            far = np.flatnonzero(pieces > 1.0)
            if far.size == 0:
                break
            if x.size > _MOST:
                allowed = f"{_MOST}: a shorter way"
                raise MotionError("contact", "way", f"{x.size} places to look at for obstacles", allowed)
            between = [np.linspace(x[k], x[k + 1], int(pieces[k]) + 1)[1:-1] for k in far]
            new = np.concatenate(between)
            found = yield from self._looked(way, new, knots, bent)
            at = np.repeat(far + 1, [one.size for one in between])
            x, seen = np.insert(x, at, new), np.insert(seen, at, found, axis=0)
        for place, row in zip(x, seen, strict=True):
            self._judge(row, way, float(place))

    def _looked(self, way: ReferenceCourse, x: Array, knots: Array, bent: Array) -> Planning[Array]:
        """Return positions (n, m, 3) of the arm at places x of the way; the offset is even between knots."""
        found = []
        for first in range(0, x.size, _AT_ONCE):
            part = x[first : first + _AT_ONCE]
            rows = np.array([way.at(float(one)) for one in part])
            offset = np.stack([np.interp(part, knots, column) for column in bent.T], axis=1)
            found.append(self._seen(rows, offset))
            yield
        return np.concatenate(found)

    def _seen(self, q: Array, offset: Array) -> Array:
        """Return the positions (n, m, 3) [m] of the places at references (n, n_q) and offsets (n, n_x)."""
        x = q @ self.shape.spread.T + offset
        return np.stack([self.shape.arm.poses(x, float(s))[:, :3, 3] for s in self.obstacles.places], axis=1)

    def _judge(self, seen: Array, way: ReferenceCourse, at: float) -> None:
        """Refuse places (m, 3) that meet an obstacle."""
        known = self.obstacles
        clearance = known.clearance(seen)
        beyond = clearance - self._floor + np.where(self._floor < 0.0, ERROR_M, 0.0)
        if not beyond.min() >= 0.0:  # NaN too
            place, index = np.unravel_index(int(np.argmin(beyond)), beyond.shape)
            touched = ", which it touches at the begin too" if self._floor[place, index] < 0.0 else ""
            raise MotionError(
                "contact",
                "way",
                f"a clearance of {1e3 * clearance[place, index]:.1f} mm",
                f"0 mm or more between the arm, at {known.place_name(int(place))}, and "
                f"{known.name(int(index))}{touched}, {way.where(at)}",
            )
        self._floor = np.maximum(self._floor, np.minimum(clearance, 0.0))


def line(begin: Array, end: Array, where: str) -> ReferenceCourse:
    """Return the straight way between coordinates.

    Parameters
    ----------
    begin, end : ndarray (n_q,)
    where : str
        Names it in an error.
    """
    return ReferenceCourse(lambda x: np.asarray(begin + x * (end - begin)), _SHARES, lambda _: where)


def ways_of(reference: Reference) -> list[ReferenceCourse]:
    """Return what a reference passes from its begin to its end, or in one round."""
    if isinstance(reference, PiecewiseMotion):
        return ways_along(reference.parts)
    times = [0.0]  # of a set point
    if isinstance(reference, Circle):
        times = (reference.start_s + reference.period_s * np.linspace(0.0, 1.0, 4 * _FEWEST + 1)).tolist()
    elif isinstance(reference, Waypoints):
        knots = reference.times_s
        times = np.union1d(knots, 0.5 * (knots[1:] + knots[:-1])).tolist()
    return [
        ReferenceCourse(
            lambda t: reference.sample(t).q, times, lambda t: f"{t - times[0]:.2f} s after its first point"
        )
    ]


def ways_along(parts: Sequence[MotionSegment]) -> list[ReferenceCourse]:
    """Return the way of each part of a motion."""
    found, passed_m = [], 0.0
    for part in parts:
        law = part.law if isinstance(part, AlongPath) else None
        found.append(_along(part, law, passed_m))
        passed_m += 0.0 if law is None else law.at(part.duration_s)[0]
    return found


def _along(part: MotionSegment, law: SpeedLaw | None, passed_m: float) -> ReferenceCourse:
    def where(t: float) -> str:
        return ON_THE_WAY if law is None else f"{1e3 * (passed_m + law.at(t)[0]):.1f} mm along the path"

    return ReferenceCourse(lambda t: part.at(t).q, (part.duration_s * np.array(_SHARES)).tolist(), where)


def keep_clear(lookout: Lookout, begin: Array, reference: Reference) -> Planning[None]:
    """Refuse a reference on the way to which, or on whose way, the arm meets an obstacle.

    Parameters
    ----------
    lookout : Lookout
        Its arm is at the begin.
    begin : ndarray (n_q,)
        The reference now.
    reference : Reference

    Raises
    ------
    MotionError
    """
    ways = ways_of(reference)
    yield from lookout.follow(line(begin, ways[0].at(ways[0].places[0]), ON_THE_WAY))
    for way in ways:
        yield from lookout.follow(way)
