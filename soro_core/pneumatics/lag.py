"""Exact solution of the first-order lag tau p' = c - p, for regulators, their predictions and filters."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Value = TypeVar("Value", float, NDArray[np.float64])

# Used in place of a time constant of 0 [s]: the gap is 0 after any positive time.
SHORTEST_S = 1e-200


def follow(value: Value, target: Value | float, time_s: Value | float, tau_s: Value | float) -> Value:
    """Return the value of a lag after a time with its target held.

    Parameters
    ----------
    value, target : float or ndarray
        Value at the start, and target, in the same unit.
    time_s : float or ndarray
        Time [s], >= 0.
    tau_s : float or ndarray
        Time constant [s], >= 0; 0 for no lag.

    Returns
    -------
    float or ndarray
        Value after the time.
    """
    if isinstance(time_s, float) and isinstance(tau_s, float):
        left: float | NDArray[np.float64] = math.exp(-time_s / max(tau_s, SHORTEST_S))
    else:
        left = np.exp(-time_s / np.maximum(tau_s, SHORTEST_S))
    return target + (value - target) * left  # type: ignore[return-value]
