"""Robust least squares over named parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from soro_core.errors import ModelError

Array: TypeAlias = NDArray[np.float64]
Values: TypeAlias = Mapping[str, float]

# A residual for a candidate that cannot be simulated: far from any good one, yet finite.
_HOPELESS = 1e3


@dataclass(frozen=True)
class Parameter:
    """One unknown: where the search starts and what it may become.

    Attributes
    ----------
    name : str
    initial : float
        Start, not 0 unless `scale` is given; its size is the unit of the search.
    lower, upper : float
    scale : float, optional
        Unit of the search instead of abs(initial).
    """

    name: str
    initial: float
    lower: float = -np.inf
    upper: float = np.inf
    scale: float | None = None

    @property
    def unit(self) -> float:
        """Size of a typical change."""
        return self.scale if self.scale is not None else abs(self.initial)


@dataclass(frozen=True)
class Fit:
    """Outcome of `fit`.

    Attributes
    ----------
    values : dict
        Fitted value of each parameter.
    deviations : dict
        Standard deviation of each, as if the residuals were independent (samples of one run are not: a lower
        bound); infinite where the data do not determine it.
    cost : float
        Half the sum of the robust losses.
    evaluations : int
        Calls of the residual function, those for derivatives included.
    converged : bool
    message : str
    """

    values: dict[str, float]
    deviations: dict[str, float]
    cost: float
    evaluations: int
    converged: bool
    message: str


def fit(
    parameters: Sequence[Parameter],
    residuals: Callable[[Values], Array],
    loss: Literal["linear", "soft_l1", "huber", "cauchy"] = "soft_l1",
    max_iterations: int = 30,
    relative_step: float = 1e-4,
) -> Fit:
    """Find the values that make the residuals small, without letting outliers rule.

    Parameters
    ----------
    parameters : sequence of Parameter
    residuals : callable
        Values by name -> residuals of shape (n,), each divided by the error expected of it,
        so that the loss turns from squares to absolute values at 1. Values that are not finite, or a
        ModelError, mark a candidate that cannot be simulated.
    loss : str
        As in scipy.optimize.least_squares; soft_l1 keeps one outlier from spoiling a fit.
    max_iterations : int
    relative_step : float
        Step of the numerical derivatives, in units of the parameters: above the round-off of a simulation.

    Raises
    ------
    ValueError
        If two parameters share a name, a start lies outside its bounds or a unit is 0.
    ModelError
        If the start itself cannot be simulated.
    """
    names = [p.name for p in parameters]
    if len(set(names)) != len(names) or not names:
        raise ValueError(f"parameters {names}: allowed are one or more different names")
    for p in parameters:
        if not (p.lower <= p.initial <= p.upper and p.unit > 0):
            raise ValueError(f"parameter {p}: allowed is a start within its bounds, with a scale if it is 0")
    unit = np.array([p.unit for p in parameters])
    calls = 0

    def values_of(x: Array) -> dict[str, float]:
        return dict(zip(names, (float(v) for v in x * unit), strict=True))

    def evaluate(x: Array) -> Array:
        nonlocal calls
        calls += 1
        try:
            result = np.asarray(residuals(values_of(x)), float)
        except ModelError:
            return np.full(shape, _HOPELESS)
        return np.where(np.isfinite(result), result, _HOPELESS)

    start = np.array([p.initial for p in parameters]) / unit
    first = np.asarray(residuals(values_of(start)), float)
    if not np.isfinite(first).all():
        raise ModelError("the starting values of the fit cannot be simulated (residuals that are not finite)")
    shape = first.shape
    bounds = np.array([p.lower for p in parameters]) / unit, np.array([p.upper for p in parameters]) / unit
    found: Any = least_squares(
        evaluate,
        start,
        bounds=bounds,
        loss=loss,
        max_nfev=max_iterations,
        diff_step=relative_step,
        x_scale="jac",
    )
    deviations = _deviations(found, unit)
    return Fit(
        values_of(found.x),
        dict(zip(names, deviations, strict=True)),
        float(found.cost),
        calls + 1,
        bool(found.success and found.status > 0),
        str(found.message),
    )


def _deviations(found: Any, unit: Array) -> list[float]:
    """From the Gauss-Newton Hessian of the (robustly weighted) cost."""
    jac = np.asarray(found.jac)
    freedom = max(1, len(found.fun) - jac.shape[1])
    hessian = jac.T @ jac
    if np.linalg.matrix_rank(jac) < jac.shape[1]:
        diagonal = np.full(jac.shape[1], np.inf)
    else:
        diagonal = np.diag(np.linalg.inv(hessian)) * 2 * found.cost / freedom
    return [float(v) for v in np.sqrt(diagonal) * unit]
