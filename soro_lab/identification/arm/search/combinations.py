"""Ratios and products of numbers that data determine better than the numbers themselves.

Pressures and poses show what a force does to a stiffness: their ratio. Alone, each of the two is known by
weights and inertia only, and so less well by far. A table of single numbers hides what is known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations as pairs

import numpy as np

from soro_lab.identification.arm.cases.parameters import ArmParameter, is_of_robot
from soro_lab.identification.arm.search.uncertainty import Uncertainty

# Only numbers that are less sure than this have combinations, and only those that are so many times surer.
_UNSURE, _SURER = 0.03, 4.0


@dataclass(frozen=True)
class Combination:
    """A ratio or a product of two numbers.

    Attributes
    ----------
    first, second : str
        Names of the numbers.
    is_product : bool
    value : float
    deviation : float
        Of its natural logarithm.
    """

    first: str
    second: str
    is_product: bool
    value: float
    deviation: float

    @property
    def name(self) -> str:
        """``link0/gain:link0/k_e`` for a ratio, ``link0/gain*link0/arm`` for a product."""
        return f"{self.first}{'*' if self.is_product else ':'}{self.second}"

    def of(self, values: Mapping[str, float]) -> float:
        """Return the combination of other values of the two numbers."""
        first, second = values[self.first], values[self.second]
        return first * second if self.is_product else first / second


def combinations(
    numbers: Sequence[ArmParameter], sure: Uncertainty, values: Mapping[str, float]
) -> tuple[Combination, ...]:
    """Return the combinations that are at least four times surer than each of their numbers.

    Each number is in the surest of its combinations; others follow from those.

    Parameters
    ----------
    numbers : sequence of ArmParameter
        Of the problem, in the order of the correlation.
    sure : Uncertainty
    values : mapping of str to float
    """
    of = np.array([sure.deviations[n.name] for n in numbers])
    unsure = [
        k
        for k, n in enumerate(numbers)
        if is_of_robot(n.name) and n.kind == "factor" and of[k] > _UNSURE and n.name not in sure.at_bound
    ]
    found = []
    for i, j in pairs(unsure, 2):
        shared = float(sure.correlation[i, j])
        square = of[i] ** 2 + of[j] ** 2 - 2.0 * abs(shared) * of[i] * of[j]
        deviation = float(np.sqrt(max(square, 0.0)))
        if _SURER * deviation <= min(of[i], of[j]):
            a, b = (values[numbers[k].name] for k in (i, j))
            value = a * b if shared < 0.0 else a / b
            found.append(Combination(numbers[i].name, numbers[j].name, shared < 0.0, value, deviation))
    found.sort(key=lambda each: each.deviation)
    # The surest that connect all: what follows from two of them says nothing new.
    group = {numbers[k].name: k for k in unsure}
    chosen = []
    for each in found:
        one, other = group[each.first], group[each.second]
        if one != other:
            chosen.append(each)
            group = {name: one if own == other else own for name, own in group.items()}
    return tuple(chosen)
