"""A way of the whole arm around known obstacles to a point of the tip.

The way is sought in pressures: each of its shapes is one in which pressures hold the arm at rest. It is
smoothed within the pressures between which it was found, and looked at again as densely as any reference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from soro_core.arrays import Array
from soro_core.errors import ModelError, short
from soro_core.model import SoftArm
from soro_core.model.checks import finite, number, require, shaped
from soro_core.model.equilibrium.statics import stable_equilibrium
from soro_core.planning.motion_error import MotionError
from soro_core.planning.obstacles import Obstacles, listed, obstacles_of
from soro_core.planning.search import Way, WaySearch
from soro_core.planning.shapes import HeldLine, HeldShapes
from soro_core.planning.steps import Planning, finished
from soro_core.robot.coordinates import strain_fields
from soro_core.robot.surroundings import Contacts

# How much nearer an obstacle may come between samples and places while a way is sought [m].
COARSE_M = 4e-4
# Goals before the search, growths between two that are added, and most of them; starts from which one is
# sought if none is clear, and if none is found.
_GOALS, _EVERY, _MOST_GOALS, _STARTS, _WITHOUT = 6, 30, 40, 120, 40
# Distance between the control points of the smooth way, as a part of its length: the first that is clear.
_SPACINGS = (0.25, 0.12, 0.06, 0.03, 0.015, 0.007)
# Largest motion of the arm between two shapes of the smooth way, as a part of its length; fewest shapes.
_SAMPLE, _FEWEST = 0.015, 17
# Largest strain without a unit, and bend of a link [rad], where no other limit is given.
_STRETCH, _BEND_RAD = 0.6, 3.0


@dataclass(frozen=True)
class WayAround:
    """A way from rest to rest.

    Attributes
    ----------
    pressure_pa : ndarray (n, n_u)
        Pressures that hold its shapes [Pa gauge].
    q : ndarray (n, n_q)
        Coordinates.
    tip_m : ndarray (n, 3)
        Positions of the tip in the world [m].
    length_m : ndarray (n,)
        Distance up to each shape [m]: the mean (RMS) of what places along the arm have moved.
    clearance_m : float
        Least clearance of the arm from an obstacle [m].
    shapes : int
        Number of shapes that were looked at.
    """

    pressure_pa: Array
    q: Array
    tip_m: Array
    length_m: Array
    clearance_m: float
    shapes: int


@dataclass(frozen=True)
class AroundOptions:
    """What a way around obstacles keeps, and how long it is sought.

    Attributes
    ----------
    margin_m : float
        Clearance that the way keeps, 0 or more [m]; less where the start has less.
    tolerance_m : float
        Distance of the tip from the goal [m].
    shapes : int
        Largest number of shapes that are looked at.
    limit : (n_q,), optional
        Largest absolute coordinates; default 0.6 of elongation and shear, 3 rad a link of others.
    near : (n_q,), optional
        Coordinates near those of the start; default those of `stable_equilibrium`.
    range_pa : pair of (n_u,), optional
        Least and highest pressures [Pa gauge]; default those of the robot.
    seed : int
        Of the search; the same seed gives the same way.
    """

    margin_m: float = 2e-3
    tolerance_m: float = 1e-4
    shapes: int = 40_000
    limit: ArrayLike | None = None
    near: ArrayLike | None = None
    range_pa: tuple[Array, Array] | None = None
    seed: int = 0


def plan_around(
    arm: SoftArm, start: ArrayLike, goal: ArrayLike, obstacles: Contacts, **options: Any
) -> WayAround:
    """Find a way on which the whole arm, with the radius of its sections, keeps clear of obstacles.

    Parameters
    ----------
    arm : SoftArm
        Model with the load at its tip, of the method "exact". Its own contacts do not count.
    start : (n_u,)
        Pressures that hold the arm where the way begins [Pa gauge].
    goal : (3,)
        Where the tip shall be, in the world [m].
    obstacles : Contacts
        Planes and balls, as a robot file states them.
    options
        `margin_m` and all others of `AroundOptions`.

    Raises
    ------
    MotionError
        If the arm touches an obstacle at the start, the goal is out of reach or in an obstacle, or no way was
        found.
    ModelError
        If an argument is not allowed, or the arm has no rest at the start.
    """
    known = [field.name for field in fields(AroundOptions)]
    for key in options:
        if key not in known:
            raise ModelError(f"{key}: got {short(options[key])}; allowed are {', '.join(known)}", key)
    return finished(search_around(arm, start, goal, obstacles, AroundOptions(**options)))


def search_around(
    arm: SoftArm, start: ArrayLike, goal: ArrayLike, obstacles: Contacts, options: AroundOptions
) -> Planning[WayAround]:
    """Find a way in steps of a few shapes; parameters as of `plan_around`."""
    margin_m, tolerance_m, most = options.margin_m, options.tolerance_m, options.shapes
    limit, near = options.limit, options.near
    require(arm, SoftArm, "arm", "a SoftArm")
    robot = arm.robot
    for key, value in (("margin_m", margin_m), ("tolerance_m", tolerance_m)):
        if not 0.0 <= number(value) < math.inf:
            raise ModelError(f"{key}: got {short(value)}; allowed is a length [m] of 0 or more", key)
    if not number(most) >= 1:  # NaN too
        raise ModelError(f"shapes: got {short(most)}; allowed is 1 or more", "shapes")
    pressure = finite(shaped(start, (arm.n_u,), "start", robot.name), "start")
    point = finite(shaped(goal, (3,), "goal", robot.name), "goal")
    require(obstacles, Contacts, "obstacles", "Contacts")
    if not (obstacles.planes or obstacles.spheres):
        raise ModelError("obstacles: got none; allowed is one or more", "obstacles")
    bare, strains = SoftArm(robot.replace(contacts=None)), strain_fields(robot)
    yield
    bounds = np.where(strains.stretch, _STRETCH, _BEND_RAD / strains.length)
    if limit is not None:
        bounds = finite(shaped(limit, (arm.n_q,), "limit", robot.name), "limit")
    low, high = robot.input_range if options.range_pa is None else options.range_pa
    coarse, fine = (
        HeldShapes(bare, known, low, high, bounds)
        for known in (obstacles_of(bare, obstacles, COARSE_M), obstacles_of(bare, obstacles))
        if known is not None
    )
    yield from coarse.measure()
    fine.motion_m = coarse.motion_m
    x = np.clip((pressure - low) / (high - low), 0.0, 1.0)
    q = (
        stable_equilibrium(bare, low + x * (high - low))
        if near is None
        else finite(shaped(near, (arm.n_q,), "near", robot.name), "near")
    )
    begin = fine.line(x, x, q, -math.inf, 1)
    if not begin.whole:
        raise ModelError(f"start: no rest at {(1e-3 * pressure).round(1).tolist()} kPa", "start")
    _refuse_contact(fine, begin, 0.0, "at the start")
    # Samples that are coarse see less than there is.
    asked_m = min(margin_m, float(begin.clearance_m[-1]))
    _refuse_goal(fine.obstacles, point, asked_m)
    # Coarse samples see less than there is: a way that they see this clear is so.
    least_m = float(coarse.line(x, x, begin.q[-1], -math.inf, 1).clearance_m[-1])
    search = WaySearch(coarse, begin, min(asked_m + COARSE_M, least_m), options.seed)
    goals = _Goals(search, begin, point, tolerance_m, asked_m)
    while coarse.looked_at < most:
        found = yield from goals.next_way(most)
        if found is None:
            break
        found = yield from search.shorten(found)
        for spacing in _SPACINGS:
            seen = yield from _seen(fine, _smooth(coarse, found, spacing), found.q[0], asked_m)
            if seen is not None:
                return _as_way(fine, seen, coarse.looked_at + fine.looked_at)
    allowed = "a goal with a way around the obstacles, or more shapes (motion.around_shapes)"
    raise MotionError("contact", "way", f"no way found among {most} shapes", allowed)


class _Goals:
    """Shapes with the tip at a point, found one after the other, and the search for a way to one of them."""

    def __init__(
        self, search: WaySearch, begin: HeldLine, point: Array, tolerance_m: float, margin_m: float
    ) -> None:
        self._search, self._begin, self._point = search, begin, point
        self._tolerance_m, self._margin_m = tolerance_m, margin_m
        self._known = self._tried = self._grown = 0
        self._nearest: HeldLine | None = None

    def next_way(self, most: int) -> Planning[Way | None]:
        """Find the next way; None after `most` shapes."""
        search = self._search
        while search.shapes.looked_at < most:
            starts = _WITHOUT if self._nearest is None else _STARTS
            few = self._known < _GOALS and self._tried < starts
            if few or (self._known < _MOST_GOALS and self._grown >= _EVERY):
                way = yield from self._try_goal()
            elif self._known:
                self._grown += 1
                way = yield from search.grow()
            else:
                way = self._use_nearest()
            if way is not None:
                return way
        return None

    def _try_goal(self) -> Planning[Way | None]:
        """Seek a goal, from the start or from anywhere; gives the way there if it is a straight line."""
        search, (x, q) = self._search, (self._begin.x[-1], self._begin.q[-1])
        if self._tried:
            away = search.shapes.line(x, search.sample(), q, -math.inf)
            x, q = away.x[-1], away.q[-1]
        self._tried, self._grown = self._tried + 1, 0
        goal = yield from search.shapes.with_tip_at(
            self._point, x, q, self._tolerance_m, 2.0 * search.margin_m
        )
        if goal is None:
            return None
        if self._nearest is None or goal.clearance_m[-1] > self._nearest.clearance_m[-1]:
            self._nearest = goal
        return self._reach(goal) if goal.clearance_m[-1] >= search.margin_m else None

    def _use_nearest(self) -> Way | None:
        """Use the goal that is clear of most, or refuse the point."""
        if self._nearest is None:
            low_pa, high_pa = self._search.shapes.range_pa
            allowed = f"a point that the tip can reach with {1e-3 * low_pa:g} to {1e-3 * high_pa:g} kPa"
            raise MotionError("reach", "goal", f"{listed(self._point)} mm", allowed)
        where = f"with the tip at {listed(self._point)} mm"
        _refuse_contact(self._search.shapes, self._nearest, self._margin_m, where)
        self._search.margin_m = float(self._nearest.clearance_m[-1])
        return self._reach(self._nearest)

    def _reach(self, goal: HeldLine) -> Way | None:
        self._known += 1
        return self._search.reach(goal)


def _smooth(shapes: HeldShapes, way: Way, spacing: float) -> Array:
    """Return pressures (n, n_u) along a smooth curve (cubic B-spline) near the lines of a way.

    It is within the convex hull of its control points, and so within the range of the pressures.
    """
    from scipy.interpolate import BSpline  # imported here: few motions go around something

    steps = shapes.apart(way.x[1:], way.x[:-1])
    count = np.maximum(1, np.ceil(steps / (spacing * steps.sum()))).astype(int)
    rows = [
        np.linspace(a, b, n, endpoint=False) for a, b, n in zip(way.x[:-1], way.x[1:], count, strict=True)
    ]
    control = np.concatenate([*rows, way.x[-1:]])
    while len(control) < 4:
        control = np.insert(control, 1, 0.5 * (control[0] + control[1]), axis=0)
    inner = np.linspace(0.0, 1.0, len(control) - 2)
    curve = BSpline(np.concatenate(([0.0] * 3, inner, [1.0] * 3)), control, 3)
    n = max(_FEWEST, math.ceil(steps.sum() / (_SAMPLE * shapes.arm.length)))
    return np.asarray(curve(np.linspace(0.0, 1.0, n)))


def _seen(shapes: HeldShapes, rows: Array, q: Array, margin_m: float) -> Planning[list[HeldLine] | None]:
    """Look at all shapes of a way; None where it is not clear."""
    seen = []
    for a, b in pairwise(rows):
        line = shapes.line(a, b, q, margin_m)
        if not line.whole:
            return None
        seen.append(line)
        q = line.q[-1]
        yield
    return seen


def _as_way(shapes: HeldShapes, seen: list[HeldLine], looked_at: int) -> WayAround:
    x, q, places = (
        np.concatenate([rows[0][:1], *(row[-1:] for row in rows)])
        for rows in ([getattr(one, name) for one in seen] for name in ("x", "q", "places"))
    )
    moved = np.sqrt((np.diff(places, axis=0) ** 2).sum(axis=2).mean(axis=1))
    length = np.concatenate(([0.0], np.cumsum(moved)))
    least = min(float(one.clearance_m.min()) for one in seen)
    return WayAround(shapes.low_pa + x * shapes.span_pa, q, places[:, -1], length, least, looked_at)


def _refuse_contact(shapes: HeldShapes, line: HeldLine, margin_m: float, where: str) -> None:
    """Refuse the last shape of a line if it is nearer to an obstacle than a margin."""
    known = shapes.obstacles
    clearance = known.clearance(line.places[-1])
    if not clearance.min() >= margin_m:  # NaN too
        place, index = np.unravel_index(int(np.argmin(clearance)), clearance.shape)
        raise _contact(known, float(clearance.min()), margin_m, int(place), int(index), where)


def _refuse_goal(known: Obstacles, point: Array, margin_m: float) -> None:
    """Refuse a point at which the tip would be nearer to an obstacle than a margin."""
    at = np.tile(point, (len(known.places), 1))
    clearance = known.clearance(at)[-1]
    if not clearance.min() >= margin_m:
        index, where = int(np.argmin(clearance)), f"with the tip at {listed(point)} mm"
        raise _contact(known, float(clearance.min()), margin_m, len(known.places) - 1, index, where)


def _contact(
    known: Obstacles, clearance_m: float, margin_m: float, place: int, index: int, where: str
) -> MotionError:
    between = f"between the arm, at {known.place_name(place)}, and {known.name(index)}, {where}"
    got, allowed = f"a clearance of {1e3 * clearance_m:.1f} mm", f"{1e3 * margin_m:.2g} mm or more {between}"
    return MotionError("contact", "way", got, allowed)
