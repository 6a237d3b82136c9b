"""Bringing an arm to rest: the pressures down on a ramp, then a wait until they have gone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from soro_core.hardware.port import Array

EMPTY_PA = 2e3


def ramp_down(
    cycle: Callable[[Array], Array],
    setpoint_pa: Array,
    fall_pa: float,
    shortest_wait: int,
    longest_wait: int,
) -> bool:
    """Run cycles until the pressures are near zero.

    Parameters
    ----------
    cycle : callable
        Sends set points [Pa gauge] (n,) and returns readings, NaN where none came.
    setpoint_pa : ndarray (n,)
        Last set points.
    fall_pa : float
        Largest change of a set point in a cycle.
    shortest_wait, longest_wait : int
        Cycles at 0 Pa that it makes in any case, and after which it gives up.

    Returns
    -------
    bool
        Whether readings have shown that every chamber is empty.
    """
    setpoint = np.array(setpoint_pa, dtype=np.float64)
    while setpoint.any():
        setpoint -= np.clip(setpoint, -fall_pa, fall_pa)
        cycle(setpoint)
    for done in range(longest_wait):
        # A comparison with NaN is false, so a missing reading is no empty chamber.
        is_empty = bool(np.all(np.abs(cycle(setpoint)) < EMPTY_PA))
        if is_empty and done + 1 >= shortest_wait:
            return True
    return False
