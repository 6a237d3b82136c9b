"""The Pareto front of error and cost."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

Item = TypeVar("Item")
Measure = Callable[[Item], float]


def pareto(items: Sequence[Item], cost: Measure[Item], error: Measure[Item]) -> list[Item]:
    """Return the items of the Pareto front, cheapest first.

    Parameters
    ----------
    items : sequence
        Items.
    cost, error : callable
        Functions that return cost and error of an item.

    Returns
    -------
    list
        Items that no other equals or exceeds in both.
    """
    front: list[Item] = []
    least = float("inf")
    for item in sorted(items, key=lambda one: (cost(one), error(one))):
        if error(item) < least:
            front.append(item)
            least = error(item)
    return front


def near_front(items: Sequence[Item], cost: Measure[Item], error: Measure[Item], factor: float) -> list[Item]:
    """Return the Pareto front, then the items near it.

    Parameters
    ----------
    items : sequence
        Items.
    cost, error : callable
        Functions that return cost and error of an item.
    factor : float
        An item is near if no item of the front is better by more than this factor in both.

    Returns
    -------
    list
    """
    front = pareto(items, cost, error)
    near = [
        item
        for item in items
        if item not in front
        and not any(factor * cost(f) < cost(item) and factor * error(f) < error(item) for f in front)
    ]
    return [*front, *near]
