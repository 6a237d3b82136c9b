"""The path of the tip that a configuration states, as a motion in coordinates.

`soro_core.control.motions.motion` plans a path of a running arm against its pressures, and extends its time.
This one is made before the arm moves: `soro_core.control.reference_feasibility` checks its pressures at
rest, and a path that is too fast is refused.
"""

from __future__ import annotations

import numpy as np

from soro_core.arrays import Array
from soro_core.control.config import ControllerConfig
from soro_core.control.motions.motion_parts import AlongPath, MotionSegment, PiecewiseMotion, ToRest
from soro_core.control.motions.path_coordinates import PathCoordinates
from soro_core.control.motions.speed_law import speed_law
from soro_core.control.motions.tip_path import corners, legs_of
from soro_core.control.reference.reference_transition import Bounds
from soro_core.control.reference.trajectory import Point
from soro_core.errors import ConfigError
from soro_core.model import SoftArm
from soro_core.planning.steps import finished

# Samples of a leg at which the rates of strain are taken.
_SAMPLES = 64
# Shortest rest [s]: a part of a motion takes some time.
_SHORTEST_S = 1e-3


def configured_path(arm: SoftArm, bounds: Bounds, config: ControllerConfig) -> PiecewiseMotion:
    """Return the motion through the points of `reference.path_m`.

    It stays at the first point for `reference.start_s`, within which the arm comes there, and at each for
    `reference.pause_s`.

    Parameters
    ----------
    arm : SoftArm
        Model.
    bounds : Bounds
        Limits of strain and rate.
    config : ControllerConfig

    Returns
    -------
    Motion

    Raises
    ------
    ConfigError
        If the tip cannot reach a point, or a strain would change too fast.
    """
    settings = config.reference
    points = np.array(settings.path_m).reshape(-1, 3)
    kinematics = PathCoordinates(arm, bounds.fields, bounds.strain, config)
    q = finished(kinematics.first(np.zeros(arm.n_q), points[0], None))
    parts: list[MotionSegment] = [_rest(q, settings.start_s + settings.pause_s)]
    for leg in legs_of(corners(list(points))):
        curve = finished(kinematics.along(leg, q))
        law = speed_law(leg.length_m, config.motion.speed_m_s, config.motion.acceleration_m_s2, 0.0)
        q = np.asarray(curve(leg.length_m))
        parts += [AlongPath(curve, law), _rest(q, settings.pause_s)]
    _check_rates(bounds, [part for part in parts if isinstance(part, AlongPath)], config)
    return PiecewiseMotion(tuple(parts), 0.0)


def _rest(q: Array, duration_s: float) -> ToRest:
    still = np.zeros_like(q)
    return ToRest(Point(q, still, still), q, max(duration_s, _SHORTEST_S))


def _check_rates(bounds: Bounds, legs: list[AlongPath], config: ControllerConfig) -> None:
    """Refuse legs along which a strain changes beyond its rate; a leg may be too short for the speed."""
    works = [leg.law.speed_m_s / _times_too_fast(bounds, leg) for leg in legs]
    if any(leg.law.speed_m_s > speed for leg, speed in zip(legs, works, strict=True)):
        allowed = f"at most {min(works):.3g}: faster, a strain changes beyond its rate on reference.path_m"
        raise ConfigError("controller", "motion.speed_m_s", config.motion.speed_m_s, allowed)


def _times_too_fast(bounds: Bounds, leg: AlongPath) -> float:
    rates = np.array([leg.at(float(t)).qd for t in np.linspace(0.0, leg.duration_s, _SAMPLES + 1)])
    return float(np.max(bounds.fields.peaks(rates) / bounds.rate))
