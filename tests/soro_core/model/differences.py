"""Derivatives by differences, extrapolated to a step of zero: what the exact ones are compared with."""

from collections.abc import Callable

import numpy as np

LEVELS = 6


def extrapolated(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Derivative of f (n,) by x (m,), (n, m): central differences with steps that are halved (Romberg).

    Of each column the value with the smallest change from those that it was made of.
    """
    columns = []
    for k, largest in enumerate(step):
        table: list[list[np.ndarray]] = []
        for level in range(LEVELS):
            h = np.zeros(len(x))
            h[k] = largest / 2**level
            row = [(f(x + h) - f(x - h)) / (2 * h[k])]
            row += [np.empty(0)] * level
            for order in range(1, level + 1):
                row[order] = row[order - 1] + (row[order - 1] - table[-1][order - 1]) / (4**order - 1)
            table.append(row)
        made = [(level, order) for level in range(1, LEVELS) for order in range(1, level + 1)]
        changes = [np.abs(table[i][j] - table[i - 1][j - 1]).max() for i, j in made]
        level, order = made[int(np.argmin(changes))]
        columns.append(table[level][order])
    return np.array(columns).T if columns else np.empty((len(f(x)), 0))


def worst(got: np.ndarray, wanted: np.ndarray) -> float:
    """Largest difference, of the largest entry wanted."""
    assert got.shape == wanted.shape
    return (
        float(np.abs(got - wanted).max() / np.abs(wanted).max()) if wanted.any() else float(np.abs(got).sum())
    )
