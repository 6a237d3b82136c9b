"""Covariance over one step, with the derivatives of the mean's step.

The transition is that of the mean, the trapezoidal rule (Cayley form): with S of `motion` the rates change by
u = S^-1 (2 h A21 q + 2 h (h A21 + A22) v + h (d + d1)), h half the step, and the coordinates by h (2 v + u).
Both must be one: of a mode faster than the step the rule inverts the sign. White noise enters at the start,
in the middle and at the end by Simpson's rule.
"""

from __future__ import annotations

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.estimation.kernel.motion import step_system
from soro_core.estimation.kernel.parts import OF_DRIFT, OF_RATE, FilterArm
from soro_core.model.dynamics import GOOD, NOT_FINITE, SINGULAR, finite
from soro_core.model.links.linear import assign_matrix, clear, clear_matrix, lu_solve_rows


@inner
def _respond(arm: FilterArm, h: float) -> None:
    """scratch.response <- S^-1 (2 h A21, 2 h (h A21 + A22), 1), from the factors of S."""
    w = arm.scratch
    X, n = w.response, w.response.shape[0]
    for i in range(n):
        for j in range(n):
            X[i, j] = 2.0 * h * w.by_q[i, j]
            X[i, n + j] = h * X[i, j] + 2.0 * h * w.by_v[i, j]
            X[i, 2 * n + j] = 0.0
        X[i, 2 * n + i] = 1.0
    lu_solve_rows(w.system, w.pivots, X)


@inner
def _carry_rows(arm: FilterArm, h: float, P: Array, out: Array) -> None:
    """out <- Phi P."""
    s, w = arm.settings, arm.scratch
    X, n, m = w.response, s.limit.shape[0], P.shape[0]
    keep = (1.0 - h / w.fading[0]) / (1.0 + h / w.fading[0])
    drift = h * (1.0 + keep) / (1.0 + h / w.fading[0])
    u = w.added
    for i in range(n):
        clear(u)
        for k in range(2 * n):
            f = X[i, k]
            for c in range(m):
                u[c] += f * P[k, c]
        if s.n_d > 0:
            for k in range(n):
                f, g = h * (1.0 + keep) * X[i, 2 * n + k], h * drift * X[i, 2 * n + k]
                for c in range(m):
                    u[c] += f * P[2 * n + k, c] + g * P[3 * n + k, c]
            for c in range(m):
                out[2 * n + i, c] = keep * P[2 * n + i, c] + drift * P[3 * n + i, c]
                out[3 * n + i, c] = keep * P[3 * n + i, c]
        for c in range(m):
            out[i, c] = P[i, c] + h * (2.0 * P[n + i, c] + u[c])
            out[n + i, c] = P[n + i, c] + u[c]


@inner
def _carry(arm: FilterArm, h: float) -> None:
    """scratch.spread <- Phi spread Phi'."""
    w = arm.scratch
    m = w.spread.shape[0]
    _carry_rows(arm, h, w.spread, w.carried)
    for i in range(m):
        for j in range(m):
            w.turned[i, j] = w.carried[j, i]
    _carry_rows(arm, h, w.turned, w.spread)


@inner
def _find_noise(arm: FilterArm) -> None:
    """scratch.noise <- density of the rates' noise, the share of it with a learned force, and the pressures'.

    An error of a measured pressure is an error of force: what it accelerates depends on the load.
    """
    s, w = arm.settings, arm.scratch
    share = w.share[0]
    for i in range(w.noise.shape[0]):
        for j in range(w.noise.shape[0]):
            x, y = s.process[OF_RATE, i, j], s.learned_process[OF_RATE, i, j]
            w.noise[i, j] = x + share * (y - x)
            for k in range(w.by_p.shape[1]):
                w.noise[i, j] += s.pressure_process * w.by_p[i, k] * w.by_p[j, k]


@inner
def _add_noise(arm: FilterArm, time: float) -> None:
    """Add the process noise of so long [s], after `_find_noise`."""
    s, w = arm.settings, arm.scratch
    P, n, share = w.spread, s.limit.shape[0], w.share[0]
    for i in range(n):
        for j in range(n):
            P[n + i, n + j] += time * w.noise[i, j]
            if s.n_d > 0:
                x, y = s.process[OF_DRIFT, i, j], s.learned_process[OF_DRIFT, i, j]
                P[3 * n + i, 3 * n + j] += time * (x + share * (y - x))


@inner
def symmetric(P: Array, out: Array) -> bool:
    """out <- the symmetric part of P; False where it is not finite."""
    m, good = P.shape[0], True
    for i in range(m):
        for j in range(i + 1):
            out[i, j] = out[j, i] = 0.5 * (P[i, j] + P[j, i])
        good = good and finite(out[i, : i + 1])
    return good


@inner
def step_covariance(arm: FilterArm, covariance: Array, dt: float, out: Array) -> int:
    """out <- covariance after dt, after `motion.step_mean`, whose factors it uses; gives a code."""
    w = arm.scratch
    m = out.shape[0]
    _respond(arm, 0.5 * dt)
    _find_noise(arm)
    assign_matrix(covariance, w.spread)
    _add_noise(arm, dt / 6.0)
    _carry(arm, 0.5 * dt)
    assign_matrix(w.spread, out)
    if not step_system(arm, 0.25 * dt):
        return SINGULAR
    _respond(arm, 0.25 * dt)
    clear_matrix(w.spread)
    _add_noise(arm, 4.0 * dt / 6.0)
    _carry(arm, 0.25 * dt)
    _add_noise(arm, dt / 6.0)
    for i in range(m):
        for j in range(m):
            w.spread[i, j] += out[i, j]
    return GOOD if symmetric(w.spread, out) else NOT_FINITE


@inner
def hold_covariance(arm: FilterArm, covariance: Array, dt: float, out: Array) -> None:
    """out <- covariance after a step that has failed: it grows by its initial value a second."""
    for i in range(out.shape[0]):
        for j in range(out.shape[0]):
            out[i, j] = covariance[i, j] + dt * arm.settings.initial[i, j]
