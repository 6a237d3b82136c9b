"""From a path of the tip to a motion in coordinates: inverse kinematics, limits, pressures, time.

Planning takes longer than a tick. So it is a generator, which a node continues between ticks: each step takes
about as long as one search of the inverse kinematics. docs/motion.md describes the result.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from soro_core.arrays import Array
from soro_core.control.config import ControllerConfig
from soro_core.control.motions.lookout import Lookout, line, ways_along
from soro_core.control.motions.motion_parts import AlongPath, MotionSegment, PiecewiseMotion, Slower, ToRest
from soro_core.control.motions.motion_time import ON_THE_WAY, Timing
from soro_core.control.motions.path_coordinates import PathCoordinates, with_nearest
from soro_core.control.motions.pressure_feasibility import PressureSupply, nearest_held, pressure_deficit
from soro_core.control.motions.speed_law import STEEPEST, speed_law
from soro_core.control.motions.tip_path import SAME_M, TipLeg, legs_of
from soro_core.control.reference.reference_transition import Bounds
from soro_core.control.reference.trajectory import Point
from soro_core.planning.motion_error import MotionError
from soro_core.planning.obstacles import listed
from soro_core.planning.steps import Planning

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

# Points of the way to the path at which its pressures are taken at rest.
_ON_THE_WAY = 8
# Coordinates that differ by less are equal, relative to the largest strain.
_SAME = 1e-9
# Shortest transition to the path [s].
_SHORTEST_S = 0.2


@dataclass(frozen=True)
class Route:
    """A planned path.

    Attributes
    ----------
    first : ndarray (n_q,)
        Coordinates of its first pose.
    parts : tuple of MotionSegment
        From rest to rest each.
    factor : float
        How many times longer they take than asked for.
    note : str
        What they leave out; empty if nothing.
    """

    first: Array
    parts: tuple[MotionSegment, ...]
    factor: float
    note: str


@dataclass(frozen=True)
class Planner:
    """What a plan keeps to.

    Attributes
    ----------
    supply : Supply
        Model, learned load and pressures.
    bounds : Bounds
        Limits of strain and of its rate.
    config : ControllerConfig
        Its sections `motion` and `reference`.
    dt : float
        Period of the loop [s].
    lookout : callable
        Gives what looks out for the obstacles that the robot file knows, for coordinates (n_q,) at the begin;
        it gives None where the file knows none.
    load_kg : float
        Learned mass at the tip beyond the robot file's [kg].
    """

    supply: PressureSupply
    bounds: Bounds
    config: ControllerConfig
    dt: float
    lookout: Callable[[Array], Lookout | None]
    load_kg: float = 0.0

    def plan(
        self, begin: Point, positions: Array, orientations: Array | None, start_s: float
    ) -> Planning[PiecewiseMotion]:
        """Plan the motion to the first pose and through the others.

        Parameters
        ----------
        begin : Point
            The reference at `start_s`, moving or at rest.
        positions, orientations : ndarray (n, 3) and (n, 4) or None
            As for `route`.
        start_s : float
            Time of the begin [s].

        Returns
        -------
        Motion

        Raises
        ------
        MotionError
            If the tip or the pressures cannot do it.
        ConfigError
            If the path is none.
        """
        route = yield from self.route(begin.q, positions, orientations)
        return (yield from self.motion(route, begin, start_s))

    def route(self, q: Array, positions: Array, orientations: Array | None) -> Planning[Route]:
        """Plan the path itself, from rest at its first pose.

        Parameters
        ----------
        q : ndarray (n_q,)
            Coordinates near which the search for those of the first pose starts.
        positions : ndarray (n, 3)
            Positions to pass, in the world [m].
        orientations : ndarray (n, 4) or None
            Orientations (x, y, z, w), weighted with `reference.rotation_weight_m`.

        Returns
        -------
        Route

        Raises
        ------
        MotionError
            If the tip or the pressures cannot do it.
        ConfigError
            If the path is none.
        """
        note = ""
        if orientations is not None and self.config.reference.rotation_weight_m <= 0.0:
            if np.ptp(orientations, axis=0).max(initial=0.0) > 1e-9:
                note = "orientations are not followed: reference.rotation_weight_m is 0"
            orientations = None
        legs = legs_of(positions, orientations)
        held = partial(nearest_held, self.supply, self.bounds.strain)
        kinematics = PathCoordinates(
            self.supply.arm, self.supply.fields, self.bounds.strain, self.config, held
        )
        away = np.linalg.norm(self.supply.arm.pose(q, self.supply.arm.length)[:3, 3] - positions[0])
        near = first = q
        if orientations is not None or away > SAME_M:
            turn = None if orientations is None else orientations[0]
            first = yield from kinematics.first(q, positions[0], turn)
        curves, q = [], first
        for leg in legs:
            curve = yield from kinematics.along(leg, q)
            curves.append(curve)
            q = np.asarray(curve(leg.length_m))
        passed = 0.0
        yield from self._check_held(first, "the first pose")
        for leg, curve in zip(legs, curves, strict=True):
            for s in curve.x:
                yield from self._check_held(
                    np.asarray(curve(s)), f"{1e3 * (passed + s):.1f} mm along the path"
                )
            passed += leg.length_m
        path = [self._timed(leg, curve) for leg, curve in zip(legs, curves, strict=True)]
        yield from self.keep_clear(near, first, path)
        factor = yield from self.timing.factor(path)
        slower = tuple(Slower(part, factor) if factor > 1.0 else part for part in path)
        return Route(first, slower, factor, note)

    def motion(self, route: Route, begin: Point, start_s: float) -> Planning[PiecewiseMotion]:
        """Plan the way to a path; parameters as in `plan`.

        Returns
        -------
        Motion

        Raises
        ------
        MotionError
            If the pressures cannot do it.
        """
        approach = yield from self._approach(begin, route.first)
        yield from self.keep_clear(begin.q, begin.q, approach)
        parts: list[MotionSegment] = [*approach, *route.parts]
        if not parts:  # it is there already
            parts = [ToRest(begin, begin.q, _SHORTEST_S)]
        return PiecewiseMotion(tuple(parts), start_s, len(approach), route.factor, route.note)

    @property
    def timing(self) -> Timing:
        """Searches of the time of its parts."""
        return Timing(self.supply, self.bounds, self.config, self.dt)

    def keep_clear(self, begin: Array, first: Array, parts: Sequence[MotionSegment]) -> Planning[None]:
        """Refuse parts on which the arm meets an obstacle.

        Parameters
        ----------
        begin : ndarray (n_q,)
            Where the arm is, which is elsewhere perhaps.
        first : ndarray (n_q,)
            Where the parts begin.
        parts : sequence of MotionSegment

        Raises
        ------
        MotionError
        """
        lookout = self.lookout(begin)
        if lookout is None:
            return
        yield from lookout.follow(line(first, first, ON_THE_WAY))
        for way in ways_along(parts):
            yield from lookout.follow(way)

    def _check_held(self, q: Array, where: str) -> Planning[None]:
        """Refuse a place that the pressures cannot hold at rest, with the nearest that they can."""
        try:
            self._check_rest(q, where)
            yield
        except MotionError as error:
            arm = self.supply.arm
            position = arm.pose(q, arm.length)[:3, 3]
            found = yield from nearest_held(self.supply, self.bounds.strain, q, position)
            allowed, nearest = with_nearest(str(error.allowed), arm, position, found)
            raise MotionError(
                "pressure", error.key, str(error.got), allowed, nearest, error.chamber, error.pressure_pa
            ) from None

    def _check_rest(self, q: Array, where: str, tolerance_m: float = 0.0) -> None:
        """Refuse coordinates that the pressures cannot hold at rest, by more than a distance of the tip."""
        deficit = pressure_deficit(self.supply, q)
        if deficit is None or deficit.distance_m <= tolerance_m:
            return
        supply = self.supply
        tip = listed(supply.arm.pose(q, supply.arm.length)[:3, 3])
        if deficit.chamber < 0:
            most = self.config.reference.tip_tolerance_m
            if deficit.distance_m <= most:
                return
            allowed = f"what pressures can hold within {1e3 * most:g} mm (reference.tip_tolerance_m)"
            got = (
                f"{tip} mm, {where}: the best pressures leave the tip {1e3 * deficit.distance_m:.1f} mm away"
            )
            raise MotionError("pressure", "pressure", got, allowed)
        name = supply.arm.robot.chamber_names[deficit.chamber]
        low, high = supply.setpoints.minimum_pa[deficit.chamber], supply.setpoints.maximum_pa[deficit.chamber]
        raise MotionError(
            "pressure",
            name,
            f"{1e-3 * deficit.pressure_pa:.1f} kPa at {tip} mm, {where}",
            f"{1e-3 * low:g} to {1e-3 * high:g} kPa",
            chamber=name,
            pressure_pa=deficit.pressure_pa,
        )

    def _approach(self, begin: Point, rest: Array) -> Planning[list[MotionSegment]]:
        """Plan a stop and the way to the first pose; none if the reference is there at rest."""
        settings, still = self.config.motion, np.zeros_like(rest)
        moves = bool(np.any(begin.qd) or np.any(begin.qdd))
        if not moves and np.all(np.abs(rest - begin.q) <= _SAME * self.bounds.strain):
            return []
        parts: list[MotionSegment] = []
        if moves:
            speed, _, _ = yield from self.timing.peaks(ToRest(begin, begin.q + 0.5 * begin.qd, 1.0))
            duration_s = max(_SHORTEST_S, STEEPEST * speed / settings.acceleration_m_s2)
            # An even stop covers half of what the motion would.
            stop = yield from self.timing.longer(
                lambda T: ToRest(begin, begin.q + 0.5 * T * begin.qd, T), duration_s
            )
            parts, begin = [stop], Point(stop.end, still, still)
        # The arm may be where no pressure would hold it with the load that is learned so far.
        most = self.config.reference.tip_tolerance_m
        for x in np.linspace(0.0, 1.0, _ON_THE_WAY, endpoint=False)[1:]:
            self._check_rest(begin.q + x * (rest - begin.q), ON_THE_WAY, most)
            yield
        speed, acceleration, rate = yield from self.timing.peaks(ToRest(begin, rest, 1.0))
        duration_s = max(
            _SHORTEST_S,
            speed / settings.speed_m_s,
            float(np.sqrt(acceleration / settings.acceleration_m_s2)),
            rate,
        )
        way = yield from self.timing.longer(lambda T: ToRest(begin, rest, T), duration_s)
        return [*parts, way]

    def _timed(self, leg: TipLeg, curve: CubicSpline) -> AlongPath:
        settings = self.config.motion
        law = speed_law(leg.length_m, settings.speed_m_s, settings.acceleration_m_s2, leg.curvature_per_m)
        return AlongPath(curve, law)
