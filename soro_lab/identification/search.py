"""Robust least squares among candidates of which some are hopeless."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np
from scipy.optimize import least_squares

from soro_core.arrays import Array
from soro_core.jobs import Executor, Here
from soro_lab.identification.candidates import slopes


@dataclass
class _Interrupts:
    """What has come. Signals belong to the process, and so does this."""

    is_searching: bool = False
    is_waiting: bool = False
    is_over: bool = False

    def come(self, *_: object) -> None:
        """Interrupt a search, or keep the signal for the next one; a second one interrupts anything."""
        if self.is_searching or self.is_waiting:
            self.is_over = True
            raise KeyboardInterrupt
        self.is_waiting = True


_INTERRUPTS = _Interrupts()


@contextmanager
def only_in_searches() -> Iterator[None]:
    """Let Ctrl-C wait for the next search of this work; outside the main thread nothing changes."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, _INTERRUPTS.come)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        _INTERRUPTS.is_waiting = False


class EndedSearchError(Exception):
    """A search beside others that Ctrl-C has ended."""


def end_if_interrupted(cost: float = 0.0) -> None:
    """Raise `EndedSearchError` after Ctrl-C: the progress of a search in a thread, where no signal comes."""
    if _INTERRUPTS.is_over:
        raise EndedSearchError


