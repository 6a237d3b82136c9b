"""Gains of chambers relative to their link, and the slope of their areas: what is learned of H.

The robot file's H(q) has a column H_u for each chamber u. The true one is taken as e_u(q) H_u(q),

    e_u(q) = (1 + g_u) exp(b_i delta_u(q)),

with the relative gain g_u, the area slope b_i of link i beyond the file's, and the mean strain delta_u of the
chamber's fibre: areas grow so in a robot file, too. The g_u of a link have the mean 0: in free motion, a gain
that all chambers share cannot be told from stiffness and load (docs/control.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from soro_core.arrays import Array

if TYPE_CHECKING:
    from soro_core.model import SoftArm

# Bounds of g and b, of the growth of an area, and of e: H keeps its rank.
LEAST_GAIN, MOST_GAIN, MOST_SLOPE = -0.7, 1.0, 10.0
_MOST_GROWTH = 4.0
_LEAST, _MOST = 0.2, 4.0
# Prior deviation of the mean of the g of a link, which stays at 0.
_MEAN_STD = 1e-3
# Part of a unit of q for the difference quotient of H.
_STEP = 1e-6
# A chamber is named whose gain differs from that of the others by this part, and by so many deviations.
NAMED_PART, NAMED_DEVIATIONS = 0.15, 3.0


@dataclass(frozen=True)
class ChamberModel:
    """The chambers of one arm, and what is expected of their gains.

    Attributes
    ----------
    arm : SoftArm
    link : ndarray of int (n_u,)
        Link at which each chamber begins.
    fibre : ndarray (n_u, n_q)
        Mean strain of each chamber's fibre by q; 0 where the file does not say where it lies.
    gain_std, slope_std : float
        Prior deviations of g and b.
    lower, upper : ndarray (size,)
        Bounds of the values.
    step : ndarray (n_q,)
        Changes of q for difference quotients.
    """

    arm: SoftArm
    link: NDArray[np.int64]
    fibre: Array
    gain_std: float
    slope_std: float
    lower: Array
    upper: Array
    step: Array

    @property
    def size(self) -> int:
        """Number of values."""
        return self.lower.size

    def prior(self, values: Array) -> Array:
        """Return the inverse covariance (size, size) that is expected of values (size,) like these.

        Most files are right, and some are far off: a prior with long tails, as that of a Gaussian whose
        variance grows with what is found.
        """
        n, (same, apart, together) = self.link.size, self._of_means
        prior = np.zeros((self.size, self.size))
        largest = (values[:n] ** 2 * same).max(axis=1, initial=0.0)
        prior[:n, :n] = apart / (self.gain_std**2 + largest)[:, None] + together
        prior.flat[n * (self.size + 1) :: self.size + 1] = 1.0 / (self.slope_std**2 + values[n:] ** 2)
        return prior

    @cached_property
    def _of_means(self) -> tuple[Array, Array, Array]:
        """Whether chambers are of one link, what g differs by from its mean, and the prior of that mean."""
        same = (self.link[:, None] == self.link).astype(float)
        mean = same / same.sum(axis=1)
        return same, np.eye(self.link.size) - mean, mean / _MEAN_STD**2

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the values: a slope has that of its link in the robot."""
        chambers = self.arm.robot.chamber_names
        links = dict.fromkeys(name.partition("/")[0] for name in chambers)
        return (*(f"{name}/gain" for name in chambers), *(f"{link}/area_slope" for link in links))

    def factor(self, values: Array, q: Array) -> Array:
        """Return e (n_u,) at coordinates q (n_q,), or e (n, n_u) at several (n, n_q)."""
        strain = self.fibre @ q if q.ndim == 1 else np.array([self.fibre @ one for one in q])
        found = (1.0 + values[: self.link.size]) * self._growth(values, strain)
        return np.asarray(np.minimum(np.maximum(found, _LEAST), _MOST))

    def _growth(self, values: Array, strain: Array) -> Array:
        """Return exp(b_i delta_u) (..., n_u) at strains delta (..., n_u), within bounds."""
        growth = np.exp(values[self.link.size :][self.link] * strain)
        return np.asarray(np.minimum(np.maximum(growth, 1.0 / _MOST_GROWTH), _MOST_GROWTH))

    def tangent(self, values: Array, q: Array, acting_pa: Array) -> tuple[Array, Array]:
        """Return the tangent of `force` at `values`: where they are 0 (n_q,), and its change (n_q, size)."""
        n, strain = self.link.size, self.fibre @ q
        growth, whole = self._growth(values, strain), self.arm.actuation_matrix(q) * acting_pa
        by_gain = -growth * whole
        by_slope = by_gain * ((1.0 + values[:n]) * strain)
        change = np.concatenate([by_gain, by_slope @ self._of_link], axis=1)
        force = whole.sum(axis=1) + by_gain @ (1.0 + values[:n])
        return force - change @ values, change

    @cached_property
    def _of_link(self) -> Array:
        """Whether a chamber begins at a link, 0 or 1: (n_u, links)."""
        return np.asarray(self.link[:, None] == np.arange(self.size - self.link.size), dtype=np.float64)

    def force(self, values: Array, q: Array, acting_pa: Array) -> tuple[Array, Array]:
        """Return H(q) (1 - e(q)) p (n_q,), what the file's H makes too much, and its change by q (n_q, n_q).

        Parameters
        ----------
        values : ndarray (size,)
        q : ndarray (n_q,)
        acting_pa : ndarray (n_u,)
            Effective pressures p [Pa].
        """
        places = np.array([q, *(q + self._steps)])
        acts_pa = (1.0 - self.factor(values, places)) * acting_pa
        here, *moved = (self.arm.actuation_matrix(x) @ p for x, p in zip(places, acts_pa, strict=True))
        by_q = np.empty((q.size, q.size))
        for k, there in enumerate(moved):
            by_q[:, k] = there - here
        return here, by_q / self.step

    @cached_property
    def _steps(self) -> Array:
        """Changes of q, one a row: (n_q, n_q)."""
        return np.diag(self.step)

    def named(self, values: Array, covariance: Array) -> str:
        """Return which chambers differ from the others of their link, or an empty string.

        Parameters
        ----------
        values : ndarray (size,)
        covariance : ndarray (size, size)
            Of the values.
        """
        texts = []
        for i in range(self.lower.size - self.link.size):
            of = np.flatnonzero(self.link == i)
            # The middle one stands for the others; of two it is the stronger one.
            usual = of[np.argsort(values[of])[of.size // 2]]
            for u in of:
                apart = values[u] - values[usual]
                ratio = (1.0 + values[u]) / (1.0 + values[usual])
                variance = covariance[u, u] + covariance[usual, usual] - 2.0 * covariance[u, usual]
                if abs(ratio - 1.0) > NAMED_PART and apart**2 > NAMED_DEVIATIONS**2 * variance:
                    name = self.arm.robot.chamber_names[u]
                    texts.append(f"{name} gives {ratio:.2f} of the force that its file says")
        return ", ".join(texts)


def chamber_model(arm: SoftArm, gain_std: float, slope_std: float, unit: Array) -> ChamberModel:
    """Return the chambers of an arm.

    Parameters
    ----------
    arm : SoftArm
    gain_std, slope_std : float
        Prior deviations of g and b.
    unit : ndarray (n_q,)
        Units of q.
    """
    axial = arm.tables.axial_gain.sum(axis=0)
    straight = arm.actuation_matrix(np.zeros(arm.n_q)).T
    fibre = np.divide(straight, axial[:, None], out=np.zeros_like(straight), where=axial[:, None] != 0.0)
    link = _links(arm.robot.chamber_names)
    gains, slopes = link.size, len(set(link.tolist()))
    lower = np.concatenate([np.full(gains, LEAST_GAIN), np.full(slopes, -MOST_SLOPE)])
    upper = np.concatenate([np.full(gains, MOST_GAIN), np.full(slopes, MOST_SLOPE)])
    return ChamberModel(arm, link, fibre, gain_std, slope_std, lower, upper, _STEP * unit)


def _links(names: Sequence[str]) -> NDArray[np.int64]:
    """Return the number of each chamber's link, among those that have chambers, from link0/chamber1, ..."""
    links = [name.partition("/")[0] for name in names]
    order = {link: i for i, link in enumerate(dict.fromkeys(links))}
    return np.array([order[link] for link in links], dtype=np.int64)
