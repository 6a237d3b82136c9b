"""The method of moving asymptotes for one constraint (Svanberg 1987), docs/design.md (T10) and (T11)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array

NEAREST, FARTHEST = 0.01, 10.0
FIRST, APART, TOGETHER = 0.5, 1.2, 0.7
# Share of the distance to an asymptote that stays closed to a step.
CLOSED = 0.1
# Curvature of its own that each term gets, of the greatest slope.
CURVATURE = 1e-5
ROUNDS = 200


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
    constraint: float,
    constraint_slope: Array,
    bounds: tuple[Array, Array],
    moves: Moves,
) -> tuple[Array, Moves]:
    """Return the next variables of: minimise f(x), g(x) <= 0, within bounds.

    Parameters
    ----------
    x : ndarray, (n,)
        Variables.
    slope : ndarray, (n,)
        Derivative of f; its size plays no part.
    constraint : float
        g(x).
    constraint_slope : ndarray, (n,)
        Derivative of g.
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
    p1, q1 = _terms(x, constraint_slope, low, high, span)
    rest = constraint - float((p1 / (high - x) + q1 / (x - low)).sum())

    def best(price: float) -> Array:
        up, down = np.sqrt(p0 + price * p1), np.sqrt(q0 + price * q1)
        return np.asarray(np.clip((low * up + high * down) / (up + down), from_, to))

    def left(price: float) -> float:
        at = best(price)
        return rest + float((p1 / (high - at) + q1 / (at - low)).sum())

    # The constraint falls with its price: the multiplier is where it is just kept.
    cheap, dear = 0.0, 1.0
    while left(dear) > 0.0 and dear < 1e12:
        cheap, dear = dear, 4.0 * dear
    for _ in range(ROUNDS if left(cheap) > 0.0 else 0):
        middle = 0.5 * (cheap + dear)
        if left(middle) > 0.0:
            cheap = middle
        else:
            dear = middle
        if dear - cheap <= 1e-14 * dear:
            break
    price = dear if left(cheap) > 0.0 else cheap
    return best(price), Moves(x, moves.before, low, high)


def _terms(x: Array, slope: Array, low: Array, high: Array, span: Array) -> tuple[Array, Array]:
    """Weights of 1 / (high - x) and 1 / (x - low) that give the slope at x."""
    extra = 1e-3 * np.abs(slope) + CURVATURE * max(float(np.abs(slope).max()), 1e-300) / span
    return (
        (high - x) ** 2 * (np.maximum(slope, 0.0) + extra),
        (x - low) ** 2 * (np.maximum(-slope, 0.0) + extra),
    )
