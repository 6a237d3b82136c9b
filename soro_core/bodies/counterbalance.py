"""An arm that bears the weight of a hinged limb, so that who moves the limb does not: a wrist exoskeleton.

Weight and the wearer's effort are one torque about the hinge. So the weight is learned while the limb is
relaxed: the arm holds it still, and its moment is then that of the weight. From then on it is frozen, and the
pressure follows from the angle alone: what the wearer does is not answered. Moment and weight come from one
model of the arm, so that an error of its gain is in both and cancels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from soro_core.arrays import Array
from soro_core.bodies.body import HingeAxis, smooth_way
from soro_core.config import Strict
from soro_core.errors import ModelError, short
from soro_core.model import SoftArm
from soro_core.rotation import rotation_exp

_ITERATIONS, _SETTLED = 50, 1e-12
# Largest distance of the tip from where the limb holds it [m].
_MISS_M = 1e-4
# Part of its moment that a weight must have where it is learned.
_LEAST_LEAN = 0.3
# The part of the time of weighing that counts, its last third: the limb is at rest then.
_COUNTS = 1.0 / 3.0
# The part in which the arm takes up its pressure, and the one at whose end it has lifted the limb.
_FILLS, _LIFTS = 1.0 / 12.0, 1.0 / 3.0
# How far beyond its table a measured angle may be [rad], and how fast a limb moves [rad/s]: beyond both it is
# the encoder that slips, jumps or wraps.
_BEYOND_RAD, _FASTEST_RAD_S = 0.2, 30.0
# Farthest from level that the hold leaves the limb [rad]: beyond it a stop or the wearer bears a part of it.
_OFF_LEVEL = 0.2


@dataclass(frozen=True)
class LimbMoments:
    """Moment of an arm at rest about the hinge of a limb that holds its tip, ``without + per_pa * pressure``.

    Attributes
    ----------
    angle_rad : (n,)
        Angles of the limb, increasing.
    without : (n,)
        Moment without pressure [N m]: stiffness and weight of the arm.
    per_pa : (n,)
        Moment per effective pressure [N m/Pa].
    """

    angle_rad: Array
    without: Array
    per_pa: Array

    def at(self, angle_rad: float) -> tuple[float, float]:
        """Both at an angle, the nearest one of the table beyond its ends."""
        return (
            float(np.interp(angle_rad, self.angle_rad, self.without)),
            float(np.interp(angle_rad, self.angle_rad, self.per_pa)),
        )


def limb_moments(arm: SoftArm, hinge: HingeAxis, angles_rad: ArrayLike) -> LimbMoments:
    """Return the moments of an arm of one chamber, whose tip is on the limb where it is straight at angle 0.

    Parameters
    ----------
    arm : SoftArm
        With as many coordinates as its tip has directions in the plane of the limb: its shape follows from
        the angle.
    hinge : HingeAxis
    angles_rad : array_like (n,)

    Raises
    ------
    ModelError
        If the arm has more chambers, or one whose area grows with pressure; if its shape does not follow from
        its tip; or if it cannot follow the limb to an angle.
    """
    if arm.n_u != 1:
        raise ModelError(f"{arm.robot.name}: {arm.n_u} chambers; allowed: one", "chambers")
    (chamber,) = (one for link in arm.robot.links for one in link.chambers)
    if chamber.dead_band_pa or chamber.swell_per_pa:
        text = "dead_band_pa and swell_per_pa make its moment no line over pressure; allowed: 0"
        raise ModelError(f"{arm.robot.name}: {text}", "chambers")
    axis = np.array(hinge.axis) / math.hypot(*hinge.axis)
    angles = np.atleast_1d(np.asarray(angles_rad, dtype=np.float64))
    start = arm.pose(np.zeros(arm.n_q), arm.length)[:3, 3] - hinge.point
    rows = np.empty((2, len(angles)))
    # From the angle nearest to the straight arm outwards: the shape of one is the guess of the next.
    shapes: dict[int, Array] = {}
    for k in sorted(range(len(angles)), key=lambda k: abs(angles[k])):
        guess = min(shapes, key=lambda other: abs(angles[other] - angles[k]), default=None)
        q = np.zeros(arm.n_q) if guess is None else shapes[guess]
        lever = rotation_exp(angles[k] * axis) @ start
        shapes[k] = q = _follow(arm, q, hinge.point + lever, angles[k])
        pose, body = arm.pose_and_jacobian(q, arm.length)
        J = pose[:3, :3] @ body[3:]
        if np.linalg.matrix_rank(J, 1e-9) < arm.n_q:
            raise ModelError(
                f"{arm.robot.name}: {arm.n_q} coordinates do not follow from the tip; allowed: as many as "
                "it has directions",
                "strains",
            )
        inner = -arm.elastic_force(q) - arm.gravity_force(q)
        for row, force in zip(rows, (inner, arm.actuation_matrix(q)[:, 0]), strict=True):
            row[k] = axis @ np.cross(lever, np.linalg.lstsq(J.T, force, rcond=1e-9)[0])
    return LimbMoments(angles, *rows)


def _follow(arm: SoftArm, q: Array, place: Array, angle: float) -> Array:
    """Coordinates (n_q,) whose tip is at a place in the world."""
    for _ in range(_ITERATIONS):
        pose, body = arm.pose_and_jacobian(q, arm.length)
        miss = place - pose[:3, 3]
        change = np.linalg.lstsq(pose[:3, :3] @ body[3:], miss, rcond=1e-9)[0]
        q = q + change
        if np.abs(change).max() < _SETTLED:
            break
    if not np.linalg.norm(miss) < _MISS_M:
        raise ModelError(
            f"{arm.robot.name}: its tip cannot follow the limb to {angle:.3g} rad; allowed: smaller angles",
            "angle",
        )
    return np.asarray(q)


class CounterbalanceSettings(Strict):
    """What holds the limb while it is weighed."""

    weigh_s: float = Field(
        3.0, ge=0.5, le=600, description="time until the weight is frozen; its last third counts [s]"
    )
    start_pa: float = Field(35e3, ge=0, le=1e7, description="pressure at the start, of a level limb [Pa]")
    stiffness: float = Field(
        0.33, ge=0, le=1e6, description="moment that holds the limb level, by its angle [N m/rad]"
    )
    integral: float = Field(1.0, ge=0, le=1e6, description="by the integral of the angle, in N m/(rad s)")
    damping: float = Field(0.075, ge=0, le=1e6, description="by the rate [N m s/rad]")
    still_rad: float = Field(
        0.05, ge=0, le=1, description="how far the limb may move while its weight is taken [rad]"
    )


_DEFAULT = CounterbalanceSettings()


@dataclass(frozen=True)
class CounterbalanceState:
    """What has been seen of the limb so far.

    Attributes
    ----------
    t_s : float
        Time [s].
    start_rad : float
        Angle from which the limb is lifted [rad].
    integral : float
        Of the angle from where the limb is wanted, while it is weighed [rad s].
    weight : float
        The weight's moment where the limb is level, the mean of `samples` values [N m]; frozen when it has
        been weighed.
    samples : int
    least_rad, most_rad : float
        Angles between which the limb was meanwhile [rad].
    bound_pa : float
        The bound at which a set point was meanwhile [Pa]; NaN where none was.
    """

    t_s: float = 0.0
    start_rad: float = 0.0
    integral: float = 0.0
    weight: float = 0.0
    samples: int = 0
    least_rad: float = math.inf
    most_rad: float = -math.inf
    bound_pa: float = math.nan


@dataclass(frozen=True)
class Counterbalance:
    """The law: pure steps from angle and pressure to a set point.

    Attributes
    ----------
    moments : LimbMoments
        Pressure must turn the limb to the same side at each angle.
    range_pa : (low, high)
        Set points stay within [Pa].
    level_rad : float
        Angle at which the weight has its largest moment: the limb is level there, and is weighed there.
    settings : CounterbalanceSettings

    Raises
    ------
    ModelError
        If moments or range are not as stated.
    """

    moments: LimbMoments
    range_pa: Sequence[float]
    level_rad: float = 0.0
    settings: CounterbalanceSettings = _DEFAULT

    def __post_init__(self) -> None:
        per_pa, without = self.moments.per_pa, self.moments.without
        if not (np.isfinite(without).all() and np.isfinite(per_pa).all()):
            raise ModelError("moments: a value is not finite; allowed: numbers", "moments")
        if not (np.all(per_pa > 0.0) or np.all(per_pa < 0.0)):
            text = f"{per_pa.min():.3g} to {per_pa.max():.3g} N m/Pa"
            raise ModelError(f"moments.per_pa: {text}; allowed: all above 0 or all below", "moments")
        low, high = self.range_pa
        if not -math.inf < low < high < math.inf:
            raise ModelError(f"range_pa: got {low:g} to {high:g} Pa; allowed: from low to high", "range_pa")

    def step(
        self,
        state: CounterbalanceState,
        angle_rad: float,
        rate_rad_s: float,
        pressure_pa: float,
        dt: float,
        ahead_s: float = 0.0,
    ) -> tuple[CounterbalanceState, float]:
        """Return the next state and the set point [Pa].

        Parameters
        ----------
        state : CounterbalanceState
        angle_rad, rate_rad_s : float
            Of the limb, measured [rad], [rad/s].
        pressure_pa : float
            Measured [Pa gauge].
        dt : float
            Time since the last step [s].
        ahead_s : float
            Time until the set point acts [s]: it is that for the angle then.

        Raises
        ------
        ModelError
            If a measured value is not finite, or none that a limb can have, or dt is not above 0; while the
            limb is weighed, if it is too far from level; at the end of that, if it was not level and at rest,
            or a set point was at a bound. Vent then.
        """
        if not (math.isfinite(angle_rad) and math.isfinite(rate_rad_s) and math.isfinite(pressure_pa)):
            raise ModelError("counterbalance: a measured value is not finite", "measured")
        if not 0.0 < dt < math.inf:
            raise ModelError(f"counterbalance: dt = {short(dt)} s; allowed: above 0", "dt")
        least, most = self.moments.angle_rad[[0, -1]].tolist()
        if not least - _BEYOND_RAD <= angle_rad <= most + _BEYOND_RAD or abs(rate_rad_s) > _FASTEST_RAD_S:
            raise ModelError(
                f"counterbalance: the limb is at {angle_rad:.3g} rad and turns by {rate_rad_s:.3g} rad/s; "
                "allowed: "
                f"{least - _BEYOND_RAD:.3g} to {most + _BEYOND_RAD:.3g} rad, up to {_FASTEST_RAD_S:g} rad/s",
                "angle",
            )
        then_rad = angle_rad + ahead_s * rate_rad_s
        is_weighed = state.t_s >= self.settings.weigh_s
        state = replace(state, t_s=state.t_s + dt)
        if state.t_s < self.settings.weigh_s:
            without, per_pa = self.moments.at(angle_rad)
            found = (without + per_pa * pressure_pa) / max(self._lean(angle_rad), _LEAST_LEAN)
            return self._weigh(state, (angle_rad, then_rad, rate_rad_s), found, dt)
        if not is_weighed:
            self._refuse_moved(state)
        then_rad = min(max(then_rad, least), most)
        without, per_pa = self.moments.at(then_rad)
        return state, self._within((state.weight * self._lean(then_rad) - without) / per_pa)

    def _lean(self, angle_rad: float) -> float:
        """Return the part of its largest moment that the weight has at an angle."""
        return math.cos(angle_rad - self.level_rad)

    def _weigh(
        self, state: CounterbalanceState, limb: tuple[float, float, float], found: float, dt: float
    ) -> tuple[CounterbalanceState, float]:
        """Lift the limb from where it was, hold it level, and take the mean of the moments that hold it."""
        hold, (angle, then, rate) = self.settings, limb
        begin_s, end_s = hold.weigh_s * _FILLS, hold.weigh_s * _LIFTS
        if state.t_s <= begin_s:  # it may fall, or hang on a stop: until then its speed alone is held
            state = replace(state, start_rad=angle)
        if self._lean(angle) < _LEAST_LEAN:
            raise ModelError(
                f"counterbalance: the limb is at {angle:.3g} rad; allowed while weighed: within "
                f"{math.acos(_LEAST_LEAN):.3g} rad of level",
                "angle",
            )
        # At once asked to be level, a limb that hangs on a stop would be thrown as it leaves it.
        rows = np.array([[state.start_rad], [self.level_rad]])
        level, rises, _ = smooth_way((begin_s, end_s), rows, state.t_s)
        away = then - float(level[0])
        integral = state.integral + dt * away
        back = hold.stiffness * away + hold.integral * integral + hold.damping * (rate - float(rises[0]))
        # The moment of the muscle differs from angle to angle: with one pressure for all of them the limb
        # would snap from a stop to the other.
        level_without, level_per_pa = self.moments.at(self.level_rad)
        without, per_pa = self.moments.at(then)
        wanted = (level_without + level_per_pa * hold.start_pa - back - without) / per_pa
        setpoint = self._within(wanted)
        # An integral that goes on where the set point cannot follow would throw the limb later.
        if setpoint == wanted or away * (wanted - setpoint) * per_pa > 0.0:
            state = replace(state, integral=integral)
        if state.t_s > hold.weigh_s * (1.0 - _COUNTS):
            n = state.samples + 1
            state = replace(
                state,
                weight=state.weight + (found - state.weight) / n,
                samples=n,
                least_rad=min(state.least_rad, angle),
                most_rad=max(state.most_rad, angle),
                bound_pa=state.bound_pa if setpoint == wanted else setpoint,
            )
        return state, setpoint

    def _refuse_moved(self, state: CounterbalanceState) -> None:
        """Refuse a weight that the moment of the arm is not."""
        if not state.samples:
            raise ModelError("counterbalance: nothing was measured while the limb was weighed", "dt")
        if not math.isnan(state.bound_pa):
            low, high = self.range_pa
            raise ModelError(
                f"counterbalance: while the limb was weighed, a set point was at {1e-3 * state.bound_pa:.4g} "
                f"kPa, its bound; allowed: weights that {1e-3 * low:g} to {1e-3 * high:g} kPa hold",
                "range_pa",
            )
        off = max(self.level_rad - state.least_rad, state.most_rad - self.level_rad)
        if off > _OFF_LEVEL:
            raise ModelError(
                f"counterbalance: the limb was {off:.3g} rad off level while it was weighed, as if a stop "
                f"held it; allowed: {_OFF_LEVEL:g} rad",
                "angle",
            )
        if (moved := state.most_rad - state.least_rad) > self.settings.still_rad:
            raise ModelError(
                f"counterbalance: the limb moved by {moved:.3g} rad while it was weighed; allowed: "
                f"{self.settings.still_rad:g} rad",
                "still_rad",
            )

    def _within(self, pressure_pa: float) -> float:
        low, high = self.range_pa
        return min(max(pressure_pa, low), high)
