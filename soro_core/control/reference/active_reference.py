"""The active reference: the configured one first, then each new one, reached by a transition."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.control.reference.reference_transition import (
    Bounds,
    ReferenceTransition,
    advance,
    begin,
    point,
    redirect,
)
from soro_core.control.reference.trajectory import Blend, Hold, Point, Reference
from soro_core.frozen import replaced

# Part of the limit of a strain within which a transition has arrived.
_ARRIVED = 1e-3
# References that arrive within this time [s] of each other form a stream.
STREAM_S = 1.0


@dataclass(frozen=True)
class ActiveReference:
    """State of following.

    Attributes
    ----------
    configured : Reference
        The configured reference, which starts at the first tick.
    given : Reference or None
        The reference given last, including one that repeats the one in force.
    wanted : Reference
        The reference to follow.
    changed_s : float
        Time of the last change of `wanted` [s].
    transition : ReferenceTransition
        Transition to `wanted`.
    """

    configured: Reference
    given: Reference | None
    wanted: Reference
    changed_s: float
    transition: ReferenceTransition


def follow(
    bounds: Bounds,
    start_s: float,
    configured: Reference | None,
    state: ActiveReference | None,
    q: Array,
    t: float,
    dt: float,
    reference: Reference | None,
) -> ActiveReference:
    """Return the state of following at time `t`.

    A reference that repeats the one in force changes nothing. Another one is reached within `start_s`. In a
    stream, whose messages arrive less than `STREAM_S` after each other, each is reached evenly in the time
    between two messages.

    Parameters
    ----------
    bounds : Bounds
        Limits of strain and rate.
    start_s : float
        Duration of the start, and of the transition to a single reference [s].
    configured : Reference or None
        The configured reference, a circle from time 0 on; None to hold the arm where it is.
    state : ActiveReference or None
        State after the last tick; None before the first one.
    q : ndarray (n_q,)
        Coordinates of the arm, used at the start.
    t, dt : float
        Time and time since the last tick [s].
    reference : Reference or None
        The reference given last; None for the configured one.

    Returns
    -------
    ActiveReference
    """
    if state is None:
        rest = bounds.fields.within(q, bounds.strain)
        own = Hold(rest) if configured is None else configured.started_at(t)
        wanted = own if reference is None else reference
        changed_s = -math.inf if reference is None else t
        return ActiveReference(own, reference, wanted, changed_s, begin(bounds, rest, wanted, t, start_s))
    transition, wanted = state.transition, state.configured if reference is None else reference
    if reference is not state.given and not state.wanted.is_repeated_by(wanted, t):
        since_s = t - state.changed_s
        transition = redirect(bounds, transition, wanted, t - dt, since_s if since_s <= STREAM_S else start_s)
        state = replaced(state, wanted=wanted, changed_s=t)
    return replaced(state, given=reference, transition=advance(bounds, transition, t, dt))


def blended(state: ActiveReference, reference: Reference, t: float, within_s: float) -> ActiveReference:
    """Return the state with a smooth step to a like motion in place of the one in force, which goes on.

    It has no limits of rate, unlike a transition to another motion: the speed of a circle is configured.

    Parameters
    ----------
    state : ActiveReference
        State after the last tick.
    reference : Reference
        Also the configured one from now on where none is given.
    t : float
        Time of the last tick [s].
    within_s : float
        Duration [s].

    Returns
    -------
    ActiveReference
    """
    configured = reference if state.given is None else state.configured
    transition = replaced(state.transition, target=Blend(state.wanted, reference, t, within_s))
    return replaced(state, configured=configured, wanted=reference, transition=transition)


def reference_ahead(bounds: Bounds, state: ActiveReference, time_s: float) -> Point:
    """Return the reference `time_s` after the last tick, if no other is given meanwhile.

    Parameters
    ----------
    bounds : Bounds
        Limits of strain and rate.
    state : ActiveReference
        State after the last tick.
    time_s : float
        Time ahead [s], 0 or more.

    Returns
    -------
    Point
    """
    transition = state.transition
    return point(
        bounds, advance(bounds, transition, transition.t_s + time_s, time_s) if time_s > 0.0 else transition
    )


def at_rest(bounds: Bounds, state: ActiveReference) -> bool:
    """Whether the reference in force has come to the end of the wanted one, where that rests."""
    transition = state.transition
    has_arrived = bool(np.all(np.abs(transition.gap) <= _ARRIVED * bounds.strain))
    return has_arrived and transition.t_s >= transition.target.end_s
