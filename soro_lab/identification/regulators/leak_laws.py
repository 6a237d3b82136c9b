"""Laws of a leak: the rate at which the pressure of a closed rigid chamber falls, isothermal.

Each is a rate [Pa/s] of a gauge pressure [Pa] that is 0 at 0. Through a hole the flow is that of ISO 6358, in
proportion to the absolute pressure while it is choked. Through pores and long gaps it is viscous, in
proportion to the difference of squares of the absolute pressures; where it is fast, inertia adds a term of
second order [Forchheimer 1901]. Elastomers and diffusion leak in proportion to the gauge pressure.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.pneumatics.chamber import AMBIENT_PA

# Critical pressure ratio of the hole: the default of `ValveModel`.
CRITICAL_RATIO = 0.35
# Relative step of numerical integration; the fall of a step in parts of the pressure.
_STEP = 0.02


@dataclass(frozen=True)
class LeakLaw:
    """A law of a leak.

    Attributes
    ----------
    name : str
        Name in tables and files.
    parameters : tuple of str
        Names of its parameters, the first one in 1/s: the rate at 1 bar over that pressure.
    rate : callable
        Function of gauge pressures (n,) [Pa] and the parameters that returns how fast they fall (n,) [Pa/s].
    """

    name: str
    parameters: tuple[str, ...]
    rate: Callable[[Array, tuple[float, ...]], Array]


def _diffusive(pressure: Array, values: tuple[float, ...]) -> Array:
    return np.asarray(values[0] * pressure)


def _hole(pressure: Array, values: tuple[float, ...]) -> Array:
    return np.asarray(values[0] * AMBIENT_PA * _orifice(pressure) / _orifice(np.array([AMBIENT_PA])))


def _orifice(pressure: Array) -> Array:
    """Return P psi(p_0 / P) of ISO 6358 over p_0, for outflow and inflow."""
    inside = np.maximum(pressure + AMBIENT_PA, 1.0)
    high, low = np.maximum(inside, AMBIENT_PA), np.minimum(inside, AMBIENT_PA)
    part = np.clip((low / high - CRITICAL_RATIO) / (1.0 - CRITICAL_RATIO), 0.0, 1.0)
    return np.asarray(np.sign(pressure) * high / AMBIENT_PA * np.sqrt(1.0 - part * part))


def _squares(pressure: Array) -> Array:
    """Return (P^2 - p_0^2) / (3 p_0^2): 1 at 1 bar."""
    part = pressure / AMBIENT_PA
    return np.asarray(part * (part + 2.0) / 3.0)


def _viscous(pressure: Array, values: tuple[float, ...]) -> Array:
    return np.asarray(values[0] * AMBIENT_PA * _squares(pressure))


def _viscous_and_inertial(pressure: Array, values: tuple[float, ...]) -> Array:
    # The flow q solves q + inertia q |q| = squares, in units of the viscous flow at 1 bar.
    driven, inertia = _squares(pressure), max(values[1], 0.0)
    flow = 2.0 * driven / (1.0 + np.sqrt(1.0 + 4.0 * inertia * np.abs(driven)))
    return np.asarray(values[0] * AMBIENT_PA * flow)


LAWS = (
    LeakLaw("diffusive", ("rate_1_s",), _diffusive),
    LeakLaw("hole", ("rate_1_s",), _hole),
    LeakLaw("viscous", ("rate_1_s",), _viscous),
    LeakLaw("viscous and inertial", ("rate_1_s", "inertia"), _viscous_and_inertial),
)
"""The laws, the simplest first."""


def fall(law: LeakLaw, values: tuple[float, ...], start_pa: float, t: Array) -> Array:
    """Return the gauge pressures (n,) [Pa] of a leak.

    The time to each pressure is the integral of dp / rate(p), on a grid of pressures in equal ratios.

    Parameters
    ----------
    law : LeakLaw
    values : tuple of float
        Its parameters; a negative rate is one that creates air.
    start_pa : float
        Gauge pressure at the first time [Pa], not 0.
    t : ndarray (n,)
        Times [s], rising.
    """
    speed = float(values[0])
    if speed == 0.0:
        return np.full(len(t), start_pa)
    ratios = np.exp(np.arange(0.0, 12.0, _STEP) * (-1.0 if speed > 0.0 else 0.25))
    levels = start_pa * ratios
    slope = levels / law.rate(levels, values)
    # d ln p is the same for all intervals.
    times = np.concatenate([[0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * -np.diff(np.log(ratios)))])
    logs = np.interp(t - t[0], times, np.log(ratios))
    return np.asarray(start_pa * np.exp(logs))
