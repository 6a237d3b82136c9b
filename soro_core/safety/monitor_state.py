"""Memory of the monitors for every chamber, and the sample of one exchange."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from soro_core.arrays import Array, Flags, Integers
from soro_core.pneumatics.regulator import RegulatorState

NEVER = -1


class MonitorState(NamedTuple):
    """What the monitors remember; arrays have one entry a chamber, times are nanoseconds, `NEVER` for none.

    Attributes
    ----------
    names : tuple of str
        Names of the chambers, for causes; empty for their numbers.
    expected : RegulatorState
        Prediction, and the set points on their way to it.
    setpoint_pa : ndarray (n,)
        Set points in force since the last exchange, which sent them.
    reading_pa, residual_pa, seen
        Last fresh readings, how far they were from the prediction, and whether there has been one.
    deviates_ns
        Since when a reading has been too far from the prediction.
    moved_pa, asked_pa, unmoved_ns
        Reading and set point when the reading last moved; since when the set point has been far from that.
    same_ns, lowest_pa, highest_pa
        Since when all readings have been equal, and the range of the prediction meanwhile.
    still_ns, mean_pa, drift_pa, drift_ns, drifts
        Since when the set point is constant; filtered reading; what that was when the present window began,
        and when; windows in a row that drifted up (+) or down (-).
    supply_ns
        Since when the supply has been too low or too high.
    now_ns
        Time of the last exchange.
    """

    names: tuple[str, ...]
    expected: RegulatorState
    setpoint_pa: Array
    reading_pa: Array
    residual_pa: Array
    seen: Flags
    deviates_ns: Integers
    moved_pa: Array
    asked_pa: Array
    unmoved_ns: Integers
    same_ns: Integers
    lowest_pa: Array
    highest_pa: Array
    still_ns: Integers
    mean_pa: Array
    drift_pa: Array
    drift_ns: Integers
    drifts: Array
    supply_ns: Integers
    now_ns: int


class MonitorSample(NamedTuple):
    """One exchange: set points sent, readings, whose are fresh, whose are the first.

    `model_pa` is the prediction, and `off_pa` what the readings differ from it.
    """

    setpoint_pa: Array
    reading_pa: Array
    fresh: Flags
    first: Flags
    model_pa: Array
    off_pa: Array
    supply_pa: Array | None
    dt: float
    now_ns: int


def initial_monitors(n: int, names: Sequence[str] = ()) -> MonitorState:
    """Return the state of `n` chambers of which nothing has been read."""
    zero, never = np.zeros(n), np.full(n, NEVER, dtype=np.int64)
    return MonitorState(
        names=tuple(names),
        expected=RegulatorState(pressure_pa=zero, target_pa=zero),
        setpoint_pa=zero,
        reading_pa=zero,
        residual_pa=zero,
        seen=np.zeros(n, dtype=np.bool_),
        deviates_ns=never,
        moved_pa=zero,
        asked_pa=zero,
        unmoved_ns=never,
        same_ns=never,
        lowest_pa=zero,
        highest_pa=zero,
        still_ns=never,
        mean_pa=zero,
        drift_pa=zero,
        drift_ns=never,
        drifts=zero,
        supply_ns=never,
        now_ns=NEVER,
    )


def chamber(names: Sequence[str], number: int) -> str:
    """How a cause calls a chamber."""
    return names[number] if names else f"chamber {number}"
