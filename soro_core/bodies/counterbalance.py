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

from soro_core.arrays import Array
from soro_core.bodies.body import Hinge
from soro_core.errors import ModelError
from soro_core.model import SoftArm
from soro_core.rotation import rotation_exp

_ITERATIONS, _SETTLED = 50, 1e-12
# Largest distance of the tip from where the limb holds it [m].
_MISS_M = 1e-4
# Part of its moment that a weight must have where it is learned.
_LEAST_LEAN = 0.3


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


def limb_moments(arm: SoftArm, hinge: Hinge, angles_rad: ArrayLike) -> LimbMoments:
    """Return the moments of an arm of one chamber, whose tip is on the limb where it is straight at angle 0.

    Parameters
    ----------
    arm : SoftArm
        With as many coordinates as its tip has directions in the plane of the limb: its shape follows from
        the angle.
    hinge : Hinge
    angles_rad : array_like (n,)

    Raises
    ------
    ModelError
        If the arm has more chambers, or cannot follow the limb to an angle.
    """
    if arm.n_u != 1:
        raise ModelError(f"{arm.robot.name}: {arm.n_u} chambers; allowed: one", "chambers")
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


@dataclass(frozen=True)
class CounterbalanceSettings:
    """What holds the limb while it is weighed.

    Attributes
    ----------
    weigh_s : float
        Time until the weight is frozen [s]; its last third counts.
    start_pa : float
        Pressure at the start [Pa].
    per_rad_pa, per_rad_s_pa, per_rate_pa : float
        Pressure by the angle [Pa/rad], its integral [Pa/(rad s)] and its rate [Pa s/rad].
    """

    weigh_s: float = 3.0
    start_pa: float = 35e3
    per_rad_pa: float = 40e3
    per_rad_s_pa: float = 120e3
    per_rate_pa: float = 8e3


@dataclass(frozen=True)
class CounterbalanceState:
    """Time [s], integral of the angle [rad s], and the weight's moment at the hinge's angle 0 [N m].

    `weight` is the mean of `samples` values so far, and frozen when it has been weighed.
    """

    t_s: float = 0.0
    integral: float = 0.0
    weight: float = 0.0
    samples: int = 0


@dataclass(frozen=True)
class Counterbalance:
    """The law: pure steps from angle and pressure to a set point.

    Attributes
    ----------
    moments : LimbMoments
    range_pa : (low, high)
        Set points stay within [Pa].
    level_rad : float
        Angle at which the weight has its largest moment: the limb is level there.
    settings : CounterbalanceSettings
    """

    moments: LimbMoments
    range_pa: Sequence[float]
    level_rad: float = 0.0
    settings: CounterbalanceSettings = CounterbalanceSettings()

    def step(
        self, state: CounterbalanceState, angle_rad: float, rate_rad_s: float, pressure_pa: float, dt: float
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

        Raises
        ------
        ModelError
            If a measured value is not finite, or the limb is too far from level to be weighed.
        """
        if not (math.isfinite(angle_rad) and math.isfinite(rate_rad_s) and math.isfinite(pressure_pa)):
            raise ModelError("counterbalance: a measured value is not finite", "measured")
        hold, (without, per_pa) = self.settings, self.moments.at(angle_rad)
        lean = math.cos(angle_rad - self.level_rad)
        state = replace(state, t_s=state.t_s + dt)
        if state.t_s < hold.weigh_s:
            if lean < _LEAST_LEAN:
                raise ModelError(
                    f"counterbalance: the limb is at {angle_rad:.3g} rad; allowed while weighed: within "
                    f"{math.acos(_LEAST_LEAN):.3g} rad of level",
                    "angle",
                )
            state = replace(state, integral=state.integral + dt * angle_rad)
            wanted = hold.start_pa + hold.per_rad_pa * angle_rad + hold.per_rate_pa * rate_rad_s
            wanted += hold.per_rad_s_pa * state.integral
            if state.t_s > hold.weigh_s * 2.0 / 3.0:
                found, n = (without + per_pa * pressure_pa) / lean, state.samples + 1
                state = replace(state, weight=state.weight + (found - state.weight) / n, samples=n)
        else:
            wanted = (state.weight * lean - without) / per_pa
        low, high = self.range_pa
        return state, min(max(wanted, low), high)
