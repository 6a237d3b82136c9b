"""Nested dissection (A. George, 1973): an order of nodes that keeps the factors of a stiffness sparse.

A plane across the longest side halves the nodes; those of one half that share an element with the other come
last, and part the rest.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from soro_core.arrays import Array, Integers
from soro_design.fem.elements.pattern import Pattern

# Groups of so few nodes are not divided.
LEAST = 24


def dissected(points: Array, joined: Any) -> Integers:
    """Return nodes (n,) in an order for elimination.

    Parameters
    ----------
    points : ndarray, (n, d)
        Places of the nodes.
    joined : sparse array, (n, n)
        By rows; an entry above 0 for each two nodes of one element.
    """
    order: list[Integers] = []
    is_high = np.zeros(len(points))

    def part(nodes: Integers) -> None:
        if len(nodes) > LEAST:
            place = points[nodes]
            along = place[:, int(np.argmax(np.ptp(place, axis=0)))]
            is_low = along <= np.median(along)
            low, high = nodes[is_low], nodes[~is_low]
            is_high[high] = 1.0
            is_between = joined[low] @ is_high > 0.0
            is_high[high] = 0.0
            if len(high):
                part(low[~is_between])
                part(high)
                nodes = low[is_between]
        order.append(nodes)

    part(np.arange(len(points)))
    return np.concatenate(order)


def rows_dissected(points: Array, pattern: Pattern) -> Integers:
    """Return the rows (n,) of a stiffness in an order for elimination, those of a node together."""
    d = pattern.d
    every = pattern.matrix(np.ones(len(pattern.keys))).tocsr()
    nodes = dissected(points, every[::d, ::d])
    return np.asarray((d * nodes[:, None] + np.arange(d)).ravel())


def order_among(order: Integers, kept: Integers) -> Integers:
    """Return the order (k,) of those rows (n,) that are kept (k,), numbered among these."""
    number = np.full(len(order), -1)
    number[kept] = np.arange(len(kept))
    return np.asarray(number[order][number[order] >= 0])
