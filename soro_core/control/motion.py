"""From a path of the tip to a motion in coordinates: inverse kinematics, limits, pressures, time.

Planning takes longer than a tick. So it is a generator, which a node continues between ticks: each step takes
about as long as one search of the inverse kinematics. docs/motion.md describes the result.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from soro_core.control.config import ControllerConfig
from soro_core.control.demand import Rates, Supply, rates, shortage
from soro_core.control.motion_error import MotionError
from soro_core.control.motion_parts import AlongPath, Motion, Part, Slower, ToRest
from soro_core.control.passage import Bounds
from soro_core.control.path_coordinates import PathCoordinates, Planning, listed
from soro_core.control.speed_law import STEEPEST, speed_law
from soro_core.control.tip_path import SAME_M, TipLeg, legs_of
from soro_core.control.trajectory import Point

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

Array: TypeAlias = NDArray[np.float64]
Result = TypeVar("Result")

# Points of the way to the path at which its pressures are taken at rest.
_ON_THE_WAY = 8
_ON_THE_WAY_TEXT = "on the way to the first pose"
# Samples of a part at which rates of strain and the speed of the tip are taken.
_SAMPLES = 64
# What rates may be between two samples, relative to the largest sample.
_BETWEEN = 1.01
# Samples in one step of the plan.
_IN_A_STEP = 8
# Coordinates that differ by less are equal, relative to the largest strain.
_SAME = 1e-9
# Shortest passage to the path [s].
_SHORTEST_S = 0.2
# Times that the way to the path is extended by a third.
_LONGER = 12
# A search for the factor of time is given up beyond so many times the largest one.
_HOPELESS = 10.0
# A search for the factor of time ends within this part of the smallest one.
_PRECISION = 0.03


@dataclass(frozen=True)
class Route:
    """A planned path.

    Attributes
    ----------
    first : ndarray (n_q,)
        Coordinates of its first pose.
    parts : tuple of Part
        From rest to rest each.
    factor : float
        How many times longer they take than asked for.
    note : str
        What they leave out; empty if nothing.
    """

    first: Array
    parts: tuple[Part, ...]
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
    """

    supply: Supply
    bounds: Bounds
    config: ControllerConfig
    dt: float

    def plan(
        self, begin: Point, positions: Array, orientations: Array | None, start_s: float
    ) -> Planning[Motion]:
        """Plan the motion to the first pose and through the others.

        Parameters
        ----------
        begin : Point
            The reference at `start_s`, moving or at rest.
        positions, orientations : ndarray (n, 3) and (n, 4) or None
            As for `route`.
        start_s : float
            Time of the begin [s].

        Yields
        ------
        None
            After each step.

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

        Yields
        ------
        None
            After each step.

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
        kinematics = PathCoordinates(self.supply.arm, self.supply.fields, self.bounds.strain, self.config)
        away = np.linalg.norm(self.supply.arm.pose(q, self.supply.arm.length)[:3, 3] - positions[0])
        first = q
        if orientations is not None or away > SAME_M:
            turn = None if orientations is None else orientations[0]
            first = yield from kinematics.first(q, positions[0], turn)
        curves, q = [], first
        for leg in legs:
            curve = yield from kinematics.along(leg, q)
            curves.append(curve)
            q = np.asarray(curve(leg.length_m))
        passed = 0.0
        self._check_rest(first, "the first pose")
        for leg, curve in zip(legs, curves, strict=True):
            for s in curve.x:
                self._check_rest(np.asarray(curve(s)), f"{1e3 * (passed + s):.1f} mm along the path")
                yield
            passed += leg.length_m
        path = [self._timed(leg, curve) for leg, curve in zip(legs, curves, strict=True)]
        factor = yield from self._factor(path)
        slower = tuple(Slower(part, factor) if factor > 1.0 else part for part in path)
        return Route(first, slower, factor, note)

    def motion(self, route: Route, begin: Point, start_s: float) -> Planning[Motion]:
        """Plan the way to a path; parameters as in `plan`.

        Yields
        ------
        None
            After each step.

        Returns
        -------
        Motion

        Raises
        ------
        MotionError
            If the pressures cannot do it.
        """
        approach = yield from self._approach(begin, route.first)
        parts: list[Part] = [*approach, *route.parts]
        if not parts:  # it is there already
            parts = [ToRest(begin, begin.q, _SHORTEST_S)]
        return Motion(tuple(parts), start_s, len(approach), route.factor, route.note)

    def _check_rest(self, q: Array, where: str, tolerance_m: float = 0.0) -> None:
        """Refuse coordinates that the pressures cannot hold at rest, by more than a distance of the tip."""
        lack = shortage(self.supply, q)
        if lack is None or lack.distance_m <= tolerance_m:
            return
        supply = self.supply
        tip = listed(supply.arm.pose(q, supply.arm.length)[:3, 3])
        if lack.chamber < 0:
            most = self.config.reference.tip_tolerance_m
            if lack.distance_m <= most:
                return
            allowed = f"what pressures can hold within {1e3 * most:g} mm (reference.tip_tolerance_m)"
            got = f"{tip} mm, {where}: the best pressures leave the tip {1e3 * lack.distance_m:.1f} mm away"
            raise MotionError("pressure", "pressure", got, allowed)
        name = supply.arm.robot.chamber_names[lack.chamber]
        low, high = supply.setpoints.minimum_pa[lack.chamber], supply.setpoints.maximum_pa[lack.chamber]
        raise MotionError(
            "pressure",
            name,
            f"{1e-3 * lack.pressure_pa:.1f} kPa at {tip} mm, {where}",
            f"{1e-3 * low:g} to {1e-3 * high:g} kPa",
            chamber=name,
            pressure_pa=lack.pressure_pa,
        )

    def _approach(self, begin: Point, rest: Array) -> Planning[list[Part]]:
        """Plan a stop and the way to the first pose; none if the reference is there at rest."""
        settings, still = self.config.motion, np.zeros_like(rest)
        moves = bool(np.any(begin.qd) or np.any(begin.qdd))
        if not moves and np.all(np.abs(rest - begin.q) <= _SAME * self.bounds.strain):
            return []
        parts: list[Part] = []
        if moves:
            speed, _, _ = yield from self._peaks(ToRest(begin, begin.q + 0.5 * begin.qd, 1.0))
            duration_s = max(_SHORTEST_S, STEEPEST * speed / settings.acceleration_m_s2)
            # An even stop covers half of what the motion would.
            stop = yield from self._longer(
                lambda T: ToRest(begin, begin.q + 0.5 * T * begin.qd, T), duration_s
            )
            parts, begin = [stop], Point(stop.end, still, still)
        # The arm may be where no pressure would hold it with the load that is learned so far.
        most = self.config.reference.tip_tolerance_m
        for x in np.linspace(0.0, 1.0, _ON_THE_WAY, endpoint=False)[1:]:
            self._check_rest(begin.q + x * (rest - begin.q), _ON_THE_WAY_TEXT, most)
            yield
        speed, acceleration, rate = yield from self._peaks(ToRest(begin, rest, 1.0))
        duration_s = max(
            _SHORTEST_S,
            speed / settings.speed_m_s,
            float(np.sqrt(acceleration / settings.acceleration_m_s2)),
            rate,
        )
        way = yield from self._longer(lambda T: ToRest(begin, rest, T), duration_s)
        return [*parts, way]

    def _longer(self, part_of: Callable[[float], ToRest], duration_s: float) -> Planning[ToRest]:
        """Find a duration [s] from `duration_s` on at which a part keeps its rates."""
        for _ in range(_LONGER):
            part = part_of(duration_s)
            found = yield from rates(self.supply, part, self.dt, self.config.motion.rate_part)
            _, _, rate = yield from self._peaks(part)
            if found.rate <= 1.0 and rate <= 1.0:
                return part
            duration_s *= 1.3
        raise self._too_fast(found, rate, _ON_THE_WAY_TEXT, None)

    def _timed(self, leg: TipLeg, curve: CubicSpline) -> AlongPath:
        settings = self.config.motion
        law = speed_law(leg.length_m, settings.speed_m_s, settings.acceleration_m_s2, leg.curvature_per_m)
        return AlongPath(curve, law)

    def _peaks(self, part: Part) -> Planning[tuple[float, float, float]]:
        """Find the largest speed [m/s] and acceleration [m/s^2] of the tip, and rate over the allowed one."""
        arm, bounds = self.supply.arm, self.bounds
        times = np.linspace(0.0, part.duration_s, _SAMPLES + 1)
        speeds, rate = [], []
        for k, t in enumerate(times):
            point = part.at(float(t))
            pose, jacobian = arm.pose_and_jacobian(point.q, arm.length)
            speeds.append(pose[:3, :3] @ (jacobian[3:] @ point.qd))
            rate.append(point.qd)
            if k % _IN_A_STEP == 0:
                yield
        change = np.diff(np.array(speeds), axis=0) / times[1]
        return (
            float(np.max(np.linalg.norm(speeds, axis=1))),
            float(np.max(np.linalg.norm(change, axis=1))),
            _BETWEEN * float(np.max(bounds.fields.peaks(np.array(rate)) / bounds.rate)),
        )

    def _factor(self, path: list[AlongPath]) -> Planning[float]:
        """Find the smallest factor of time with which strains, pressures and set points keep their rates."""
        if not path:
            return 1.0
        share, most = self.config.motion.rate_part, self.config.motion.slowest
        strain = 0.0
        for part in path:
            _, _, rate = yield from self._peaks(part)
            strain = max(strain, rate)
        low, factor, high, worst = 0.0, max(1.0, strain), np.inf, Rates(0.0, 0, 0.0, 0.0, False)
        while True:
            found = yield from self._worst(path, factor, share)
            if found.fits:
                if low == 0.0 or factor <= low * (1.0 + _PRECISION):
                    break
                high = factor
            else:
                low, worst = factor, found
                if low > _HOPELESS * most:
                    raise self._too_fast(worst, strain, "path", None)
            # Rates fall at least as the factor grows; the rise of a set point falls faster.
            factor = 0.5 * (low + high) if np.isfinite(high) else low * min(max(found.rate, 1.1), 2.0)
        if factor > most:
            raise self._too_fast(worst, strain, "path", factor)
        return float(factor)

    def _worst(self, path: list[AlongPath], factor: float, share: float) -> Planning[Rates]:
        """Find the rates of the part that keeps them least."""
        found: list[Rates] = []
        for part in path:
            found.append((yield from rates(self.supply, Slower(part, factor), self.dt, share)))
        return max(found, key=lambda one: (not one.fits, one.rate))

    def _too_fast(self, found: Rates, strain: float, where: str, factor: float | None) -> MotionError:
        name = self.supply.arm.robot.chamber_names[found.chamber]
        got = f"{found.rate:.2f} times the allowed change of the set point of {name}, {where}"
        if found.fits or found.rate <= 1.0 < strain:
            got = f"{strain:.2f} times the allowed rate of strain, {where}"
        works = "none works" if factor is None else f"the smallest that works is {factor:.2f}"
        allowed = f"a factor of time of at most {self.config.motion.slowest:g} (motion.slowest); {works}"
        return MotionError("rate", "rate", got, allowed, chamber=name, factor=factor)


def finished(steps: Planning[Result]) -> Result:
    """Return the result of all steps."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value  # type: ignore[no-any-return]
