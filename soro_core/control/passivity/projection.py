"""Projection of parameter estimates onto the admissible polytope.

The set is a box with half planes a - b >= margin on disjoint pairs (a1 and a2, a4 and a5 of one link). The
projection is the nearest point in the metric of the inverse adaptation gains, in which the Lyapunov function
measures the estimation error. It moves no estimate away from an admissible point, so it never increases the
Lyapunov function.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array


@dataclass(frozen=True)
class Pair:
    """Constraint value[high] - value[low] >= margin; an index of -1 stands for a constant."""

    high: int
    low: int
    margin: float
    high_value: float = 0.0
    low_value: float = 0.0


@dataclass(frozen=True)
class Polytope:
    """Box and pairs; `gain` is the diagonal of Gamma, and its inverse the metric; arrays (m,)."""

    lower: Array
    upper: Array
    gain: Array
    pairs: tuple[Pair, ...] = ()

    def contains(self, value: Array, tolerance: float = 1e-12) -> bool:
        """Whether `value` is admissible, within a tolerance relative to the size of the bounds."""
        slack = tolerance * (1.0 + np.abs(value))
        if np.any(value < self.lower - slack) or np.any(value > self.upper + slack):
            return False
        for pair in self.pairs:
            high, low = self._ends(pair, value)
            if high - low < pair.margin - tolerance * (1.0 + abs(high) + abs(low)):
                return False
        return True

    def project(self, value: Array) -> Array:
        """Return the nearest admissible point to `value` (m,); exact, in closed form."""
        result = np.minimum(np.maximum(value, self.lower), self.upper)
        for pair in self.pairs:
            high, low = self._ends(pair, result)
            if high - low >= pair.margin:
                continue
            # If the nearest point of the box violates the half plane, the answer lies on the edge
            # high = low + margin: one variable, a weighted mean of the two values, clipped to the box.
            i, j = pair.high, pair.low
            if i < 0:
                result[j] = max(self.lower[j], min(value[j], pair.high_value - pair.margin))
            elif j < 0:
                result[i] = min(self.upper[i], max(value[i], pair.low_value + pair.margin))
            else:
                gi, gj = self.gain[i], self.gain[j]
                share = gj / (gi + gj) if gi + gj > 0.0 else 0.5
                edge = share * (value[i] - pair.margin) + (1.0 - share) * value[j]
                least = max(self.lower[j], self.lower[i] - pair.margin)
                most = min(self.upper[j], self.upper[i] - pair.margin)
                result[j] = min(max(edge, least), most)
                result[i] = result[j] + pair.margin
        return result

    def _ends(self, pair: Pair, value: Array) -> tuple[float, float]:
        high = float(value[pair.high]) if pair.high >= 0 else pair.high_value
        low = float(value[pair.low]) if pair.low >= 0 else pair.low_value
        return high, low
