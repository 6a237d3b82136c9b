"""Bumpless transfer: after a switch of laws the desired force starts at its last value."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from soro_core.arrays import Array
from soro_core.frozen import quick

# Time constant with which the difference of the two laws ends [s].
FADE_S = 0.3


@quick
@dataclass(frozen=True)
class BumplessTransfer:
    """From one law to the next.

    Attributes
    ----------
    asked : ndarray (n_q,) or None
        Force that was asked for at the last tick; None before the first one.
    difference : ndarray (n_q,) or None
        What is still added to the force of the law; None for nothing.
    begins : bool
        Whether the law has changed since the last tick.
    """

    asked: Array | None = None
    difference: Array | None = None
    begins: bool = False

    def start(self) -> BumplessTransfer:
        """Return the transfer to another law, from the force of the last tick."""
        return replace(self, begins=self.asked is not None)


def apply_transfer(before: BumplessTransfer, desired: Array, dt: float) -> tuple[BumplessTransfer, Array]:
    """Return the transfer after a tick, and the force (n_q,) to ask for.

    Parameters
    ----------
    before : BumplessTransfer
        After the last tick.
    desired : ndarray (n_q,)
        Force of the law.
    dt : float
        Time since the last tick [s].
    """
    difference = before.difference
    if before.begins and before.asked is not None:
        difference = before.asked - desired
    if difference is None:
        return BumplessTransfer(desired), desired
    difference = math.exp(-dt / FADE_S) * difference
    # Below 1e-3 of the force it is no step.
    kept = difference if np.linalg.norm(difference) > 1e-3 * np.linalg.norm(desired) else None
    asked = np.asarray(desired + difference)
    return BumplessTransfer(asked, kept), asked
