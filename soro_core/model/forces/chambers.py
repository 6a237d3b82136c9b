"""Inputs of an arm: the generalised force H(q) p of pressures in chambers, docs/model.md (23) to (26).

Behind the chambers come the tendons (`tendons`): p is then (pressures, tensions), and the volume of a tendon
is how much shorter it is, so that dV/dq = H and p dV is the work of every input.

A chamber that runs along link i has there the fibre strain delta = eps - r_b (kx cos phi + ky sin phi), and
its area is A exp(area_slope delta) [fitted on measured bellows, whose area changes with their extension],
section by section. The force is p times the gradient of the chamber's volume,

    V = int A (exp(area_slope delta) - 1) / area_slope dsigma
    dV/dq = int A exp(area_slope delta) d(delta)/dq dsigma,

so that it stays conservative at constant pressure. With area_saturation = w the growth is the logistic curve
of docs/model.md (54) instead, which ends at 1 / w. A muscle has a negative area, whose growth is that of its
braid, (58) of docs/model_terms.md. Of a pressure within the dead band nothing acts, of others
what is beyond it, (56). The integrals are sums over the nodes of the link. At each
the tables have the gradient of what a constant area would displace there, so that A delta is its product with
q. Where the strain or the area is constant, one sample stands for the whole link.
"""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.forces.tendons import (
    add_shortening,
    add_tendon_force,
    add_tendon_gradients,
    add_tendon_stiffness,
)
from soro_core.model.links.linear import clear_matrix
from soro_core.model.tables import Tables

# Exponent beyond which the logistic curve is at its bound, and its exponential near the largest number.
_FAR = 500.0


@inner
def acting(t: Tables, u: int, pressure: float) -> float:
    """Effective pressure of chamber u: beyond its dead band, on an area that it swells [Pa]."""
    band: float = t.dead_band[u]
    swell: float = t.swell[u]
    beyond = max(pressure - band, 0.0) + min(pressure + band, 0.0)
    room = 1.0 - swell * abs(beyond)  # (57)
    return beyond / room if room > 0.0 else math.copysign(math.inf, beyond)


@inner
def acting_rate(t: Tables, u: int, pressure: float) -> float:
    """Derivative of `acting` by the pressure, 0 within the dead band."""
    band: float = t.dead_band[u]
    swell: float = t.swell[u]
    beyond = abs(pressure) - band
    return 0.0 if beyond < 0.0 else 1.0 / (1.0 - swell * beyond) ** 2


@inner
def _displaced(t: Tables, i: int, u: int, k: int, q: Array) -> float:
    """Volume that a constant area displaces at sample k of chamber u along link i [m^3]."""
    volume = 0.0
    for c in range(t.offset[i], t.offset[i + 1]):
        volume += t.actuation[k, c, u] * q[c]
    return volume


@inner
def _growth(t: Tables, i: int, u: int, k: int, q: Array) -> float:
    """Area there over that without strain."""
    rate: float = t.area_rate[k, i, u]
    w: float = t.area_saturation[i, u]
    b: float = t.braid[i, u]
    if rate == 0.0:
        return 1.0
    exponent = rate * _displaced(t, i, u, k, q)
    if b != 0.0:  # of a muscle the rate makes it the strain
        return (b * (1.0 + exponent) ** 2 - 1.0) / (b - 1.0)
    if w == 0.0:
        return math.exp(exponent)
    return 1.0 / (w + (1.0 - w) * math.exp(-max(exponent / (1.0 - w), -_FAR)))


@inner
def _growth_rate(t: Tables, i: int, u: int, k: int, q: Array) -> float:
    """Derivative of `_growth` by the volume that a constant area displaces there [1/m^3]."""
    rate: float = t.area_rate[k, i, u]
    b: float = t.braid[i, u]
    if b != 0.0:
        return rate * 2.0 * b * (1.0 + rate * _displaced(t, i, u, k, q)) / (b - 1.0)
    w: float = t.area_saturation[i, u]
    growth = _growth(t, i, u, k, q)
    return rate * growth * (1.0 - w * growth) / (1.0 - w)


@inner
def _swept(rate: float, w: float, b: float, plain: float) -> float:
    """Volume displaced where a constant area displaces `plain` [m^3]: the integral of the growth."""
    if rate == 0.0:
        return plain
    if b != 0.0:
        strain = rate * plain
        return plain * (b * (1.0 + strain + strain**2 / 3.0) - 1.0) / (b - 1.0)
    if w == 0.0:
        return math.expm1(rate * plain) / rate
    exponent = rate * plain / (1.0 - w)
    if exponent < _FAR:
        return math.log1p(w * math.expm1(exponent)) * (1.0 - w) / (w * rate)
    return (exponent + math.log(w)) * (1.0 - w) / (w * rate)


@inner
def add_gradient(t: Tables, i: int, u: int, q: Array, factor: float, force: Array) -> None:
    """force += factor * dV/dq of chamber u along link i (n_q,)."""
    for k in range(t.chamber_samples[i, u]):
        scaled = factor * _growth(t, i, u, k, q)
        for c in range(t.offset[i], t.offset[i + 1]):
            force[c] += scaled * t.actuation[k, c, u]


@inner
def actuation(t: Tables, q: Array, gradients: Array) -> None:
    """gradients <- H', generalised force per pressure or tension, a row each input (n_u, n_q)."""
    clear_matrix(gradients)
    for i in range(t.length.shape[0]):
        for u in range(gradients.shape[0]):
            if t.chamber_samples[i, u] > 0:
                add_gradient(t, i, u, q, 1.0, gradients[u])
    add_tendon_gradients(t.tendons, t, q, gradients)


@inner
def volumes(t: Tables, q: Array, volume: Array) -> None:
    """volume <- what each chamber displaces beyond its volume at q = 0 [m^3], (n_u,): dV/dq = H."""
    for u in range(volume.shape[0]):
        volume[u] = 0.0
        for i in range(t.length.shape[0]):
            for k in range(t.chamber_samples[i, u]):
                plain = _displaced(t, i, u, k, q)
                volume[u] += _swept(t.area_rate[k, i, u], t.area_saturation[i, u], t.braid[i, u], plain)
    add_shortening(t.tendons, t, q, volume)


@inner
def add_pressure_force(t: Tables, q: Array, pressure: Array, force: Array) -> None:
    """force += H(q) times the effective pressures of p."""
    for i in range(t.length.shape[0]):
        for u in range(pressure.shape[0]):
            # In a long arm most chambers run along few links, and a call costs more than this test.
            if t.chamber_samples[i, u] > 0:
                add_gradient(t, i, u, q, acting(t, u, pressure[u]), force)
    add_tendon_force(t.tendons, t, q, pressure, force)


@inner
def add_pressure_stiffness(t: Tables, q: Array, pressure: Array, factor: float, K: Array) -> None:
    """K -= factor * d(H(q) p)/dq, the block of each link (n_q, width); nothing for constant areas."""
    for i in range(t.length.shape[0]):
        for u in range(pressure.shape[0]):
            for k in range(t.chamber_samples[i, u]):
                if t.area_rate[k, i, u] == 0.0:
                    continue
                scaled = factor * acting(t, u, pressure[u]) * _growth_rate(t, i, u, k, q)
                for c in range(t.offset[i], t.offset[i + 1]):
                    for d in range(t.offset[i], t.offset[i + 1]):
                        K[c, d - t.offset[i]] -= scaled * t.actuation[k, c, u] * t.actuation[k, d, u]
    add_tendon_stiffness(t.tendons, t, q, pressure, factor, K)
