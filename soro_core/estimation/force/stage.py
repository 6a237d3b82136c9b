"""Stages of a contact: nothing, an outside force that may be a load, a contact, which no load explains.

The force is that beyond the load of before it. A load that comes pulls along gravity and moves with the tip.
Of all loads the one that explains the force best leaves a rest; where that is beyond its deviations for a
while, it is a contact. Where it is not, a push may be the better explanation still: on a bent arm one in the
plane of gravity leaves no rest either. It is a load once that is likelier than a push by far. What pulls
along the backbone alone is neither: errors of stiffness, gain and damping look the same, and are learned.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from soro_core.adaptation.external_force import Stage
from soro_core.arrays import Array
from soro_core.estimation.force.average import ALONG, INERTIA_ALONG

# Squares of the deviations (chi-square of 3 and of 2 components) of a force and of what no load explains,
# beyond which they are there, and below which they have gone. The first is that of five deviations: a learner
# that is still on its way is more wrong than it knows, and stopping it for nothing costs more than 40 ms.
_FORCE, _NO_FORCE = 25.0, 11.3
_NO_LOAD, _A_LOAD = 11.8, 4.6
# How long each must last [s]: a sample may be wrong, a new load swings, and the learner's low-pass remembers.
_FORCE_S, _GONE_S, _NO_LOAD_S, _A_LOAD_S = 0.015, 0.4, 0.25, 0.3
# How long a load must explain an outside force, from which on it is one [s], and by how much better than a
# push (logarithm of 20): one is as rare as the other.
_LOAD_S, _LIKELIER = 0.2, 3.0
# How long the mass waits, while the arm swings, until a load is likelier or may have gone [s]; and then while
# a push is likelier. After a load it waits no more: a heavy one that is not yet known shakes the arm.
_ASKS_S = 0.6
# Time of the mean of what is usual, and that of a moving arm after which what is neither a load nor a contact
# becomes usual and is learned [s].
_USUAL_S, _LEARNED_S = 1.0, 2.0
# Part of the largest force below which one may have gone while the arm swings.
_LEFT = 0.25
# Time for which the mass of before a push that has left is told to the law [s].
_LEFT_S = 0.1
# Time in which what is known of a swing fades [s].
_SWING_S = 0.3


class StageState(NamedTuple):
    """The stage, and how long [s] what would change it has lasted.

    Attributes
    ----------
    stage : {"free", "outside force", "contact"}
    force_s, gone_s : float
        There is a force; there is none.
    no_load_s, load_s, likelier_s : float
        No load explains it; a load does; and does so much better than a push.
    outside_s : float
        Time of the outside force in which the arm moved [s].
    left_s : float
        Time that is left in which a push has just gone [s].
    largest_n : float
        Largest force across the backbone since it is an outside force [N].
    swing : float
        Largest acceleration of the tip of late, as a part of gravity.
    usual : float
        Mean square of the force of late in its deviations, without one from outside; 3 if these are right.
    asks_s : float
        Time for which it may be open whether an outside force is a load [s]; below 0 once it may be one.
    is_push : bool
        Whether an outside force is not to be learned as a load.
    """

    stage: Stage = "free"
    force_s: float = 0.0
    gone_s: float = 0.0
    no_load_s: float = 0.0
    load_s: float = 0.0
    likelier_s: float = 0.0
    outside_s: float = 0.0
    left_s: float = 0.0
    largest_n: float = 0.0
    swing: float = 0.0
    usual: float = 30.0
    asks_s: float = _ASKS_S
    is_push: bool = False

    @property
    def doubt(self) -> float:
        """Factor, 1 or more, by which covariances are too small for the force of late."""
        return max(1.0, self.usual / 3.0)

    @property
    def mass_free(self) -> bool:
        """Whether what pushes, or has just pushed, may be a load."""
        return self.stage != "contact" and not self.is_push and self.left_s <= 0.0


class ForceSeen(NamedTuple):
    """What an estimate says of the force.

    Attributes
    ----------
    fast, slow, of_any : tuple of ndarray (3,), (3, 3)
        Force [N] and its covariance behind the fast low-pass, in the average as of a push, and in that as
        of a push or a load.
    gravity : ndarray (3,)
        Its acceleration [m/s^2].
    load_kg : float
        Mass that the tip is believed to carry, of which no more can have gone.
    inertia_kg : float
        Mass that, with its acceleration, makes the error of the force of inertia.
    acceleration : float
        That of the tip [m/s^2].
    moves : bool
        Whether the arm moves.
    """

    fast: tuple[Array, Array]
    slow: tuple[Array, Array]
    of_any: tuple[Array, Array]
    gravity: Array
    load_kg: float
    inertia_kg: float
    acceleration: float
    moves: bool = True


def next_stage(state: StageState, seen: ForceSeen, dt: float) -> StageState:
    """Return the stage after an estimate.

    Parameters
    ----------
    state : StageState
    seen : ForceSeen
    dt : float
        Time since the last estimate [s].
    """
    fast, slow, of_any, gravity, load_kg, inertia_kg, acceleration, moves = seen
    # What the model misses while it learns comes and goes with the motion; a force from outside is new.
    size, usual, left_s = _size(*fast), state.usual, max(state.left_s - dt, 0.0)
    # With more doubt along one direction it is less.
    is_force = size > state.doubt * _FORCE
    is_force = is_force and _size(fast[0], _beside_weakest(fast[0], state.doubt * fast[1])) > _FORCE
    force_s = state.force_s + dt if is_force else 0.0
    # A load that swings pulls aside by as much of its weight as its acceleration is of gravity.
    weight = max(float(np.linalg.norm(gravity)), 1e-9)
    swing = max(math.exp(-dt / _SWING_S) * state.swing, acceleration / weight)
    if state.stage == "free":
        if force_s > _FORCE_S + 0.5 * dt:
            return StageState("outside force", force_s, outside_s=dt * moves, swing=swing, usual=usual)
        usual = usual if is_force else _more_usual(usual, size, dt)
        return StageState(force_s=force_s, left_s=left_s, swing=swing, usual=usual)
    strength = _across(*slow)
    largest_n = max(state.largest_n, strength)
    # The error of the force of inertia hides a small rest of a force, not the force.
    inertia_n = inertia_kg * weight * swing
    still_n = inertia_n if strength < _LEFT * largest_n else 0.0

    def left(force: Array, covariance: Array) -> float:
        return _size(force, _beside_weakest(force, state.doubt * covariance + still_n**2 * np.eye(3)))

    is_gone = (left(*fast) < _FORCE if still_n else not is_force) and left(*slow) < _NO_FORCE
    gone_s = state.gone_s + dt if is_gone else 0.0
    aside = swing**2 * float(of_any[0] @ of_any[0]) * np.eye(3)
    told = of_any[0], state.doubt * of_any[1]
    rest = _rest(told[0], told[1] + aside, gravity, load_kg)
    no_load_s = state.no_load_s + dt if rest > _NO_LOAD else 0.0
    # Without the doubt by the swing, in which everything is a load.
    is_load = _rest(*told, gravity, load_kg) < _A_LOAD
    load_s = state.load_s + dt if is_load else 0.0
    swung = told[0], _swung(told[1], inertia_n)
    likelier = _likelier(*swung, gravity)
    may_be_load = _rest(*swung, gravity, load_kg) < _A_LOAD
    likelier_s = state.likelier_s + dt if may_be_load and likelier > _LIKELIER else 0.0
    # A push that is learned as a load makes the law push back, and may fell a soft arm.
    is_told = likelier > _LIKELIER or (may_be_load and _load_change(*swung, gravity) < 0.0)
    asks_s = -1.0 if is_told or state.asks_s < 0.0 else max(state.asks_s - dt, 0.0)
    is_push = asks_s > 0.0 or (asks_s == 0.0 and likelier < -_LIKELIER)
    stage: Stage = state.stage
    if gone_s > _GONE_S:
        stage, left_s = "free", _LEFT_S
    elif stage == "outside force" and (likelier_s > _LOAD_S or state.outside_s > _LEARNED_S):
        # A load is learned with all else, and is usual at once: it is not to come again as a force.
        stage, usual = "free", max(usual, size)
    elif stage == "outside force" and no_load_s > _NO_LOAD_S:
        stage = "contact"
    elif stage == "contact" and load_s > _A_LOAD_S:
        stage = "outside force"
    outside_s = state.outside_s + dt * moves if stage == "outside force" else 0.0
    if stage == "free" and not is_force:
        usual = _more_usual(usual, size, dt)
    times = force_s, gone_s, no_load_s, load_s, likelier_s, outside_s, left_s
    is_push = is_push and stage == "outside force"
    return StageState(stage, *times, largest_n, swing, usual, asks_s, is_push)


def _more_usual(usual: float, size: float, dt: float) -> float:
    """Return the mean square of a force without one from outside after a time dt [s] of this size."""
    return usual + (1.0 - math.exp(-dt / _USUAL_S)) * (size - usual)


def _size(force: Array, covariance: Array) -> float:
    """Return the square of a force in its deviations."""
    return float(force @ np.linalg.solve(covariance, force))


def _beside_weakest(force: Array, covariance: Array) -> Array:
    """Return the covariance with doubt of all of the force along the direction of the largest deviation.

    The less that direction stands out, the less is added: with equal deviations, nothing.
    """
    variances, directions = np.linalg.eigh(covariance)
    weakest, share = directions[:, -1], 1.0 - variances[-2] / variances[-1]
    return np.asarray(covariance + share * float(weakest @ force) ** 2 * np.outer(weakest, weakest))


def _swung(covariance: Array, inertia_n: float) -> Array:
    """Return the covariance with that by an error of the force of inertia [N], which no average takes out."""
    weak = np.linalg.eigh(covariance)[1][:, -1]
    by_inertia = np.eye(3) + (INERTIA_ALONG**2 - 1.0) * np.outer(weak, weak)
    return np.asarray(covariance + inertia_n**2 * by_inertia)


def _across(force: Array, covariance: Array) -> float:
    """Return how much of a force is across the direction of the largest deviation [N]."""
    weakest = np.linalg.eigh(covariance)[1][:, -1]
    return float(np.linalg.norm(force - float(weakest @ force) * weakest))


def _rest(force: Array, covariance: Array, gravity: Array, load_kg: float) -> float:
    """Return the same of what the best change of the load leaves."""
    change_kg = max(_load_change(force, covariance, gravity), -max(load_kg, 0.0))
    return _size(force - change_kg * gravity, covariance)


def _load_change(force: Array, covariance: Array, gravity: Array) -> float:
    """Return the change of the load that explains a force best [kg]."""
    by_gravity = np.linalg.solve(covariance, gravity)
    along = float(gravity @ by_gravity)
    return float(force @ by_gravity) / along if along > 0.0 else 0.0


def _likelier(force: Array, covariance: Array, gravity: Array) -> float:
    """Return the logarithm of how much likelier a change of the load makes the force than a push does.

    Both are of any size. A push comes from any side, and along the backbone with less.
    """
    variances, directions = np.linalg.eigh(covariance)
    weakest, share = directions[:, -1], 1.0 - variances[-2] / variances[-1]
    down = gravity / max(float(np.linalg.norm(gravity)), 1e-9)
    across = force - share * float(weakest @ force) * weakest
    seen = down - share * float(weakest @ down) * weakest
    size = float(across @ across)
    push = size * (np.eye(3) - share * (1.0 - ALONG**2) * np.outer(weakest, weakest))
    load = size / max(float(seen @ seen), 1e-2) * np.outer(down, down)
    by_push, by_load = covariance + push, covariance + load
    ratio = np.linalg.slogdet(by_push)[1] - np.linalg.slogdet(by_load)[1]
    return 0.5 * float(_size(force, by_push) - _size(force, by_load) + ratio)
