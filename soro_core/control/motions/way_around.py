"""A motion around the obstacles that the robot file knows, to one point of the tip."""

from __future__ import annotations

import math

import numpy as np

from soro_core.arrays import Array
from soro_core.control.motions.motion import Planner, Route
from soro_core.control.motions.motion_parts import AlongPath, Slower
from soro_core.control.motions.pressure_feasibility import holding_pressure
from soro_core.control.motions.speed_law import speed_law
from soro_core.model import SoftArm
from soro_core.planning.around import AroundOptions, WayAround, search_around
from soro_core.planning.motion_error import MotionError
from soro_core.planning.steps import Planning

# Multiples of the margin with which a way is sought: weight bends the links of a way between their ends.
_MARGINS = (1.0, 2.0)
# Part of the range of the pressures that is left at both ends, for creep, inertia and feedback.
_EDGE = 0.02
# Least factor of time: the tip of an arm that turns about it does not move.
_LEAST = 0.2
# Samples between two shapes of a way; shapes over which a turn slows the tip.
_EVEN, _SPREAD = 4, 3
# Samples of its speed and acceleration, as a multiple of its shapes.
_DENSE = 12


def route_around(planner: Planner, q: Array, position: Array) -> Planning[Route]:
    """Plan a way around the obstacles of the robot file, or the shortest in coordinates if there are none.

    Parameters
    ----------
    planner : Planner
    q : ndarray (n_q,)
        Coordinates of the reference at the begin.
    position : ndarray (3,)
        Of the tip, in the world [m].

    Returns
    -------
    Route

    Raises
    ------
    MotionError
        If there is no way, or the pressures cannot do it.
    ModelError
        If the arm has no rest at the begin.
    """
    contacts = planner.supply.arm.robot.contacts
    if contacts is None or not (contacts.planes or contacts.spheres):
        return (yield from planner.route(q, position[None], None))
    for times in _MARGINS:
        way = yield from _way(planner, q, position, times * planner.config.motion.margin_m)
        if way.length_m[-1] <= 0.0:
            return Route(way.q[0], (), 1.0, "")
        part = _timed(planner, way)
        try:
            yield from planner.keep_clear(q, way.q[0], [part])
            break
        except MotionError:
            if times == _MARGINS[-1]:
                raise
    settings = planner.config.motion
    speed, acceleration, rate = yield from planner.timing.peaks(part, _DENSE * len(way.q))
    longer = max(
        speed / settings.speed_m_s, math.sqrt(acceleration / settings.acceleration_m_s2), rate, _LEAST
    )
    even = Slower(part, longer)
    factor = yield from planner.timing.factor([even])
    return Route(way.q[0], (Slower(part, longer * factor),), factor, "")


def _way(planner: Planner, q: Array, position: Array, margin_m: float) -> Planning[WayAround]:
    """Find a way with the learned load at the tip."""
    supply, settings = planner.supply, planner.config.motion
    robot, low, high = supply.arm.robot, supply.setpoints.minimum_pa, supply.setpoints.maximum_pa
    edge = _EDGE * (high - low)
    assert robot.contacts is not None
    arm = SoftArm(robot.replace(contacts=None, tip_mass=robot.tip_mass + planner.load_kg))
    yield
    options = AroundOptions(
        margin_m,
        settings.tolerance_m,
        settings.around_shapes,
        limit=planner.bounds.strain,
        near=q,
        range_pa=(low + edge, high - edge),
    )
    start_pa = holding_pressure(supply, q)
    return (yield from search_around(arm, start_pa, position, robot.contacts, options))


def _timed(planner: Planner, way: WayAround) -> AlongPath:
    """Return the way at the speed that the tip may have, slower where the tip turns."""
    from scipy.interpolate import CubicSpline  # imported here: few motions go around something
    from scipy.ndimage import gaussian_filter1d, maximum_filter1d

    speed, most = planner.config.motion.speed_m_s, planner.config.motion.acceleration_m_s2
    apart = np.concatenate(([True], np.diff(way.length_m) > 0.0))
    length, tip, q = way.length_m[apart], way.tip_m[apart], way.q[apart]
    even = np.linspace(0.0, length[-1], _EVEN * len(length))
    curve = CubicSpline(length, tip)
    fast, turning = (np.linalg.norm(curve(even, k), axis=1) for k in (1, 2))
    # At this rate of the distance the tip has its speed, or the acceleration that its turn may take.
    slower = np.maximum(np.maximum(fast, speed * np.sqrt(turning / most)), _LEAST)
    slower = maximum_filter1d(slower, 3 * _SPREAD * _EVEN, mode="nearest")
    slower = gaussian_filter1d(slower, _SPREAD * _EVEN, mode="nearest")
    middle = 0.5 * (slower[1:] + slower[:-1])
    distance = np.concatenate(([0.0], np.cumsum(middle * np.diff(even))))
    law = speed_law(float(distance[-1]), speed, most)
    return AlongPath(CubicSpline(np.interp(length, even, distance), q), law)
