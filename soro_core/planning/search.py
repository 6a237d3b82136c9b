"""Search for a way between shapes by two trees that grow towards each other.

RRT-Connect, Kuffner and LaValle 2000.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from soro_core.arrays import Array
from soro_core.planning.shapes import HeldLine, HeldShapes
from soro_core.planning.steps import Planning

# Part of the samples that are a shape of the other tree.
_TOWARDS = 0.1
# Parts of the samples at the least and the highest pressure of a chamber, over the others: there the arm is
# shortest, or bent most.
_LEAST, _HIGHEST = 0.5, 0.15
# Tries to shorten a way, and part of its length that one must save.
_SHORTER, _SAVED = 80, 1e-3


class Way(NamedTuple):
    """Shapes with clear lines between them: pressures (n, n_u) and coordinates (n, n_q)."""

    x: Array
    q: Array


class Tree:
    """Shapes, each joined to an earlier one by a clear line.

    Attributes
    ----------
    n : int
    """

    def __init__(self, shapes: HeldShapes) -> None:
        self._shapes = shapes
        self._x, self._q = np.empty((64, shapes.arm.n_u)), np.empty((64, shapes.arm.n_q))
        self._before: list[int] = []

    @property
    def n(self) -> int:
        """Number of shapes."""
        return len(self._before)

    def add(self, x: Array, q: Array, before: int) -> int:
        """Add a shape behind another (-1: a root); gives its number."""
        if self.n == len(self._x):
            self._x, self._q = (np.concatenate([rows, np.empty_like(rows)]) for rows in (self._x, self._q))
        self._x[self.n], self._q[self.n] = x, q
        self._before.append(before)
        return self.n - 1

    def x(self, k: int) -> Array:
        """Pressures of a shape."""
        return np.array(self._x[k])

    def grow(self, target: Array, margin_m: float) -> tuple[int, bool]:
        """Go from the nearest shape towards pressures while it is clear; gives where it ends."""
        k = int(np.argmin(self._shapes.apart(self._x[: self.n], target)))
        found: HeldLine = self._shapes.line(self._x[k], target, self._q[k], margin_m)
        for x, q in zip(found.x[1:], found.q[1:], strict=True):
            k = self.add(x, q, k)
        return k, found.whole

    def back(self, k: int) -> Way:
        """Return the shapes from the root to one."""
        numbers = []
        while k >= 0:
            numbers.append(k)
            k = self._before[k]
        return Way(self._x[numbers[::-1]], self._q[numbers[::-1]])


class WaySearch:
    """Search for a way from one shape to one of several.

    Parameters
    ----------
    shapes : HeldShapes
    start : HeldLine
        Its last shape is where the way begins.
    margin_m : float
        Least clearance on the way [m].
    seed : int
    """

    def __init__(self, shapes: HeldShapes, start: HeldLine, margin_m: float, seed: int) -> None:
        self.shapes, self.margin_m = shapes, margin_m
        self.random = np.random.default_rng(seed)
        self.start, self.goal = Tree(shapes), Tree(shapes)
        self.start.add(start.x[-1], start.q[-1], -1)

    def sample(self) -> Array:
        """Return pressures anywhere in their range."""
        x = self.random.uniform(-_LEAST, 1.0 + _HIGHEST, self.shapes.arm.n_u)
        return np.asarray(np.clip(x, 0.0, 1.0))

    def reach(self, goal: HeldLine) -> Way | None:
        """Add a goal, the last shape of a line; gives the way there if it is a straight line."""
        k = self.goal.add(goal.x[-1], goal.q[-1], -1)
        last, there = self.start.grow(self.goal.x(k), self.margin_m)
        return self.start.back(last) if there else None

    def grow(self) -> Planning[Way | None]:
        """Grow both trees once; gives the way when they meet."""
        for one, other in ((self.start, self.goal), (self.goal, self.start)):
            towards = self.random.random() < _TOWARDS
            target = other.x(int(self.random.integers(other.n))) if towards else self.sample()
            k, _ = one.grow(target, self.margin_m)
            yield
            j, met = other.grow(one.x(k), self.margin_m)
            yield
            if met:
                first, second = one.back(k), other.back(j)
                way = Way(*(np.concatenate((a, b[-2::-1])) for a, b in zip(first, second, strict=True)))
                return way if one is self.start else Way(way.x[::-1], way.q[::-1])
        return None

    def shorten(self, way: Way) -> Planning[Way]:
        """Replace parts of a way by clear straight lines."""
        shapes = self.shapes
        for _ in range(_SHORTER):
            if len(way.x) < 3:
                break
            length = np.concatenate(([0.0], np.cumsum(shapes.apart(way.x[1:], way.x[:-1]))))
            a, b = np.sort(self.random.uniform(0.0, length[-1], 2))
            i, j = np.searchsorted(length, (a, b), side="right") - 1
            first, last = (
                way.x[k] + (way.x[k + 1] - way.x[k]) * ((at - length[k]) / (length[k + 1] - length[k]))
                for k, at in ((i, a), (j, b))
            )
            if i == j or b - a - float(shapes.apart(first, last)) <= _SAVED * length[-1]:
                continue
            to_first = shapes.line(way.x[i], first, way.q[i], -math.inf)
            found = shapes.line(first, last, to_first.q[-1], self.margin_m)
            yield
            if to_first.whole and found.whole:
                ends = Way(found.x[[0, -1]], found.q[[0, -1]])
                way = Way(
                    *(
                        np.concatenate((rows[: i + 1], new, rows[j + 1 :]))
                        for rows, new in zip(way, ends, strict=True)
                    )
                )
        return way
