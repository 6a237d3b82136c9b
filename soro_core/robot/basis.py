"""What changes along a link: shape functions of the strains, docs/model.md (3), and its sections.

Places x run from 0 to 1 along the link.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.robot.bases import gauss
from soro_core.robot.link import CLOSE, Link

Profile: TypeAlias = Callable[[Link, str, Array], Array]
# Power of the radius that the stiffness against a strain goes with; else that of a second moment.
_OF_AREA = {"elongation": 2, "shear_x": 2, "shear_y": 2}
_OF_MOMENT = 4
# On each piece: for products of two shape functions of the highest degree with a stiffness of degree 5.
_GAUSS = 16


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


def shape_integrals(link: Link, profile: Profile | None = None) -> Array:
    """Integrals of phi_a phi_b over the undeformed length [m], zero for different strains, (n_q, n_q).

    Exact up to round-off: Gauss-Legendre nodes enough for the polynomials, and for those between the samples
    of modes.

    Parameters
    ----------
    link : Link
    profile : callable, optional
        A factor within the integral: of the link, the name of a strain and places (n,), (n,).
    """
    total = np.zeros((link.n_q, link.n_q))
    first = 0
    for name, field in link.strains.items():
        at, weights = field.shape_functions.nodes(field)
        if profile is not None:
            ends = np.union1d(knots(link), np.linspace(0.0, 1.0, len(field.samples or (0.0, 0.0))))
            at, weights = on_pieces(ends, *gauss(_GAUSS))
            weights = weights * profile(link, name, at)
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


def knots(link: Link) -> Array:
    """Places of its sections, (n,); 0 and 1 where it has none."""
    return np.array([0.0, *(row.place / link.length for row in link.sections[1:-1]), 1.0])


def on_pieces(ends: Array, at: Array, weights: Array) -> tuple[Array, Array]:
    """Nodes and weights (m n,) of a rule on each of m pieces.

    Parameters
    ----------
    ends : (m + 1,)
        Of the pieces.
    at, weights : (n,)
        Nodes and weights on 0 ... 1.
    """
    size = np.diff(ends)[:, None]
    return (ends[:-1, None] + size * at).ravel(), (size * weights).ravel()


def along(link: Link, key: str, x: Array) -> Array | None:
    """Values (n,) or (n, 2) of a key of the sections; None where they do not have it.

    Parameters
    ----------
    link : Link
    key : str
    x : (n,)
    """
    values = [getattr(row, key) for row in link.sections]
    if None in values or not values:
        return None
    columns = np.atleast_2d(np.array(values, dtype=np.float64).T)
    found = np.stack([np.interp(x, knots(link), column) for column in columns], axis=-1)
    return found if len(columns) > 1 else found[:, 0]


def radius_profile(link: Link, x: Array) -> Array:
    """Radius at places x (n,) [m], (n,)."""
    found = along(link, "radius", x)
    return np.full(len(x), link.radius) if found is None else found


def taper_at(links: Sequence[Link], s: Array) -> Array:
    """Radius over the largest of its link, (n,), at places s (n,) [m] along a chain of links."""
    ends = np.cumsum([link.length for link in links])
    factor = np.ones(len(s))
    for k, link in enumerate(links):
        on = np.searchsorted(ends[:-1], s - CLOSE) == k
        factor[on] = radius_profile(link, 1.0 - (ends[k] - s[on]) / link.length) / link.radius
    return factor


def section_profile(link: Link, strain: str, x: Array) -> Array:
    """Area, or second moment, that a strain acts on, over that of `link.radius`, (n,).

    Parameters
    ----------
    link : Link
    strain : str
    x : (n,)
    """
    power = _OF_AREA.get(strain, _OF_MOMENT)
    return np.asarray((radius_profile(link, x) / link.radius) ** power)


def stiffness_profile(link: Link, strain: str, x: Array) -> Array:
    """Stiffness against a strain over that of the moduli and `link.radius`, (n,).

    Its parameters as in `section_profile`.
    """
    factor = along(link, "stiffness", x)
    return section_profile(link, strain, x) * (1.0 if factor is None else factor)


def mean_stiffness(link: Link, strain: str) -> float:
    """Mean of `stiffness_profile` along the link."""
    at, weights = on_pieces(knots(link), *gauss(_GAUSS))
    return float(weights @ stiffness_profile(link, strain, at))


def mass_profile(link: Link, x: Array) -> Array:
    """Mass per length, docs/model.md (12), over its mean, at places x (n,), (n,)."""
    each = along(link, "mass_per_m", x)
    if each is not None:
        return np.asarray(each * link.length / link.mass)
    return np.asarray(np.pi * link.length / link.volume * radius_profile(link, x) ** 2)


def rest_strain(link: Link, x: Array) -> Array:
    """Strain xi_0 at rest at places x (n,), (n, 6)."""
    rest = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(x), 1))
    bend, torsion = along(link, "rest_curvature_per_m", x), along(link, "rest_torsion_per_m", x)
    if bend is None:
        bend = np.array([link.rest_curvature_per_m or (0.0, 0.0)])
    rest[:, 0], rest[:, 1] = -bend[:, 1], bend[:, 0]
    rest[:, 2] = (link.rest_torsion_per_m or 0.0) if torsion is None else torsion
    return rest
