"""Strain bases by name: the shape functions along a link that a robot file may ask for, docs/model.md (3).

`BASES` is the registry, and the one place that knows the names. A package that has other shape functions
adds its own `Basis` to it before it loads a robot.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Any, ClassVar, Protocol

import numpy as np

from soro_core.arrays import Array


class Field(Protocol):
    """Keys of a `soro_core.robot.strain.StrainField` that bases read."""

    @property
    def order(self) -> int | None:
        """Polynomial degree."""

    @property
    def modes(self) -> int | None:
        """Number of modes used; None for all."""

    @property
    def samples(self) -> tuple[tuple[float, ...], ...] | None:
        """Rows (n_samples, n_modes) of the modes, at equal distances from 0 to L."""

    @property
    def size(self) -> int:
        """Number of coordinates."""


class Basis(ABC):
    """Shape functions of one strain along a link, as functions of x = sigma / L from 0 to 1.

    Each method takes the field of the robot file, which holds the keys that the basis asks for.
    """

    keys: ClassVar[frozenset[str]] = frozenset()
    """Which of the keys order, modes, samples and file of a `StrainField` it takes."""
    varies: ClassVar[bool] = True
    """Whether the strain can vary along the link."""
    splits: ClassVar[bool] = True
    """Whether a part of a link can have the same functions on its own length."""
    orthogonal: ClassVar[bool] = False
    """Whether they are the Legendre polynomials, int phi_a phi_b dx = delta_ab / (2 a + 1)."""

    @abstractmethod
    def size(self, field: Field) -> int:
        """Number of shape functions."""

    @abstractmethod
    def values(self, field: Field, x: Array) -> Array:
        """Shape functions at places x (n,) from 0 to 1, (size, n)."""

    @abstractmethod
    def nodes(self, field: Field) -> tuple[Array, Array]:
        """Nodes and weights on 0 ... 1 that integrate products of two shape functions exactly."""

    def is_uniform(self, field: Field) -> bool:
        """Whether the one shape function is 1."""
        return not self.varies

    def uniform(self, field: Field, weight: Array, mean: Array) -> Array:
        """Coefficients (size,) of a strain of 1 all along the link.

        Parameters
        ----------
        field : Field
        weight : (size, size)
            int phi_a phi_b dx.
        mean : (size,)
            int phi_a dx.
        """
        first: Array = np.eye(len(mean))[0]
        return first


class Constant(Basis):
    """The strain is the same all along the link."""

    varies = False

    def size(self, field: Field) -> int:
        """One."""
        return 1

    def values(self, field: Field, x: Array) -> Array:
        """One."""
        return np.ones((1, x.size))

    def nodes(self, field: Field) -> tuple[Array, Array]:
        """One node in the middle."""
        return gauss(1)


class Polynomial(Basis):
    """Polynomials of degree 0 ... order in 2 x - 1, the first of them 1.

    Parameters
    ----------
    vandermonde : callable
        Values (n, order + 1) of the polynomials at places (n,) from -1 to 1.
    orthogonal : bool
        As in `Basis`.
    """

    keys = frozenset({"order"})

    def __init__(self, vandermonde: Callable[[Array, int], Any], orthogonal: bool = False) -> None:
        self._vandermonde = vandermonde
        self.orthogonal = orthogonal  # type: ignore[misc]  # of this instance

    def size(self, field: Field) -> int:
        """One more than the degree."""
        return _degree(field) + 1

    def values(self, field: Field, x: Array) -> Array:
        """Polynomials of degree 0, 1, ..., a row each."""
        return np.asarray(self._vandermonde(2 * x - 1, _degree(field)).T, dtype=np.float64)

    def nodes(self, field: Field) -> tuple[Array, Array]:
        """Gauss-Legendre nodes, exact to twice the degree."""
        return gauss(_degree(field) + 1)

    def is_uniform(self, field: Field) -> bool:
        """Whether the degree is 0."""
        return field.order == 0


class SampledModes(Basis):
    """Modes given by samples at equal distances along the whole link, with cubic splines between (POD)."""

    keys = frozenset({"modes", "samples", "file"})
    splits = False

    def size(self, field: Field) -> int:
        """Number of modes used."""
        return field.modes or len(_samples(field)[0])

    def values(self, field: Field, x: Array) -> Array:
        """Splines through the samples, a row for each mode."""
        from scipy.interpolate import CubicSpline  # loaded late: most robots have no modes

        samples = np.array(_samples(field))[:, : field.size]
        values: Array = CubicSpline(np.linspace(0.0, 1.0, len(samples)), samples)(x).T
        return values

    def nodes(self, field: Field) -> tuple[Array, Array]:
        """Gauss-Legendre nodes in each piece of the splines."""
        return gauss(4, len(_samples(field)) - 1)

    def uniform(self, field: Field, weight: Array, mean: Array) -> Array:
        """Coefficients of the projection of 1 by least squares.

        Parameters
        ----------
        field : Field
        weight : (size, size)
        mean : (size,)
            As in `Basis.uniform`.
        """
        return np.asarray(np.linalg.solve(weight, mean), dtype=np.float64)


BASES: dict[str, Basis] = {
    "constant": Constant(),
    "legendre": Polynomial(np.polynomial.legendre.legvander, orthogonal=True),
    "chebyshev": Polynomial(np.polynomial.chebyshev.chebvander),
    "pod": SampledModes(),
}


def names(allowed: Callable[[Basis], bool]) -> list[str]:
    """Names of the bases that `allowed` is true for."""
    return [name for name, basis in BASES.items() if allowed(basis)]


def listed(words: Iterable[str], joint: str = "or") -> str:
    """``a, b or c``, for messages."""
    *first, last = words
    return f"{', '.join(first)} {joint} {last}" if first else last


def _degree(field: Field) -> int:
    assert field.order is not None  # a field with this key is not made without
    return field.order


def _samples(field: Field) -> tuple[tuple[float, ...], ...]:
    assert field.samples is not None
    return field.samples


@lru_cache(maxsize=64)
def gauss(n: int, pieces: int = 1) -> tuple[Array, Array]:
    """Gauss-Legendre nodes and weights on 0 ... 1, n in each of the equal pieces; not to be written to."""
    x, weights = np.polynomial.legendre.leggauss(n)
    at = ((np.arange(pieces)[:, None] + (x + 1) / 2) / pieces).ravel()
    share = np.tile(weights / 2 / pieces, pieces)
    for shared in (at, share):
        shared.flags.writeable = False
    return at, share
