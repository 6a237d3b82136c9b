"""Choice of sensors by the information that they add, docs/analysis.md (11) to (13)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np

from soro_core.arrays import Array

# Sets that are compared at most, where the best set is searched for.
MOST_SETS = 5000


@dataclass(frozen=True)
class Information:
    """What each candidate says of each window.

    Attributes
    ----------
    root : ndarray (n_x, r)
        Root of the covariance without any sensor, which has the rank r.
    scaled : ndarray (n_windows, n_candidates, r, r)
        root.T @ W @ root with the Gramian W of each candidate: 1 in units of what is known without sensors.
    tips : ndarray (n_windows, 3, n_x)
        Derivative of the position of the tip [m] by the state, at the start of each window.
    """

    root: Array
    scaled: Array
    tips: Array

    def value(self, chosen: Sequence[int]) -> float:
        """Mean mutual information of state and samples of a set of candidates [nat], 0 of none."""
        return 0.5 * float(np.linalg.slogdet(self._posterior_information(chosen))[1].mean())

    def smallest(self, chosen: Sequence[int]) -> float:
        """Smallest eigenvalue of the scaled Gramian of a set, in the worst window."""
        excess = self._posterior_information(chosen) - np.eye(self.root.shape[1])
        return max(0.0, float(np.linalg.eigvalsh(excess)[:, 0].min()))

    def deviations(self, chosen: Sequence[int]) -> tuple[float, Array]:
        """RMS deviation of tip [m] and entries of the state (n_x,) with these candidates."""
        inverse = np.linalg.inv(self._posterior_information(chosen))
        covariance = self.root @ inverse @ self.root.T
        tip = np.einsum("wax,wxy,way->w", self.tips, covariance, self.tips)
        return float(np.sqrt(tip.mean())), np.sqrt(np.einsum("wxx->wx", covariance).mean(axis=0))

    def _posterior_information(self, chosen: Sequence[int]) -> Array:
        return np.asarray(np.eye(self.root.shape[1]) + self.scaled[:, list(chosen)].sum(axis=1))


def greedy(information: Information, count: int) -> list[int]:
    """Return the numbers of the candidates, each the one that adds most to those before it.

    The value is submodular, so that the sum is at least 1 - 1/e of that of the best set.
    """
    chosen: list[int] = []
    for _ in range(count):
        left = [k for k in range(information.scaled.shape[1]) if k not in chosen]
        values = [information.value([*chosen, k]) for k in left]
        chosen.append(left[int(np.argmax(values))])
    return chosen


def best(information: Information, count: int) -> tuple[int, ...] | None:
    """Return the best set of all; None where there are more than `MOST_SETS`."""
    n = information.scaled.shape[1]
    if comb(n, count) > MOST_SETS:
        return None
    return max(combinations(range(n), count), key=information.value)
