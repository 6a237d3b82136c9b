"""Transition matrix and process noise of the filter over a time."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]


class Transition:
    """The linearised dynamics of one segment.

    Results are stored: a replay asks for the same times again.

    Parameters
    ----------
    system : ndarray (m, m)
        System matrix A of the linearised dynamics.
    process : ndarray (m, m)
        Spectral density Q of the white noise that drives them.
    """

    def __init__(self, system: Array, process: Array) -> None:
        self._system, self._process = system, process
        self._kept: dict[float, tuple[Array, Array]] = {}

    def over(self, dt: float) -> tuple[Array, Array]:
        """Return the transition matrix over `dt` [s] and the covariance of the process noise, (m, m) each."""
        if dt not in self._kept:
            self._kept[dt] = self._compute(dt)
        return self._kept[dt]

    def _compute(self, dt: float) -> tuple[Array, Array]:
        # The Cayley form is the transition of the trapezoidal rule: bounded for modes faster than the step.
        half = np.multiply.outer((0.5 * dt, 0.25 * dt), self._system)
        one = np.eye(len(self._system))
        try:
            whole, middle = np.linalg.solve(one - half, one + half)
        except np.linalg.LinAlgError:
            # An unstable mode of exactly this rate; the caller finds a covariance that is not finite.
            whole = middle = np.full_like(self._system, np.nan)
        # Simpson's rule over the step for the white noise that enters along it.
        noise = (middle @ self._process) @ middle.T * (4.0 * dt / 6.0)
        noise += (whole @ self._process) @ whole.T * (dt / 6.0) + self._process * (dt / 6.0)
        return whole, noise
