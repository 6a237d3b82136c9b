"""The Pareto front of error and cost, and the model that a wish picks from it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

Item = TypeVar("Item")
Measure = Callable[[Item], float]


def pareto(items: Sequence[Item], cost: Measure[Item], error: Measure[Item]) -> list[Item]:
    """Those that no other beats or equals in both, cheapest first."""
    front: list[Item] = []
    least = float("inf")
    for item in sorted(items, key=lambda one: (cost(one), error(one))):
        if error(item) < least:
            front.append(item)
            least = error(item)
    return front


def near_front(items: Sequence[Item], cost: Measure[Item], error: Measure[Item], factor: float) -> list[Item]:
    """Those that none beats by more than `factor` in both, the front's own first."""
    front = pareto(items, cost, error)
    near = [
        item
        for item in items
        if item not in front
        and not any(factor * cost(f) < cost(item) and factor * error(f) < error(item) for f in front)
    ]
    return [*front, *near]
