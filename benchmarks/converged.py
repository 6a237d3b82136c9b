"""The tip of a converged run, with its own error, to measure other runs against."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline

from soro_core import SoftArm
from soro_core.arrays import Array

Run = Callable[[int], tuple[Array, Array] | None]
# A run whose halved step moves the tip by less than this, in % of the length, has converged.
CONVERGED = 1e-4
KEPT = 4000  # rows of a run


class Converged:
    """Tip of an arm over time, from runs of halved steps until they agree.

    Parameters
    ----------
    arm : SoftArm
    run : run(steps a second) -> times (n_t,) and coordinates (n_t, n_q), or nothing where it failed
    start : int
        Steps a second to begin with.

    Raises
    ------
    RuntimeError
        If six halvings do not suffice.
    """

    def __init__(self, arm: SoftArm, run: Run, start: int = 4000) -> None:
        self.arm = arm
        self.own_error = math.inf
        before: CubicSpline | None = None
        for doubling in range(7):
            found = run(start * 2**doubling)
            if found is None:
                continue
            every = max(1, len(found[0]) // KEPT)
            t, tip = found[0][::every], self.tips(found[1][::every])
            self._spline = CubicSpline(t, tip)
            if before is not None:
                self.own_error = float(100 * np.abs(tip - before(t)).max() / arm.length)
            if self.own_error < CONVERGED:
                self.steps = start * 2 ** (doubling - 1)  # a second: these were enough
                return
            before = self._spline
        raise RuntimeError(f"no converged run of {arm.robot.name}: {self.own_error:.2g} % left")

    def tips(self, q: Array) -> Array:
        """Position of the tip for each row, (n_t, 3)."""
        return np.array([self.arm.pose(row, self.arm.length)[:3, 3] for row in q])

    def distance(self, run: tuple[Array, Array]) -> Array:
        """Distance of the tip at the run's own times, in % of the length, (n_t,)."""
        difference = self.tips(run[1]) - self._spline(run[0])
        distance: Array = 100 * np.linalg.norm(difference, axis=1) / self.arm.length
        return distance
