"""Detect a limit cycle of the loop, or an arm that runs away, and lower or raise the feedback of any law.

Feedback that comes too late for its gains makes the loop swing at a frequency of its own, up to where a bound
holds it. Half swings of the tracking error of a coordinate, of like duration and not becoming smaller, in
which the feedback swings too, are a limit cycle, unless the reference turns about as fast. After a step of
the load the loop swings until the load is learned: the estimate jumps then, and nothing is judged for a
while. Nor is an arm whose pressures end before what it needs: no feedback moves it then. Feedback that has
been lowered stays so: what made it swing is still there.

An arm that is softer than its file, or bears more, may need more feedback than its file asks for: it runs
away from the reference, and falls in the learned model, too. Automatic gains are raised then, until the
learned arm stands with less (docs/adr/0081).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from soro_core.adaptation.scales import scales_of
from soro_core.arrays import Array
from soro_core.control.control_monitor import DEFICIT_PA, DEFICIT_S
from soro_core.control.laws.protocol import ArmBelief, Law, Terms
from soro_core.errors import ConfigError
from soro_core.frozen import replaced

if TYPE_CHECKING:
    from soro_core.model import SoftArm

# Least height of a half swing: of the error in units of q, of the feedback in units of force. The tip of the
# three-bellow arm swings by 1 % of its length then, about its middle, and its pressures by 0.3 kPa.
_LEAST_Q, _LEAST_FORCE = 0.08, 0.4
# A turn is known once a signal has come back by this part of its half swing, and of the least one: of the
# error, which is noisy, and of the reference, which is not. A faster swing than of so many ticks is noise.
_BACK_PART, _BACK_LEAST = (0.25, 0.02), (0.5, 0.05)
_LEAST_TICKS = 3.5
# Half swings that are compared: with the quarter before them, a limit cycle is known within two periods.
_HALVES = 3
# A jump of the estimate that its rate does not explain, in units of q, and the number of half swings after it
# that are not judged. Nothing is watched while the filter moves from its start to the arm [s].
_JUMP_Q, _UNJUDGED, _START_S = 0.24, 10, 0.5
# Least ratio of their durations, and of the last height to the first.
_EVEN_PART, _LASTS_PART = 0.6, 0.9
# The error of a right loop may swing at harmonics of the reference up to this one.
_HARMONICS = 3.5
# Factor on the feedback at each detection, and the least part of it that is left.
_LOWERED, _LEAST_PART = 0.5, 1.0 / 16.0
# An error beyond this, in units of q, that has grown for this time without turning [s]; factor on the
# feedback then. It ends where the learned arm keeps this part of its stiffness with its gains alone.
_FAR_Q, _GROWS_S, _RAISED, _STANDS = 0.4, 0.15, 3.0, 0.3
# Time from then on in which no swing is judged [s]: until slopes are in force, W stands for them, and makes
# the arm swing at any gains (docs/adr/0063).
_LEARNS_S = 5.0

# What a law must tell of its force.
FEEDBACK = "error", "proportional", "derivative"


class AskedForce(NamedTuple):
    """What a tick asks of the chambers.

    Attributes
    ----------
    terms : mapping of str to ndarray (n,)
        Those of the law; without `error`, `proportional` and `derivative` nothing is watched.
    bias : ndarray (n,)
        Force of what the observer of the regulators takes off the command.
    missing_pa : ndarray (n_u,)
        Pressure beyond its bound that the desired force needs of each chamber [Pa].
    stiffness : callable
        Gives what `soro_core.adaptation.modes.least_stiffness` finds of the learned arm.
    """

    terms: Terms
    bias: Array
    missing_pa: Array
    stiffness: Callable[[], float]


@dataclass(frozen=True)
class LimitCycleState:
    """Turning points of 2 n signals: the tracking error of n coordinates, then the reference.

    Attributes
    ----------
    t_s : float
        Time under control [s].
    side, extreme, at_s : ndarray (2 n,)
        1 while a signal rises and -1 while it falls, its outermost value since it turned, and when [s].
    values, times_s : ndarray (2 n, 4)
        Last turning points, the newest last; times are NaN before the first.
    least, most : ndarray (n,)
        Of the feedback since the error turned.
    pushed : ndarray (n, 3)
        Heights of the feedback in the last half swings.
    place, rate : ndarray (n,)
        Estimate at the last tick, in units of q.
    far_s : ndarray (n,)
        Time for which each coordinate has been far from its reference without turning back [s].
    short_s : ndarray (n_u,)
        Time for which each chamber has lacked pressure without a break [s].
    jumped_s : float
        When the estimate jumped last [s].
    part, note : float, str
        Factor on the feedback that is in force; what the user must know, or an empty string.
    raised_s : float
        When the feedback was raised [s].
    """

    t_s: float
    side: Array
    extreme: Array
    at_s: Array
    values: Array
    times_s: Array
    least: Array
    most: Array
    pushed: Array
    place: Array
    rate: Array
    far_s: Array
    short_s: Array
    jumped_s: float = -math.inf
    part: float = 1.0
    note: str = ""
    raised_s: float = -math.inf


def no_limit_cycle(n: int) -> LimitCycleState:
    """Return the state of `n` coordinates before anything has turned."""
    zero, points = np.zeros(2 * n), np.zeros((2 * n, _HALVES + 1))
    still, pushed = np.zeros(n), np.zeros((n, _HALVES))
    return LimitCycleState(
        0.0,
        zero + 1.0,
        zero,
        zero,
        points,
        points + np.nan,
        still,
        still,
        pushed,
        still,
        still,
        still,
        np.zeros(1),
    )


class LimitCycleWatch:
    """Watches the terms of a law.

    Parameters
    ----------
    arm : SoftArm
        Its units say which swing counts; an arm with a strain without stiffness has none, and no watch.
    pieces : int
        Number of pieces into which each link is discretised.
    acts_after_s : float
        Time until a set point acts [s]: no half swing of the loop is shorter.
    raises : bool
        Whether the feedback of an arm that runs away is raised: that of automatic gains alone.
    """

    def __init__(
        self, arm: SoftArm, pieces: int = 1, acts_after_s: float = 0.0, raises: bool = False
    ) -> None:
        self.acts_after_s, self.raises = acts_after_s, raises
        try:
            scales = scales_of(arm, pieces)
        except ConfigError:
            self.units = None
        else:
            self.units = scales.q, scales.force
            self.back_part, back_q = np.repeat([_BACK_PART, _BACK_LEAST], scales.q.size, axis=1)
            self.back_q = _LEAST_Q * back_q

    def step(
        self,
        state: LimitCycleState,
        asked: AskedForce,
        reference: Array,
        belief: ArmBelief,
        dt: float,
    ) -> LimitCycleState:
        """Return the state after a tick.

        Parameters
        ----------
        state : LimitCycleState
            After the last tick.
        asked : AskedForce
        reference : ndarray (n,)
            Coordinates of the reference.
        belief : ArmBelief
        dt : float
            Time since the last tick [s].
        """
        terms, bias, missing_pa, stiffness = asked
        if self.units is None or any(np.shape(terms.get(name, ())) != reference.shape for name in FEEDBACK):
            return state
        (by_q, by_force), t_s = self.units, state.t_s + dt
        signal = np.concatenate([terms["error"] / by_q, reference / by_q])
        feedback = (terms["proportional"] + terms["derivative"] - bias) / by_force
        place, rate = belief.q / by_q, belief.qd / by_q
        jump = np.abs(place - state.place - 0.5 * dt * (rate + state.rate)).max()
        starts = t_s < _START_S
        is_short = np.abs(missing_pa) > DEFICIT_PA
        short_s = np.where(is_short, state.short_s + dt, 0.0)
        has_jumped = jump > _JUMP_Q and not starts
        ahead = state.side * (signal - state.extreme)
        is_out = (ahead > 0.0) | starts
        height = np.abs(state.extreme - state.values[:, -1])
        turned = -ahead > np.maximum(self.back_part * height, self.back_q)
        part, note, raised_s = state.part, state.note, state.raised_s
        is_pushed = belief.external is not None and belief.external.stage != "free"
        is_judged = not (starts or has_jumped or is_pushed or is_short.any())
        own = slice(reference.size)
        is_far = is_judged & (state.side * signal > _FAR_Q)[own] & ~turned[own]
        far_s = np.where(is_far, state.far_s + dt, 0.0)
        if part > 1.0:
            if any(turned[own].tolist()) and stiffness() > _STANDS:
                part, note = 1.0, ""
        elif self.raises and part == 1.0 and (is_out[own] & (far_s > _GROWS_S)).any():
            if stiffness() < 0.0:
                part, raised_s = _RAISED, t_s
                note = f"the arm runs away: feedback raised to {part:.2g} times its gains"
            far_s = np.zeros_like(far_s)  # the stiffness takes as long as three ticks
        after = replaced(
            state,
            part=part,
            note=note,
            far_s=far_s,
            raised_s=raised_s,
            t_s=t_s,
            extreme=np.where(is_out, signal, state.extreme),
            at_s=np.where(is_out, t_s, state.at_s),
            least=feedback if starts else np.minimum(state.least, feedback),
            most=feedback if starts else np.maximum(state.most, feedback),
            place=place,
            rate=rate,
            short_s=short_s,
            jumped_s=t_s if has_jumped else state.jumped_s,
        )
        shortest_s = max(self.acts_after_s, _LEAST_TICKS * dt)
        return _turned(after, turned, signal, feedback, shortest_s) if any(turned.tolist()) else after


def watch_of(law: Law[Any]) -> LimitCycleWatch:
    """Return the watch of a law; of those that learn, automatic gains are raised where the arm needs it."""
    of = law.setting
    raises = of.config.gains.automatic and law.learns
    return LimitCycleWatch(of.arm, of.pieces, of.pressures.preview_s, raises)


def scaled_feedback(terms: Terms, desired: Array, part: float) -> tuple[Terms, Array]:
    """Return terms and desired force of a law with its feedback times a factor.

    Parameters
    ----------
    terms : mapping of str to ndarray (n,)
        Those of the law, in units of force.
    desired : ndarray (n,)
        Force that the law asks for.
    part : float
        Factor on the feedback.

    Returns
    -------
    terms, desired
        Unchanged if the terms lack one of `FEEDBACK`.
    """
    if any(np.shape(terms.get(name, ())) != desired.shape for name in FEEDBACK):
        return terms, desired
    proportional, derivative = terms["proportional"], terms["derivative"]
    left = {"proportional": part * proportional, "derivative": part * derivative}
    return {**terms, **left}, desired - (1.0 - part) * (proportional + derivative)


def _turned(
    state: LimitCycleState, turned: NDArray[np.bool_], signal: Array, feedback: Array, least_s: float
) -> LimitCycleState:
    """Return the state after a tick at which some signals have turned; no half swing is below `least_s`."""
    n = feedback.size
    row, own = turned[:, None], turned[:n]
    values = np.where(row, np.column_stack([state.values[:, 1:], state.extreme]), state.values)
    times_s = np.where(row, np.column_stack([state.times_s[:, 1:], state.at_s]), state.times_s)
    pushed = np.column_stack([state.pushed[:, 1:], state.most - state.least])
    pushed = np.where(row[:n], pushed, state.pushed)
    heights, durations_s = np.abs(np.diff(values[:n])), np.diff(times_s)
    longest_s, shortest_s = durations_s[:n].max(axis=1), durations_s[:n].min(axis=1)
    # The reference has its last half swing, or a longer one that is not over.
    reference_s = np.fmin.reduce(np.fmax(durations_s[n:, -1], state.t_s - times_s[n:, -1]))
    swings = (
        own
        & (heights.min(axis=1) > _LEAST_Q)
        & (heights[:, -1] > _LASTS_PART * heights[:, 0])
        & (shortest_s > np.maximum(_EVEN_PART * longest_s, least_s))
        & (pushed.min(axis=1) > _LEAST_FORCE)
        & (state.t_s - state.jumped_s > _UNJUDGED * longest_s)
        & (state.short_s.max() < DEFICIT_S)
        & (state.t_s - state.raised_s > _LEARNS_S)
        & ~(_HARMONICS * longest_s > reference_s)
    )
    part, note = state.part, state.note
    if swings.any():
        part, hz = max(_LOWERED * part, _LEAST_PART), 0.5 / float(durations_s[:n][swings].mean())
        note = f"limit cycle at {hz:.1f} Hz: feedback lowered to {part:.2g} times its gains"
        times_s[:n] = np.nan  # what the lowered feedback makes of it is judged anew
    return replaced(
        state,
        side=np.where(turned, -state.side, state.side),
        extreme=np.where(turned, signal, state.extreme),
        at_s=np.where(turned, state.t_s, state.at_s),
        values=values,
        times_s=times_s,
        least=np.where(own, feedback, state.least),
        most=np.where(own, feedback, state.most),
        pushed=pushed,
        part=part,
        note=note,
    )
