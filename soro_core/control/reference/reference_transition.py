"""The transition from one reference to the next, tick by tick, within the limits of strain and rate.

A point called the lead moves through the strains, and the reference in force follows it through two
first-order lags of `smoothing_s` each. The output of a lag is a weighted mean of its input, so the reference
keeps every limit of strain and rate that the lead keeps, for any sequence of targets. Its accelerations are
continuous, and at most 2 / smoothing_s times the largest rate (filters of this kind: Biagiotti and
Melchiorri, Trajectory Planning for Automatic Machines and Robots, 2008, chapter 4).

The lags do not delay a moving target: they follow it exactly if the lead is at q + 2 T qd + T^2 qdd of the
target, T = `smoothing_s`. The state is the difference of lead and lags from these values. It decreases to
zero; from then on the reference in force is the target.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.control.reference.trajectory import Blend, Hold, Point, Reference
from soro_core.frozen import replaced
from soro_core.robot.coordinates import StrainFields

# Part of a strain limit below which the distance from the target counts as zero.
_NEGLIGIBLE = 1e-12
# Times that differ by less [s] are equal.
_SAME_S = 1e-9


@dataclass(frozen=True)
class Bounds:
    """Limits of every transition.

    Attributes
    ----------
    fields : StrainFields
        Strains of the robot.
    strain, rate : ndarray (n_q,)
        Largest absolute strain, and rate of strain [1/s], of the field of each coordinate.
    smoothing_s : float
        Time constant of each of the two lags [s].
    """

    fields: StrainFields
    strain: Array
    rate: Array
    smoothing_s: float


@dataclass(frozen=True)
class ReferenceTransition:
    """State of the reference in force.

    Attributes
    ----------
    target : Reference
        End of the transition.
    t_s : float
        Time of the last tick [s].
    at : Point
        The target at that time.
    gap : ndarray (3, n_q)
        Lead, first lag and second lag, minus their values for exact following of the target.
    left_s : float
        Time left [s] until the lead meets that of the target; the limits may extend it.
    limited : bool
        Whether the limits of rate apply. False until the first change of the target: the durations of the
        start and of the configured circle are configured.
    """

    target: Reference
    t_s: float
    at: Point
    gap: Array
    left_s: float
    limited: bool


def begin(bounds: Bounds, q: Array, target: Reference, t: float, within_s: float) -> ReferenceTransition:
    """Return the transition from rest to a target, a smooth step.

    Parameters
    ----------
    bounds : Bounds
        Limits of strain and rate.
    q : ndarray (n_q,)
        Coordinates at the start.
    target : Reference
        End of the transition.
    t : float
        Time of the start [s].
    within_s : float
        Duration [s].

    Returns
    -------
    ReferenceTransition
    """
    blend = Blend(Hold(bounds.fields.within(q, bounds.strain)), target, t, within_s)
    at = blend.sample(t)
    return ReferenceTransition(blend, t, at, np.zeros((3, at.q.size)), 0.0, False)


def redirect(
    bounds: Bounds, transition: ReferenceTransition, target: Reference, t: float, within_s: float
) -> ReferenceTransition:
    """Return the transition to another target, with position, velocity and acceleration of the last one.

    Parameters
    ----------
    bounds : Bounds
        Limits of strain and rate.
    transition : ReferenceTransition
        The last transition.
    target : Reference
        End of the new transition.
    t : float
        Time of the change [s].
    within_s : float
        Time after which the lead meets that of the target [s]; the limits may extend it.

    Returns
    -------
    ReferenceTransition
    """
    at = target.sample(t)
    gap = _lags(transition.at, bounds) + transition.gap - _lags(at, bounds)
    return ReferenceTransition(target, t, at, gap, within_s, True)


def advance(bounds: Bounds, transition: ReferenceTransition, t: float, dt: float) -> ReferenceTransition:
    """Return the transition at time `t`.

    If more time than `dt` has passed since the last tick, the reference has stood still in the rest of it,
    while the target moved.

    Parameters
    ----------
    bounds : Bounds
        Limits of strain and rate.
    transition : ReferenceTransition
        State at the last tick.
    t, dt : float
        Time, and length of this tick [s].

    Returns
    -------
    ReferenceTransition
    """
    if abs(t - dt - transition.t_s) > _SAME_S:
        transition = redirect(bounds, transition, transition.target, t - dt, transition.left_s)
    at = transition.target.sample(t)
    if not transition.limited:
        return replaced(transition, t_s=t, at=at)
    gap = transition.gap
    left = max(transition.left_s - dt, 0.0)
    fading = gap[0] * (left / transition.left_s if left > 0.0 else 0.0)
    here, goal, h = _lags(transition.at, bounds) + gap, _lags(at, bounds), dt / bounds.smoothing_s
    lead = _within_reach(bounds, here[0], goal[0] + fading, dt)
    # At its limits the lead moves in a straight line in this tick; otherwise it moves as that of the target.
    gap = _lagged(gap, fading, h) if lead is None else _lagged(here, lead, h) - goal
    if np.all(np.abs(gap) <= _NEGLIGIBLE * bounds.strain):
        gap = np.zeros_like(gap)
    return replaced(transition, t_s=t, at=at, gap=gap, left_s=left)


def point(bounds: Bounds, transition: ReferenceTransition) -> Point:
    """Return the reference in force at the time of the transition."""
    if not transition.limited:  # the gap is zero
        return transition.at
    at, (lead, first, second), T = transition.at, transition.gap, bounds.smoothing_s
    return Point(
        at.q + second,
        at.qd + (first - second) / T,
        at.qdd + (lead - 2.0 * first + second) / (T * T),
    )


def _lead(at: Point, bounds: Bounds) -> Array:
    T = bounds.smoothing_s
    return np.asarray(at.q + 2.0 * T * at.qd + T * T * at.qdd)


def _lags(at: Point, bounds: Bounds) -> Array:
    """Return lead and lags (3, n_q) of exact following at a point."""
    return np.stack([_lead(at, bounds), at.q + bounds.smoothing_s * at.qd, at.q])


def _within_reach(bounds: Bounds, begin: Array, wanted: Array, dt: float) -> Array | None:
    """Return the position of the lead that the limits allow after `dt`; None if they allow `wanted`."""
    inside = bounds.fields.within(wanted, bounds.strain)
    move = inside - begin
    most = float(np.max(bounds.fields.peaks(move) / bounds.rate)) / dt
    if most > 1.0:
        # One factor for all strains keeps the direction.
        return np.asarray(begin + move / most)
    return None if np.array_equal(inside, wanted) else inside


def _lagged(rows: Array, lead: Array, h: float) -> Array:
    """Return lead and lags after `h` time constants, while the lead moves from ``rows[0]`` to `lead`."""
    start, first, second = rows
    slope, rest = (lead - start) / h, math.exp(-h)
    one = first - start + slope
    two = second - start + 2.0 * slope
    return np.stack([lead, lead - slope + one * rest, lead - 2.0 * slope + (one * h + two) * rest])
