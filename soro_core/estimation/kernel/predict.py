"""Prediction of mean and covariance over a step, in parts where one step does not settle."""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.estimation.kernel import covariance as spread
from soro_core.estimation.kernel import motion
from soro_core.estimation.kernel.belief import Belief, assign_belief
from soro_core.estimation.kernel.parts import FilterArm
from soro_core.model.dynamics import COLLAPSED, GOOD

# Most parts of a step: an arm that a wrong update has thrown far out springs back fast.
_MOST_PARTS = 16


@inner
def _part(arm: FilterArm, pressure: Array, dt: float, belief: Belief) -> int:
    """Move the belief by one part of a step, in place; gives a code."""
    code: int = motion.step_mean(arm, pressure, dt, belief)
    if code == GOOD:
        code = spread.step_covariance(arm, belief.covariance, dt, belief.covariance)
    if code == GOOD:
        motion.limit(arm, belief.mean[: belief.n])
        _fade(arm, dt, belief.mean)
    return code


@inner
def _fade(arm: FilterArm, dt: float, mean: Array) -> None:
    """Advance disturbance and drift."""
    s = arm.settings
    n = s.limit.shape[0]
    if s.n_d > 0:
        fade = math.exp(-dt / arm.scratch.fading[0])
        for i in range(n):
            d, e = mean[2 * n + i], mean[3 * n + i]
            mean[2 * n + i], mean[3 * n + i] = fade * (d + dt * e), fade * e


@inner
def predict(arm: FilterArm, belief: Belief, pressure: Array, dt: float, out: Belief) -> int:
    """Out <- belief after dt with the load of `motion.load`; gives a code.

    Where it is not GOOD the arm is held at rest, and its covariance grows.
    """
    code, parts = COLLAPSED, 1
    while code != GOOD and parts <= _MOST_PARTS:
        assign_belief(belief, out)
        done = 0
        code = GOOD
        while code == GOOD and done < parts:
            code = _part(arm, pressure, dt / parts, out)
            done += 1
        parts *= 2
    if code != GOOD:
        n = belief.n
        assign_belief(belief, out)
        for i in range(n):
            out.mean[n + i] = 0.0
        motion.limit(arm, out.mean[:n])
        _fade(arm, dt, out.mean)
        spread.hold_covariance(arm, belief.covariance, dt, out.covariance)
    return code
