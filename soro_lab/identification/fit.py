"""Robust least squares over named parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_lab.identification.candidates import Values, residuals_or_none
from soro_lab.identification.search import LOSSES, Loss, Search, SearchResult, SearchSettings

# Step of the numerical derivatives, in units of the parameters or, if more, of their values; it must exceed
# the round-off of a simulation.
_RELATIVE_STEP = 1e-4
# Part of a parameter that the data may leave open, of 1, before it counts as unknown.
_UNKNOWN_PART = 1e-9


@dataclass(frozen=True)
class Parameter:
    """One unknown parameter.

    Attributes
    ----------
    name : str
        Key in `Fit.values`.
    initial : float
        Start of the search; its absolute value is the unit of the search, so 0 requires `scale`.
    lower, upper : float
        Bounds.
    scale : float, optional
        Unit of the search, instead of abs(initial).
    """

    name: str
    initial: float
    lower: float = -np.inf
    upper: float = np.inf
    scale: float | None = None

    @property
    def unit(self) -> float:
        """Unit of the search."""
        return self.scale if self.scale is not None else abs(self.initial)


@dataclass(frozen=True)
class Fit:
    """Outcome of `fit`.

    Attributes
    ----------
    values : dict
        Fitted value of each parameter.
    deviations : dict
        Standard deviation of each parameter for independent residuals (a lower bound, since samples of one
        run are correlated); infinite if the data do not determine the parameter.
    cost : float
        Half the sum of the robust losses.
    converged : bool
        Whether the search ended before `max_iterations`.
    message : str
        Reason why the search ended, and which parameters the data do not determine.
    """

    values: dict[str, float]
    deviations: dict[str, float]
    cost: float
    converged: bool
    message: str


def fit(
    parameters: Sequence[Parameter],
    residuals: Callable[[Values], Array],
    loss: Loss = "soft_l1",
    max_iterations: int = 30,
) -> Fit:
    """Minimise a robust sum of the residuals.

    Parameters
    ----------
    parameters : sequence of Parameter
        Unknowns.
    residuals : callable
        Function of the values by name that returns residuals (n,), each divided by its expected error: the
        loss changes from squares to absolute values at 1. Values that are not finite, or a SoroError, mark a
        hopeless candidate (`soro_lab.identification.candidates`).
    loss : str
        Loss of scipy.optimize.least_squares; soft_l1 limits the effect of outliers.
    max_iterations : int
        Largest number of iterations of a search. One that hopeless candidates have stopped is started anew
        beside them (`soro_lab.identification.search`).

    Raises
    ------
    ValueError
        If two parameters share a name, a start lies outside its bounds or a unit is 0.
    ModelError
        If the start cannot be simulated.
    SoroError
        Whatever the residuals raise at the start.
    """
    names = [p.name for p in parameters]
    if len(set(names)) != len(names) or not names:
        raise ValueError(f"parameters {names}: allowed are one or more different names")
    for p in parameters:
        if not (p.lower <= p.initial <= p.upper and p.unit > 0):
            raise ValueError(f"parameter {p}: allowed is a start within its bounds, with a scale if it is 0")
    unit = np.array([p.unit for p in parameters])

    def values_of(x: Array) -> dict[str, float]:
        return dict(zip(names, (float(v) for v in x * unit), strict=True))

    start = np.array([p.initial for p in parameters]) / unit
    first = np.asarray(residuals(values_of(start)), float)
    if not np.isfinite(first).all():
        text = "the starting values of the fit cannot be simulated (residuals that are not finite)"
        raise ModelError(text, "start")
    bounds = np.array([p.lower for p in parameters]) / unit, np.array([p.upper for p in parameters]) / unit

    settings = SearchSettings(loss, _RELATIVE_STEP, max_iterations)
    found = Search(lambda x: residuals_or_none(residuals, values_of(x)), start, first, bounds, settings).run()
    deviations = _deviations(found, loss, unit)
    return Fit(
        values_of(found.x),
        dict(zip(names, deviations, strict=True)),
        float(found.cost),
        found.converged,
        "; ".join(filter(None, (found.message, _unknown(names, deviations, found.jacobian)))),
    )


def _unknown(names: Sequence[str], deviations: Sequence[float], jacobian: Array) -> str:
    """Return which parameters the data do not determine, and why; empty for none."""
    effect = np.abs(jacobian).max(axis=0, initial=0.0)
    unknown = [(name, e) for name, d, e in zip(names, deviations, effect, strict=True) if np.isinf(d)]
    without = [name for name, e in unknown if e <= _UNKNOWN_PART * effect.max()]
    alike = [name for name, _ in unknown if name not in without]
    return "; ".join(
        f"{text}: {', '.join(which)}"
        for text, which in (("no effect on the data", without), ("with the same effect on the data", alike))
        if which
    )


def _deviations(found: SearchResult, loss: Loss, unit: Array) -> list[float]:
    """Return standard deviations from the Gauss-Newton Hessian of the (robustly weighted) cost."""
    z, (_, first, second) = found.residuals**2, LOSSES[loss]
    weight = np.maximum(first(z) + 2.0 * z * second(z), np.finfo(float).eps)
    jac = np.sqrt(weight)[:, None] * found.jacobian
    freedom = max(1, jac.shape[0] - jac.shape[1])
    _, singular, rows = np.linalg.svd(jac, full_matrices=False)
    known = singular > singular[0] * max(jac.shape) * np.finfo(float).eps
    diagonal = ((rows[known] / singular[known, None]) ** 2).sum(axis=0) * 2 * found.cost / freedom
    # What the data do not determine: other parameters keep theirs.
    diagonal[(rows[~known] ** 2).sum(axis=0) > _UNKNOWN_PART] = np.inf
    return [float(v) for v in np.sqrt(diagonal) * unit]
