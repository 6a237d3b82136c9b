"""Robust least squares among candidates of which some are hopeless."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from soro_core.identification.candidates import slopes

Array: TypeAlias = NDArray[np.float64]
Loss: TypeAlias = Literal["linear", "soft_l1", "huber", "cauchy"]

LOSSES: dict[str, tuple[Callable[[Array], Array], Callable[[Array], Array]]] = {
    "linear": (lambda z: z, np.ones_like),
    "soft_l1": (lambda z: 2.0 * (np.sqrt(1.0 + z) - 1.0), lambda z: 1.0 / np.sqrt(1.0 + z)),
    "huber": (
        lambda z: np.where(z <= 1.0, z, 2.0 * np.sqrt(z) - 1.0),
        lambda z: 1.0 / np.sqrt(np.maximum(1.0, z)),
    ),
    "cauchy": (np.log1p, lambda z: 1.0 / (1.0 + z)),
}
"""Loss of scipy.optimize.least_squares: twice the cost of a squared residual, and its derivative."""
# Searches that are begun anew beside the edge of hopeless candidates, parts of the step that leads there, and
# the least part of the cost by which it must help.
MOST_RESTARTS, PARTS, GAIN = 10, (1.0, 0.5, 0.25, 0.1, 0.02), 1e-6


class Search:
    """A search by scipy.optimize.least_squares, begun anew where the edge of hopeless candidates stops it.

    Parameters
    ----------
    evaluate : callable
        Residuals (n,) of parameters, None of hopeless ones.
    start, first : (n_parameters,), (n,)
        Parameters at the start, and their residuals.
    bounds : two arrays (n_parameters,)
        Lowest and highest parameters.
    loss : str
        A key of `LOSSES`.
    step : float
        Step of the numerical derivatives.
    """

    def __init__(
        self,
        evaluate: Callable[[Array], Array | None],
        start: Array,
        first: Array,
        bounds: tuple[Array, Array],
        loss: Loss,
        step: float,
    ) -> None:
        self._evaluate, self._bounds, self._loss, self._step = evaluate, bounds, loss, step
        self._start, self._latest, self._left = start, (start, first), False

    def run(self, max_iterations: int) -> Any:
        """Return the result of least_squares with the least cost."""
        found = self._from(self._start, max_iterations)
        for _ in range(MOST_RESTARTS):
            # Short steps of a search at the edge lead across it, the step of Gauss and Newton maybe inside.
            inside = self._inward(found) if self._left else None
            if inside is None:
                break
            self._left = False
            found = self._from(inside, max_iterations)
        return found

    def _from(self, x: Array, most: int) -> Any:
        return least_squares(
            self._residuals,
            x,
            jac=self._slopes,
            bounds=self._bounds,
            loss=self._loss,
            max_nfev=most,
            x_scale="jac",
        )

    def _residuals(self, x: Array) -> Array:
        if not np.array_equal(self._latest[0], x):
            found = self._evaluate(x)
            self._left = self._left or found is None
            self._latest = x.copy(), np.full_like(self._latest[1], np.inf) if found is None else found
        return self._latest[1]

    def _slopes(self, x: Array) -> Array:
        return slopes(self._evaluate, x, self._residuals(x), self._step, self._bounds)

    def _inward(self, at: Any) -> Array | None:
        """Better candidate beside one at the edge, None if there is none."""
        rho, slope_of_rho = LOSSES[self._loss]
        # Without the curvature of the loss, which makes the step endless where residuals are large.
        root = np.sqrt(slope_of_rho(at.fun**2))
        matrix = root[:, None] * slopes(self._evaluate, at.x, at.fun, self._step, self._bounds)
        whole = -np.linalg.lstsq(matrix, root * at.fun, rcond=None)[0]
        for part in PARTS:
            x: Array = np.clip(at.x + part * whole, *self._bounds)
            if 0.5 * rho(self._residuals(x) ** 2).sum() < (1.0 - GAIN) * at.cost:
                return x
        return None
