"""Creep (Maxwell branches) and hysteresis (Dahl elements): states that the coordinates drag along.

Force on the left-hand side: -K lambda with lambda' = -lambda / tau - qd (creep), +K z with z' = qd - |qd|
z / range (hysteresis). Both dissipate: K z qd = d/dt(K z^2 / 2) + K |qd| z^2 / range.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core._jit import inner
from soro_core.model.tables import AIR, CREEP, Tables

Array: TypeAlias = NDArray[np.float64]


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
    t: Tables, z0: Array, v0: Array, v1: Array, dt: float, z1: Array, tangent: Array
) -> None:
    """z1 <- states after dt with the velocity running linearly from v0 to v1; tangent <- d(force)/d(v1) a
    state.

    Exact for this velocity at any stiffness: creep by its exponential, hysteresis along the path
    travelled, in two pieces where the velocity changes sign.
    """
    for j in range(z0.shape[0]):
        a, b = v0[t.internal_coordinate[j]], v1[t.internal_coordinate[j]]
        scale = t.internal_scale[j]
        if t.internal_kind[j] == AIR:
            tangent[j] = 0.0
        elif t.internal_kind[j] == CREEP:
            x = dt / scale
            decay = math.exp(-x)
            if x > 1e-2:
                first = (1.0 - decay) / x
                second = (x - 1.0 + decay) / (x * x)
            else:
                first = 1.0 - x / 2.0 * (1.0 - x / 3.0 * (1.0 - x / 4.0 * (1.0 - x / 5.0)))
                second = 0.5 * (1.0 - x / 3.0 * (1.0 - x / 4.0 * (1.0 - x / 5.0 * (1.0 - x / 6.0))))
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
def _dahl(z: float, path: float, scale: float) -> float:
    """Dahl state after a monotone path: dz/dq = 1 - sign(dq) z / range."""
    limit = math.copysign(scale, path)
    return limit + (z - limit) * math.exp(-abs(path) / scale)
