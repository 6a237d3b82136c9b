"""Prediction of mean and covariance over a step, in parts where one step does not settle."""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.estimation.kernel import covariance as spread
from soro_core.estimation.kernel import motion
from soro_core.estimation.kernel.parts import FilterArm
from soro_core.model.dynamics import COLLAPSED, GOOD
from soro_core.model.links.linear import assign, assign_matrix

# Most parts of a step: an arm that a wrong update has thrown far out springs back fast.
_MOST_PARTS = 16


@inner
def _part(
    arm: FilterArm, share: float, pressure: Array, dt: float, mean: Array, internal: Array, P: Array
) -> int:
    """Move the belief by one part of a step, in place; gives a code."""
    s, w = arm.settings, arm.scratch
    n = s.limit.shape[0]
    assign(mean, w.start)
    assign(internal, w.start_internal)
    code: int = motion.step_mean(arm, w.start, w.start_internal, pressure, dt, mean, internal)
    if code == GOOD:
        code = spread.step_covariance(arm, P, share, dt, P)
    if code == GOOD:
        motion.limit(arm, mean[:n])
        _fade(arm, dt, mean)
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
def predict(
    arm: FilterArm,
    share: float,
    mean: Array,
    internal: Array,
    covariance: Array,
    pressure: Array,
    dt: float,
    mean1: Array,
    internal1: Array,
    covariance1: Array,
) -> int:
    """mean1, internal1, covariance1 <- belief after dt with the load of `motion.load`; gives a code.

    Where it is not GOOD the arm is held at rest, and its covariance grows.
    """
    code, parts = COLLAPSED, 1
    while code != GOOD and parts <= _MOST_PARTS:
        assign(mean, mean1)
        assign(internal, internal1)
        assign_matrix(covariance, covariance1)
        done = 0
        code = GOOD
        while code == GOOD and done < parts:
            code = _part(arm, share, pressure, dt / parts, mean1, internal1, covariance1)
            done += 1
        parts *= 2
    if code != GOOD:
        n = arm.settings.limit.shape[0]
        assign(mean, mean1)
        assign(internal, internal1)
        for i in range(n):
            mean1[n + i] = 0.0
        motion.limit(arm, mean1[:n])
        _fade(arm, dt, mean1)
        spread.hold_covariance(arm, covariance, dt, covariance1)
    return code
