"""Candidates of a fit that have no residuals: hopeless, not fatal.

A search tries parameters that no robot file allows (a4 below a5, a stiffness below 0), with which a link
collapses, or with which there is no equilibrium. Such a candidate costs infinitely much, which least squares
understands as a step too far, and no derivative is taken across it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import SoroError
from soro_core.jobs import Executor, Here, map_jobs

Values: TypeAlias = Mapping[str, float]


def residuals_or_none(residuals: Callable[[Values], Array], values: Values) -> Array | None:
    """Residuals (n,) of a candidate, None if it is hopeless.

    Parameters
    ----------
    residuals : callable
        Function of the values by name. It may raise a SoroError (a ConfigError where no robot file allows the
        values, a ModelError where a run fails), or return what is not finite.
    values : mapping
        Value of each parameter.
    """
    try:
        found = np.asarray(residuals(values), dtype=np.float64)
    except SoroError:
        return None
    return found if np.isfinite(found).all() else None


def slopes(
    evaluate: Callable[[Array], Array | None],
    x: Array,
    at_x: Array,
    step: float,
    bounds: tuple[Array, Array],
    executor: Executor | None = None,
    told: Callable[[], None] = lambda: None,
) -> Array:
    """Derivatives (n, n_parameters) of the residuals by differences that avoid hopeless candidates.

    Forward where that is a candidate, else backward; 0 where neither is, so that the search leaves this
    parameter as it is.

    Parameters
    ----------
    evaluate : callable
        Residuals (n,) of parameters, None of hopeless ones.
    x : (n_parameters,)
        Where the derivatives are taken.
    at_x : (n,)
        Residuals there.
    step : float
        Size of the differences, times |x| where that is above 1.
    bounds : two arrays (n_parameters,)
        Lowest and highest parameters.
    executor : Executor, optional
        Computes the parameters beside each other; default `Here`.
    told : callable
        Called after each parameter.
    """

    columns = []
    column = _Column(evaluate, x, at_x, step, bounds)
    with closing(map_jobs(column, range(x.size), executor or Here())) as found:  # Ctrl-C ends it at once
        for one in found:
            columns.append(one)
            told()
    return np.column_stack(columns)


@dataclass(frozen=True)
class _Column:
    """The derivatives by one parameter; the arguments of `slopes`, as a job that can be sent."""

    evaluate: Callable[[Array], Array | None]
    x: Array
    at_x: Array
    step: float
    bounds: tuple[Array, Array]

    def __call__(self, k: int) -> Array:
        for side in (self.step, -self.step):
            beside = self.x.copy()
            beside[k] += side * max(1.0, abs(self.x[k]))
            found = self.evaluate(beside) if self.bounds[0][k] <= beside[k] <= self.bounds[1][k] else None
            if found is not None:
                return np.asarray((found - self.at_x) / (beside[k] - self.x[k]))
        return np.zeros(self.at_x.size)
