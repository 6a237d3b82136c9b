"""The method of moving asymptotes for a few constraints (Svanberg 1987), docs/design.md (T10) and (T11)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from soro_core.arrays import Array

NEAREST, FARTHEST = 0.01, 10.0
FIRST, APART, TOGETHER = 0.5, 1.2, 0.7
# Share of the distance to an asymptote that stays closed to a step.
CLOSED = 0.1
# Curvature of its own that each term gets, of the greatest slope.
CURVATURE = 1e-5
ROUNDS = 200
# Of a constraint beyond the first: its greatest price, where no step keeps it, and how exactly it is sought.
DEAREST, EXACT = 1e4, 1e-6


@dataclass(frozen=True, eq=False)
class Moves:
    """What the method remembers.

    Attributes
    ----------
    before, earlier : ndarray, (n,)
        Variables one and two iterations ago; empty before there are any.
    low, high : ndarray, (n,)
        Asymptotes.
    """

    before: Array
    earlier: Array
    low: Array
    high: Array


def no_moves() -> Moves:
    """Return the memory before the first iteration."""
    none = np.empty(0)
    return Moves(none, none, none, none)


def mma_step(
    x: Array,
    slope: Array,
    constraints: Array,
    constraint_slopes: Array,
    bounds: tuple[Array, Array],
    moves: Moves,
) -> tuple[Array, Moves]:
    """Return the next variables of: minimise f(x), all g(x) <= 0, within bounds.

    Parameters
    ----------
    x : ndarray, (n,)
        Variables.
    slope : ndarray, (n,)
        Derivative of f; its size plays no part.
    constraints : ndarray, (m,)
        g(x); the first can always be kept.
    constraint_slopes : ndarray, (m, n)
        Derivatives of g.
    bounds : tuple of ndarray, (n,)
        Least and greatest values, which may move with x.
    moves : Moves
        What the last step returned.
    """
    least, most = bounds
    span = np.maximum(most - least, 1e-9)
    if len(moves.earlier) == 0:
        low, high = x - FIRST * span, x + FIRST * span
    else:
        swing = (x - moves.before) * (moves.before - moves.earlier)
        factor = np.where(swing > 0.0, APART, np.where(swing < 0.0, TOGETHER, 1.0))
        low = np.clip(x - factor * (moves.before - moves.low), x - FARTHEST * span, x - NEAREST * span)
        high = np.clip(x + factor * (moves.high - moves.before), x + NEAREST * span, x + FARTHEST * span)
    from_, to = np.maximum(least, low + CLOSED * (x - low)), np.minimum(most, high - CLOSED * (high - x))
    p0, q0 = _terms(x, slope / max(float(np.abs(slope).max()), 1e-300), low, high, span)
    p, q = np.stack([_terms(x, one, low, high, span) for one in constraint_slopes], axis=1)
    rest = constraints - (p / (high - x) + q / (x - low)).sum(axis=1)

    def best(prices: list[float]) -> Array:
        up, down = (np.sqrt(zero + np.asarray(prices) @ one) for zero, one in ((p0, p), (q0, q)))
        return np.asarray(np.clip((low * up + high * down) / (up + down), from_, to))

    def left(k: int, prices: list[float]) -> float:
        at = best(prices)
        return float(rest[k] + (p[k] / (high - at) + q[k] / (at - low)).sum())

    def priced(later: list[float]) -> list[float]:
        """All prices, with those of the last constraints given: a constraint falls with its price."""
        k = len(rest) - len(later) - 1
        if k < 0:
            return later
        if k == 0:
            exact = 1e-9 if later else 1e-14
            return [_price(lambda price: left(0, [price, *later]), exact), *later]

        def kept(price: float) -> float:
            return left(k, priced([price, *later]))

        if kept(0.0) <= 0.0:
            return priced([0.0, *later])
        dear = 1.0
        while kept(dear) > 0.0:
            if dear >= DEAREST:
                return priced([dear, *later])
            dear *= 10.0
        return priced([brentq(kept, 0.0, dear, xtol=EXACT * dear, rtol=EXACT), *later])

    return best(priced([])), Moves(x, moves.before, low, high)


def _price(left: Callable[[float], float], exact: float) -> float:
    """The least price from 0 at which what is left of a constraint is not above 0."""
    cheap, dear = 0.0, 1.0
    while left(dear) > 0.0 and dear < 1e12:
        cheap, dear = dear, 4.0 * dear
    for _ in range(ROUNDS if left(cheap) > 0.0 else 0):
        middle = 0.5 * (cheap + dear)
        if left(middle) > 0.0:
            cheap = middle
        else:
            dear = middle
        if dear - cheap <= exact * dear:
            break
    return dear if left(cheap) > 0.0 else cheap


def _terms(x: Array, slope: Array, low: Array, high: Array, span: Array) -> tuple[Array, Array]:
    """Weights of 1 / (high - x) and 1 / (x - low) that give the slope at x."""
    extra = 1e-3 * np.abs(slope) + CURVATURE * max(float(np.abs(slope).max()), 1e-300) / span
    return (
        (high - x) ** 2 * (np.maximum(slope, 0.0) + extra),
        (x - low) ** 2 * (np.maximum(-slope, 0.0) + extra),
    )
