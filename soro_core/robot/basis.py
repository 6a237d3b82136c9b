"""Shape functions of the strains along a link and their integrals, docs/model.md (3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.robot.link import Link


def strain_rows(link: Link) -> tuple[str, ...]:
    """Strain of each coordinate of a link, in order: ``("bending_x", "bending_x", "elongation")``."""
    return tuple(name for name, field in link.strains.items() for _ in range(field.size))


def shape_values(link: Link, sigma: ArrayLike) -> Array:
    """Value of the shape function of each coordinate: the columns of B(sigma), without the zeros.

    The strain ``name`` at sigma is the sum of ``q[a] * shape_values(link, sigma)[a]`` over the coordinates a
    with ``strain_rows(link)[a] == name``, added to that of the straight link.

    Parameters
    ----------
    link : Link
    sigma : array of shape (n,)
        Arc length of the undeformed link [m], from 0 to its length (clamped within 1e-9 of the ends).

    Returns
    -------
    Array of shape (n_q, n)

    Raises
    ------
    ModelError
        If a sigma is not finite or outside of the link.
    """
    at = np.atleast_1d(np.asarray(sigma, dtype=np.float64)) / link.length
    inside = (at >= -1e-9) & (at <= 1 + 1e-9)  # false for NaN
    if at.ndim != 1 or not inside.all():
        raise ModelError(
            f"shape_values: sigma: got {sigma!r}; allowed: values from 0 to {link.length:g} m", "sigma"
        )
    at = np.clip(at, 0.0, 1.0)
    return np.concatenate([field.shape_functions.values(field, at) for field in link.strains.values()])


def shape_integrals(link: Link) -> Array:
    """Integrals of phi_a phi_b over the undeformed length [m], zero for different strains, (n_q, n_q).

    Exact up to round-off: Gauss-Legendre nodes enough for the polynomials, and for those between the samples
    of modes.
    """
    total = np.zeros((link.n_q, link.n_q))
    first = 0
    for field in link.strains.values():
        at, weights = field.shape_functions.nodes(field)
        values = field.shape_functions.values(field, at)
        block = link.length * (values * weights) @ values.T
        last = first + field.size
        total[first:last, first:last] = (block + block.T) / 2
        first = last
    return total


def shape_means(link: Link) -> Array:
    """Mean of each shape function over the link, (n_q,); exact up to round-off."""
    means = []
    for field in link.strains.values():
        at, weights = field.shape_functions.nodes(field)
        means.append(field.shape_functions.values(field, at) @ weights)
    return np.concatenate(means)
