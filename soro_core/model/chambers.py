"""Chambers: the generalised force of their pressures, H(q) p (theory.md section 3).

A chamber that runs along link i sees there the fibre strain delta = eps - r_b (kx cos phi + ky sin phi),
and its area is A exp(area_slope delta) [fitted on measured bellows, whose area changes with their
extension]. The force is p times the gradient of the chamber's volume, so it stays conservative at constant
pressure.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core._jit import inner
from soro_core.model.tables import Tables

Array: TypeAlias = NDArray[np.float64]


@inner
def area_factor(t: Tables, i: int, u: int, q: Array) -> float:
    """Area of chamber u along link i over that of the straight link."""
    if t.area_slope[u] == 0.0:
        return 1.0
    work = 0.0
    for c in range(t.offset[i], t.offset[i + 1]):
        work += t.actuation[c, u] * q[c]
    return math.exp(t.area_slope[u] * work / t.axial_gain[i, u])


@inner
def actuation(t: Tables, q: Array, H: Array) -> None:
    """H <- generalised force per pressure (n_q, n_u)."""
    for i in range(t.length.shape[0]):
        for u in range(t.actuation.shape[1]):
            factor = area_factor(t, i, u, q) if t.runs_along[i, u] else 0.0
            for c in range(t.offset[i], t.offset[i + 1]):
                H[c, u] = factor * t.actuation[c, u]


@inner
def volumes(t: Tables, q: Array, volume: Array) -> None:
    """volume <- what each chamber displaces beyond its volume at q = 0 [m^3], (n_u,): dV/dq = H."""
    for u in range(volume.shape[0]):
        volume[u] = 0.0
        for i in range(t.length.shape[0]):
            if t.runs_along[i, u]:
                work = 0.0
                for c in range(t.offset[i], t.offset[i + 1]):
                    work += t.actuation[c, u] * q[c]
                slope, gain = t.area_slope[u], t.axial_gain[i, u]
                volume[u] += gain * math.expm1(slope * work / gain) / slope if slope != 0.0 else work


@inner
def add_pressure_force(t: Tables, q: Array, pressure: Array, force: Array) -> None:
    """force += H(q) p."""
    for i in range(t.length.shape[0]):
        for u in range(pressure.shape[0]):
            if t.runs_along[i, u]:
                scaled = pressure[u] * area_factor(t, i, u, q)
                for c in range(t.offset[i], t.offset[i + 1]):
                    force[c] += scaled * t.actuation[c, u]


@inner
def add_pressure_stiffness(t: Tables, q: Array, pressure: Array, factor: float, K: Array) -> None:
    """K -= factor * d(H(q) p)/dq, the block of each link (n_q, width); nothing for constant areas."""
    for i in range(t.length.shape[0]):
        for u in range(pressure.shape[0]):
            if t.runs_along[i, u] and t.area_slope[u] != 0.0:
                scaled = factor * pressure[u] * area_factor(t, i, u, q) * t.area_slope[u] / t.axial_gain[i, u]
                for c in range(t.offset[i], t.offset[i + 1]):
                    for d in range(t.offset[i], t.offset[i + 1]):
                        K[c, d - t.offset[i]] -= scaled * t.actuation[c, u] * t.actuation[d, u]
