"""Creep (Maxwell branches) and hysteresis (Dahl elements [D68]): states that the coordinates drag along.

docs/model.md (21), (22). The force on the left-hand side is -K lambda with lambda' = -lambda / tau - qd
(creep), +K z with z' = qd - |qd| z / range (hysteresis). Both dissipate: K z qd = d/dt(K z^2 / 2) + K |qd|
z^2 / range.
"""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.tables import AIR, CREEP, Tables

# Rows of the slopes of `internal_slopes`.
BY_START, BY_FIRST, BY_SECOND = 0, 1, 2


@inner
def add_internal_force(t: Tables, z: Array, force: Array) -> None:
    """force += generalised force of the internal states on the left-hand side."""
    for j in range(z.shape[0]):
        sign = -1.0 if t.internal_kind[j] == CREEP else 1.0
        force[t.internal_coordinate[j]] += sign * t.internal_stiffness[j] * z[j]


@inner
def internal_energy(t: Tables, z: Array) -> float:
    """Energy stored in the internal states [J]; what they do besides only dissipates."""
    energy = 0.0
    for j in range(z.shape[0]):
        energy += 0.5 * t.internal_stiffness[j] * z[j] * z[j]
    return energy


@inner
def internal_rate(t: Tables, qd: Array, z: Array, rate: Array) -> None:
    """rate <- dz/dt."""
    for j in range(z.shape[0]):
        v = qd[t.internal_coordinate[j]]
        if t.internal_kind[j] == CREEP:
            rate[j] = -z[j] / t.internal_scale[j] - v
        elif t.internal_kind[j] == AIR:
            rate[j] = 0.0
        else:
            rate[j] = v - abs(v) * z[j] / t.internal_scale[j]


@inner
def advance_internal(
    t: Tables, z0: Array, speeds: tuple[Array, Array], dt: float, z1: Array, tangent: Array
) -> None:
    """z1 <- states after dt with the velocity running linearly between two speeds.

    tangent <- d(force)/d(second speed) of each state.

    Exact for this velocity at any stiffness: creep by its exponential, hysteresis along the path
    travelled, in two pieces where the velocity changes sign.
    """
    v0, v1 = speeds
    for j in range(z0.shape[0]):
        a, b = v0[t.internal_coordinate[j]], v1[t.internal_coordinate[j]]
        scale = t.internal_scale[j]
        if t.internal_kind[j] == AIR:
            tangent[j] = 0.0
        elif t.internal_kind[j] == CREEP:
            decay, first, second = _creep_weights(dt / scale)
            z1[j] = decay * z0[j] - dt * ((first - second) * a + second * b)
            tangent[j] = t.internal_stiffness[j] * dt * second
        elif a * b < 0.0:
            turn = a / (a - b)
            z = _dahl(z0[j], 0.5 * a * turn * dt, scale)
            z1[j] = _dahl(z, 0.5 * b * (1.0 - turn) * dt, scale)
            tangent[j] = t.internal_stiffness[j] * 0.5 * dt
        else:
            path = 0.5 * (a + b) * dt
            z1[j] = _dahl(z0[j], path, scale)
            slope = 1.0 - math.copysign(1.0, path) * z1[j] / scale
            tangent[j] = t.internal_stiffness[j] * 0.5 * dt * max(slope, 0.0)


@inner
def _creep_weights(x: float) -> tuple[float, float, float]:
    """exp(-x), the mean of exp(-x t) for t = 0 ... 1, and that of (1 - t) exp(-x t); x: time over tau."""
    decay = math.exp(-x)
    if x > 1e-2:
        first = (1.0 - decay) / x
        second = (x - 1.0 + decay) / (x * x)
    else:
        first = 1.0 - x / 2.0 * (1.0 - x / 3.0 * (1.0 - x / 4.0 * (1.0 - x / 5.0)))
        second = 0.5 * (1.0 - x / 3.0 * (1.0 - x / 4.0 * (1.0 - x / 5.0 * (1.0 - x / 6.0))))
    return decay, first, second


@inner
def internal_slopes(t: Tables, z0: Array, v0: Array, v1: Array, dt: float, slope: Array) -> None:
    """slope (3, n_z) <- derivatives of z1 of `advance_internal` by z0, v0 and v1, in this order."""
    for j in range(z0.shape[0]):
        a, b = v0[t.internal_coordinate[j]], v1[t.internal_coordinate[j]]
        scale = t.internal_scale[j]
        if t.internal_kind[j] == CREEP:
            slope[BY_START, j], first, second = _creep_weights(dt / scale)
            slope[BY_FIRST, j] = -dt * (first - second)
            slope[BY_SECOND, j] = -dt * second
        elif a * b < 0.0:
            # Paths a^2 dt / 2 (a - b) to the turn and -b^2 dt / 2 (a - b) from it.
            change = 0.5 * dt / ((a - b) * (a - b))
            middle, keep1, by1 = _dahl_slopes(z0[j], change * (a - b) * a * a, scale)
            _, keep2, by2 = _dahl_slopes(middle, -change * (a - b) * b * b, scale)
            slope[BY_START, j] = keep2 * keep1
            slope[BY_FIRST, j] = change * (keep2 * by1 * a * (a - 2.0 * b) + by2 * b * b)
            slope[BY_SECOND, j] = change * (keep2 * by1 * a * a - by2 * b * (2.0 * a - b))
        else:
            _, keep, by = _dahl_slopes(z0[j], 0.5 * (a + b) * dt, scale)
            slope[BY_START, j] = keep
            slope[BY_FIRST, j] = slope[BY_SECOND, j] = 0.5 * dt * by


@inner
def _dahl_slopes(z: float, path: float, scale: float) -> tuple[float, float, float]:
    """`_dahl`, and its derivatives by z and by the path."""
    end = _dahl(z, path, scale)
    return end, math.exp(-abs(path) / scale), 1.0 - end / math.copysign(scale, path)


@inner
def _dahl(z: float, path: float, scale: float) -> float:
    """Dahl state after a monotone path: dz/dq = 1 - sign(dq) z / range."""
    limit = math.copysign(scale, path)
    return limit + (z - limit) * math.exp(-abs(path) / scale)