@contextmanager
def searching() -> Iterator[None]:
    """Mark a search, or several beside each other; in the main thread alone, where signals come.

    Raises
    ------
    KeyboardInterrupt
        In it; at once if Ctrl-C came before.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waited, _INTERRUPTS.is_waiting = _INTERRUPTS.is_waiting, False
    _INTERRUPTS.is_over = waited
    if waited:
        raise KeyboardInterrupt
    _INTERRUPTS.is_searching = True
    try:
        yield
    finally:
        _INTERRUPTS.is_searching = False


Loss: TypeAlias = Literal["linear", "soft_l1", "huber", "cauchy"]

LOSSES: dict[str, tuple[Callable[[Array], Array], ...]] = {
    "linear": (lambda z: z, np.ones_like, np.zeros_like),
    "soft_l1": (
        lambda z: 2.0 * (np.sqrt(1.0 + z) - 1.0),
        lambda z: 1.0 / np.sqrt(1.0 + z),
        lambda z: -0.5 * (1.0 + z) ** -1.5,
    ),
    "huber": (
        lambda z: np.where(z <= 1.0, z, 2.0 * np.sqrt(z) - 1.0),
        lambda z: 1.0 / np.sqrt(np.maximum(1.0, z)),
        lambda z: np.where(z <= 1.0, 0.0, -0.5 * np.maximum(1.0, z) ** -1.5),
    ),
    "cauchy": (np.log1p, lambda z: 1.0 / (1.0 + z), lambda z: -((1.0 + z) ** -2.0)),
}
"""Loss of scipy.optimize.least_squares: twice the cost of a squared residual, and its two derivatives."""
# Searches that are started anew beside the edge of hopeless candidates, parts of the step that leads there,
# and the least part of the cost by which it must help.
MOST_RESTARTS, PARTS, GAIN = 10, (1.0, 0.5, 0.25, 0.1, 0.02), 1e-6


@dataclass(frozen=True)
class SearchSettings:
    """How a search goes.

    Attributes
    ----------
    loss : str
        A key of `LOSSES`.
    step : float
        Step of the numerical derivatives.
    most : int
        Largest number of steps from each start.
    tolerance : float
        Relative change of the cost, or of the parameters, at which the search ends.
    squares : int
        So many residuals at the end are of a prior: their squares count, whatever the loss.
    scale : float or "jac"
        Unit of a step in each parameter; "jac": that which changes the residuals by as much in all.
    executor : Executor
        Computes derivatives.
    secant : bool
        Take derivatives at the start alone, and correct them by what each step changes (Broyden): for a few
        steps that show what parameters promise.
    """

    loss: Loss = "soft_l1"
    step: float = 1e-4
    most: int = 30
    tolerance: float = 1e-8
    squares: int = 0
    scale: float | Literal["jac"] = "jac"
    executor: Executor = field(default_factory=Here)
    secant: bool = False


@dataclass(frozen=True)
class SearchResult:
    """Where a search ended.

    Attributes
    ----------
    x, residuals, jacobian : (n,), (m,), (m, n)
        Parameters, residuals and their derivatives there; without the weights of the loss.
    cost : float
        Half the sum of the losses.
    converged, interrupted : bool
        Whether the search ended by itself, or by Ctrl-C: then this is the best candidate until there.
    message : str
    """

    x: Array
    residuals: Array
    jacobian: Array
    cost: float
    converged: bool
    interrupted: bool
    message: str


class Search:
    """A search by scipy.optimize.least_squares, started anew where the edge of hopeless candidates stops it.

    Parameters
    ----------
    evaluate : callable
        Residuals (n,) of parameters, None of hopeless ones.
    start, first : (n_parameters,), (n,)
        Parameters at the start, and their residuals.
    bounds : two arrays (n_parameters,)
        Lowest and highest parameters.
    settings : SearchSettings
    progress : callable
        Called with the least cost so far after each evaluation: of a step, and of each derivative.
    beside : callable, optional
        Does what `evaluate` does, for the derivatives at the latest candidate that `evaluate` was given.
    """

    def __init__(
        self,
        evaluate: Callable[[Array], Array | None],
        start: Array,
        first: Array,
        bounds: tuple[Array, Array],
        settings: SearchSettings,
        progress: Callable[[float], None] = lambda cost: None,
        beside: Callable[[Array], Array | None] | None = None,
    ) -> None:
        self._evaluate, self._bounds, self._settings, self._progress = evaluate, bounds, settings, progress
        self._beside = beside or evaluate
        self._latest, self._left = (start, first), False
        self._known: tuple[Array, Array, Array] | None = None  # parameters, residuals, derivatives
        self._best = self.cost(first), start

    def run(self) -> SearchResult:
        """Return the candidate with the least cost."""
        try:
            with searching():
                found = self._from(self._best[1])
                for _ in range(MOST_RESTARTS):
                    # Short steps at the edge lead across it, that of Gauss and Newton maybe inside.
                    inside = self._inward(found.x) if self._left else None
                    if inside is None:
                        break
                    self._left = False
                    found = self._from(inside)
        except KeyboardInterrupt:
            return self._found(self._best[1], False, True, "interrupted")
        ended = bool(found.success and found.status > 0)
        return self._found(np.asarray(found.x), ended, False, str(found.message))

    def here(self) -> SearchResult:
        """Return the start as it is."""
        return self._found(self._best[1], True, False, "not searched")

    def cost(self, residuals: Array) -> float:
        """Return half the sum of the losses."""
        return 0.5 * float(self._losses(residuals**2, 0).sum())

    def _found(self, x: Array, converged: bool, interrupted: bool, message: str) -> SearchResult:
        residuals = self._residuals(x)
        matrix = self._slopes(x, residuals)
        return SearchResult(x, residuals, matrix, self.cost(residuals), converged, interrupted, message)

    def _from(self, x: Array) -> Any:
        s = self._settings
        return least_squares(
            self._residuals,
            x,
            jac=lambda x: self._slopes(x, self._residuals(x)),
            bounds=self._bounds,
            loss=lambda z: np.stack([self._losses(z, order) for order in range(3)]),
            max_nfev=s.most,
            ftol=s.tolerance,
            xtol=s.tolerance,
            x_scale=s.scale,
        )

    def _residuals(self, x: Array) -> Array:
        if not np.array_equal(self._latest[0], x):
            found = self._evaluate(x)
            self._left = self._left or found is None
            residuals = np.full_like(self._latest[1], np.inf) if found is None else found
            self._latest = x.copy(), residuals
            cost = np.inf if found is None else self.cost(found)
            if cost < self._best[0]:
                self._best = cost, x.copy()
            self._tell()
        return self._latest[1]

    def _tell(self) -> None:
        self._progress(self._best[0])

    def _slopes(self, x: Array, residuals: Array) -> Array:
        s, known = self._settings, self._known
        if known is not None and np.array_equal(known[0], x):
            return known[2]
        if known is not None and s.secant:
            matrix = secant(known, x, residuals)
        else:
            matrix = slopes(self._beside, x, residuals, s.step, self._bounds, s.executor, self._tell)
        self._known = x.copy(), residuals, matrix
        return matrix

    def _losses(self, z: Array, order: int) -> Array:
        """Loss of squared residuals, or a derivative of it."""
        own = len(z) - self._settings.squares
        prior = LOSSES["linear"][order](z[own:])
        with np.errstate(invalid="ignore"):  # of a hopeless candidate, all infinite
            return np.concatenate([LOSSES[self._settings.loss][order](z[:own]), prior])

    def _inward(self, x: Array) -> Array | None:
        """Better candidate beside one at the edge, None if there is none."""
        residuals = self._residuals(x)
        # Without the curvature of the loss, which makes the step endless where residuals are large.
        root = np.sqrt(self._losses(residuals**2, 1))
        matrix = root[:, None] * self._slopes(x, residuals)
        whole = -np.linalg.lstsq(matrix, root * residuals, rcond=None)[0]
        for part in PARTS:
            beside: Array = np.clip(x + part * whole, *self._bounds)
            if self.cost(self._residuals(beside)) < (1.0 - GAIN) * self.cost(residuals):
                return beside
        return None


def secant(known: tuple[Array, Array, Array], x: Array, residuals: Array) -> Array:
    """Return derivatives (m, n) at x, by Broyden's correction of those that are known.

    Parameters
    ----------
    known : arrays (n,), (m,), (m, n)
        Other parameters, their residuals and derivatives.
    x, residuals : (n,), (m,)
        Parameters and their residuals.
    """
    before, there, matrix = known
    step = x - before
    return np.asarray(matrix + np.outer(residuals - there - matrix @ step, step / (step @ step)))
