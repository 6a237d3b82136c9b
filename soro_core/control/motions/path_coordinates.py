"""Coordinates of the arm along a path of the tip, by inverse kinematics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soro_core.arrays import Array
from soro_core.control.config import ControllerConfig
from soro_core.control.motions.kinematics import inverse_kinematics
from soro_core.control.motions.tip_path import TipLeg
from soro_core.model import SoftArm
from soro_core.planning.motion_error import MotionError
from soro_core.planning.obstacles import listed
from soro_core.planning.steps import Planning
from soro_core.robot.coordinates import StrainFields

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

# Points along a leg at which the inverse kinematics are solved: at least, and by length of the arm.
_FEWEST, _PER_LENGTH = 8, 24
# Distance of the tip from its path between these points [m]; beyond it there are twice as many, at most so
# many times.
_TOLERANCE_M, _DOUBLED = 5e-6, 3


@dataclass(frozen=True)
class PathCoordinates:
    """Searches of coordinates for poses of the tip.

    Attributes
    ----------
    arm : SoftArm
        Kinematics.
    fields : StrainFields
        Strains of the arm's robot.
    limit : ndarray (n_q,)
        Largest absolute strain of the field of each coordinate.
    config : ControllerConfig
        Tolerance of the path, and weight of orientations.
    held : callable, optional
        Finds the coordinates that pressures hold with the tip nearest to a position (3,) [m], from those of
        the search (n_q,); None where there are none. Default: those of the search, whatever holds them.
    """

    arm: SoftArm
    fields: StrainFields
    limit: Array
    config: ControllerConfig
    held: Callable[[Array, Array], Planning[Array | None]] | None = None

    def _solve(self, start: Array, position: Array, orientation: Array | None) -> tuple[Array, float]:
        """Return coordinates for a pose of the tip, and the distance that remains [m]."""
        found = inverse_kinematics(
            self.arm,
            position,
            orientation,
            start,
            self.limit,
            self.config.reference.rotation_weight_m,
            fields=self.fields,
        )
        return found.q, found.position_error_m

    def first(self, start: Array, position: Array, orientation: Array | None) -> Planning[Array]:
        """Find the coordinates of the first pose, by a search from several starts.

        Parameters
        ----------
        start : ndarray (n_q,)
            Coordinates of the reference.
        position : ndarray (3,)
            Position of the tip in the world [m].
        orientation : ndarray (4,) or None
            Orientation (x, y, z, w).

        Returns
        -------
        ndarray (n_q,)

        Raises
        ------
        MotionError
            If no search ends near enough.
        """
        fields = self.fields
        bend = fields.of("bending_x") + 1j * fields.of("bending_y")
        ways = [(bend * np.exp(0.5j * np.pi * k)).real / fields.length for k in range(4)]
        tried = []
        for begin in (start, np.zeros_like(start), *ways):
            q, missed = self._solve(begin, position, orientation)
            yield
            tried.append((missed, q))
            if missed <= self.config.motion.tolerance_m:
                return q
        missed, q = min(tried, key=lambda one: one[0])
        raise (yield from self._out_of_reach("poses[0].position", position, q))

    def _out_of_reach(self, key: str, position: Array, q: Array) -> Planning[MotionError]:
        allowed = (
            f"a point that the tip can reach, within {1e3 * self.config.motion.tolerance_m:g} mm "
            "(motion.tolerance_m)"
        )
        found = q if self.held is None else (yield from self.held(q, position))
        return MotionError(
            "reach", key, f"{listed(position)} mm", *with_nearest(allowed, self.arm, position, found)
        )

    def along(self, leg: TipLeg, start: Array) -> Planning[CubicSpline]:
        """Find the coordinates along a leg, over the distance."""
        from scipy.interpolate import CubicSpline

        arm = self.arm
        n = max(_FEWEST, int(np.ceil(_PER_LENGTH * leg.length_m / arm.length)))
        for _ in range(_DOUBLED + 1):
            places, q = np.linspace(0.0, leg.length_m, n + 1), start
            rows = []
            for s in places:
                position, orientation = leg.at(float(s))
                q, missed = self._solve(q, position, orientation)
                if missed > self.config.motion.tolerance_m:
                    raise (yield from self._out_of_reach(f"{1e3 * s:.1f} mm along the leg", position, q))
                rows.append(q)
                yield
            curve = CubicSpline(places, np.array(rows))
            off = 0.0
            # With orientations the tip may stay beside its path.
            for s in 0.5 * (places[1:] + places[:-1]) if leg.turn is None else ():
                tip = arm.pose(curve(s), arm.length)[:3, 3]
                off = max(off, float(np.linalg.norm(tip - leg.at(float(s))[0])))
                yield
            if off <= _TOLERANCE_M:
                return curve
            n *= 2
        position, _ = leg.at(0.0)
        allowed = "a path along which the arm's coordinates change evenly"
        raise MotionError(
            "reach", "path", f"{1e6 * off:.0f} um beside it from {listed(position)} mm", allowed
        )


def with_nearest(
    allowed: str, arm: SoftArm, position: Array, q: Array | None
) -> tuple[str, tuple[float, ...] | None]:
    """Return what is allowed with the nearest tip, and this tip.

    Parameters
    ----------
    allowed : str
        What is allowed, without it.
    arm : SoftArm
    position : ndarray (3,)
        To which the tip shall be near [m].
    q : ndarray (n_q,) or None
        Coordinates with this tip; None where there are none.
    """
    if q is None:
        return allowed, None
    nearest = arm.pose(q, arm.length)[:3, 3]
    missed_mm = 1e3 * float(np.linalg.norm(nearest - position))
    return f"{allowed}; the nearest is {listed(nearest)} mm, {missed_mm:.1f} mm away", tuple(nearest.tolist())
