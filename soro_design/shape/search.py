"""A search of few parameters where each design costs much: a surrogate in a box around the best design.

The surrogate interpolates by cubic radial functions; the box shrinks where it does not lead on. After
R. G. Regis and C. A. Shoemaker, Constrained global optimization of expensive black box functions using radial
basis functions, J. Global Optim. 31 (2005) 153, and their stochastic choice of points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.optimize import Bounds, NonlinearConstraint, minimize
from scipy.stats import qmc

from soro_core.arrays import Array

# Designs of a round: it does not depend on the number of processes, so that results do not.
BATCH = 4
FIRST_BOX, LEAST_BOX, MOST_BOX = 0.4, 0.004, 0.6
CANDIDATES = 400
# Share of the best value below which a round has led nowhere.
LEADS = 1e-3
# Designs nearer than this share of the box to one that is known say nothing new.
APART = 0.03
# How much the second, third and fourth of a round look for what is not known, over what is promising.
CURIOUS = (0.1, 0.4, 0.7)


@dataclass
class SurrogateSearch:
    """Designs that are known, and those to try next; each is a point of the unit cube.

    Attributes
    ----------
    start : ndarray, (k,)
        The first design.
    snap : callable
        The design nearest to a point: whole numbers stay whole.
    is_allowed : callable
        Whether a design can be made, before it is computed.
    seed : int
    points : list of ndarray, (k,)
        Designs that are known.
    values, excess : list of float
        Of each: its value (less is better; NaN: it failed), and how far it is beyond its limit, 0 at it.
    box : float
        Half the width of the box around the best design.
    """

    start: Array
    snap: Callable[[Array], Array]
    is_allowed: Callable[[Array], bool]
    seed: int = 0
    points: list[Array] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    excess: list[float] = field(default_factory=list)
    box: float = FIRST_BOX

    def __post_init__(self) -> None:
        self._random = np.random.default_rng(self.seed)
        self._last = np.inf

    def first(self) -> list[Array]:
        """Return the first designs: the start, and 3 k + 1 that fill the cube evenly."""
        k = len(self.start)
        fill = qmc.LatinHypercube(k, rng=self._random)
        found = [self.snap(self.start)] if self.is_allowed(self.snap(self.start)) else []
        for _ in range(50):
            for point in map(self.snap, fill.random(3 * k + 1)):
                if len(found) <= 3 * k + 1 and self.is_allowed(point) and self._is_new(point, found, 1e-9):
                    found.append(point)
        return found

    @property
    def best(self) -> int | None:
        """Number of the best design that keeps its limits, or None."""
        kept = [i for i, value in enumerate(self.values) if np.isfinite(value) and self.excess[i] <= 0.0]
        return min(kept, key=lambda i: self.values[i], default=None)

    def ended(self) -> bool:
        """Resize the box by what the last round led to; return whether it is too small to go on."""
        best = self.best
        value = np.inf if best is None else self.values[best]
        is_ahead = value < self._last - LEADS * abs(value)
        self.box = min(1.5 * self.box, MOST_BOX) if is_ahead else 0.6 * self.box
        self._last = min(value, self._last)
        return self.box < LEAST_BOX

    def next(self) -> list[Array]:
        """Return the designs of a round: the best of the surrogate, then those of which less is known."""
        known = np.array(self.points)
        is_good = np.isfinite(self.values)
        k = known.shape[1]
        centre = known[self._centre()] if is_good.any() else self.snap(self.start)
        low, high = np.clip(centre - self.box, 0.0, 1.0), np.clip(centre + self.box, 0.0, 1.0)
        near = centre + 0.25 * self.box * self._random.standard_normal((CANDIDATES, k))
        pool = np.concatenate([self._random.uniform(low, high, (CANDIDATES, k)), np.clip(near, low, high)])
        found = list[Array]()
        if is_good.sum() <= k + 1:
            return self._picked(found, pool, np.zeros(len(pool)), np.ones(BATCH))
        columns = np.stack([self.values, self.excess], axis=1)[is_good]
        scale = np.maximum(np.ptp(columns, axis=0), 1e-12)
        offset = np.array([columns[:, 0].min(), 0.0])
        model = RBFInterpolator(known[is_good], (columns - offset) / scale, kernel="cubic", degree=1)
        guess = model(pool)
        merit = guess[:, 0] + 10.0 * np.maximum(guess[:, 1], 0.0)
        for begin in (centre, pool[merit.argmin()]):
            limit = NonlinearConstraint(lambda x: model(x[None])[0, 1], -np.inf, -0.02 * self.box)
            box = Bounds(low, high)
            polished = minimize(
                lambda x: model(x[None])[0, 0], begin, bounds=box, constraints=limit, method="SLSQP"
            )
            point = self.snap(np.clip(polished.x, low, high))
            if self._is_new(point, [*self.points, *found], APART * self.box) and self.is_allowed(point):
                found.append(point)
        return self._picked(found, pool, merit, np.array([0.0, *CURIOUS]))

    def _centre(self) -> int:
        """Number of the design around which to look: the best, or where none keeps the limits the nearest."""
        if (best := self.best) is not None:
            return best
        return int(np.nanargmin(np.where(np.isfinite(self.values), self.excess, np.nan)))

    def _picked(self, found: list[Array], pool: Array, merit: Array, curious: Array) -> list[Array]:
        """Fill a round up from candidates, by their merit and by how far they are from what is known."""
        known, failed = np.array(self.points), ~np.isfinite(self.values)
        places = np.argsort(np.argsort(merit)) / len(merit)
        for share in curious[len(found) :]:
            all_known = np.array([*known, *found])
            gap = np.linalg.norm(pool[:, None] - all_known, axis=2)
            nearest = gap.argmin(axis=1)
            far = np.argsort(np.argsort(-gap.min(axis=1))) / len(pool)
            score = (1.0 - share) * places + share * far
            # Beside a design that failed others fail.
            score = score + np.append(failed, np.zeros(len(found), dtype=bool))[nearest]
            for i in np.argsort(score):
                point = self.snap(pool[i])
                if self._is_new(point, list(all_known), APART * self.box) and self.is_allowed(point):
                    found.append(point)
                    break
        return found

    @staticmethod
    def _is_new(point: Array, known: list[Array], apart: float) -> bool:
        return all(np.abs(point - one).max() > apart for one in known)
