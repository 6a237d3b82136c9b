"""The coordinates of a robot as fields of strain: one field for each strain of each link.

Gains, noises and limits are given for strains that are uniform along their link. With several coefficients
a strain they are carried over by the weight W of docs/model.md (4): k x^2 of a uniform strain x becomes
k q' W q, k times the mean square along the link. It is the same in whatever basis the strain is written; a
constant one has W = 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array, Flags, Integers
from soro_core.robot.basis import shape_integrals, shape_means, shape_values, strain_rows
from soro_core.robot.description import Robot
from soro_core.robot.link import Link

STRETCHES = ("elongation", "shear_x", "shear_y")
# Points along a link at which a field is evaluated for its largest value, the ends among them.
_POINTS = 65
# Beyond any strain, and far from overflow in a sum of coefficients.
_HUGE = 1e100


@dataclass(frozen=True)
class StrainFields:
    """Fields of strain of one robot, in the order of its coordinates.

    Attributes
    ----------
    links, strains : tuple of int, tuple of str
        Link and strain of each field.
    index : ndarray of int (n_q,)
        The field that each coordinate belongs to.
    first : ndarray of int (n_fields,)
        The first coordinate of each field.
    stretch : ndarray of bool (n_q,)
        Elongation and shears (no unit), as against bending and torsion [1/m].
    length : ndarray (n_q,)
        Length of the link [m].
    weight : ndarray (n_q, n_q)
        W: mean over the link of phi_a phi_b, zero between different fields.
    root : ndarray (n_q, n_q)
        Its product ``root.T @ root`` is the inverse of W.
    mean : ndarray (n_q,)
        Mean of each shape function: ``mean * q`` summed over a field is its mean strain.
    uniform : ndarray (n_q,)
        Coefficients of a strain of 1 all along the link: 1 on the polynomial of degree 0 and 0 above; of
        modes the least-squares projection.
    samples : ndarray (n_q, n)
        Shape functions at points along the link, ends included.
    largest : ndarray (n_q,)
        Their largest absolute values.
    """

    links: tuple[int, ...]
    strains: tuple[str, ...]
    index: Integers
    first: Integers
    stretch: Flags
    length: Array
    weight: Array
    root: Array
    mean: Array
    uniform: Array
    samples: Array
    largest: Array

    def of(self, strain: str, link: int | None = None) -> Array:
        """Return 1 on the coordinates of a strain (of one link, or of all), 0 elsewhere, (n_q,)."""
        wanted = [s == strain and link in (None, i) for i, s in zip(self.links, self.strains, strict=True)]
        return np.array(wanted, dtype=np.float64)[self.index]

    def peaks(self, q: Array) -> Array:
        """Return the largest absolute strain along the link of the field of each coordinate, (..., n_q)."""
        values = np.add.reduceat(q[..., None] * self.samples, self.first, axis=-2)
        peaks: Array = np.max(np.abs(values), axis=-1)[..., self.index]
        return peaks

    def bounds(self, q: Array) -> Array:
        """Return a bound of `peaks` (..., n_q) without evaluating the field, exact if it is constant."""
        bounds: Array = np.add.reduceat(np.abs(q) * self.largest, self.first, axis=-1)[..., self.index]
        return bounds

    def within(self, q: Array, limit: Array) -> Array:
        """Scale down each field that is beyond its limit somewhere along the link; `limit` (n_q,)."""
        # A sum of coefficients must not overflow.
        q = np.minimum(np.maximum(q, -_HUGE), _HUGE)
        # Where the coefficients add up to less than the limit, the field need not be evaluated.
        if all((self.bounds(q) <= limit).ravel().tolist()):  # of few numbers in a third of numpy's time
            return q
        peaks = self.peaks(q)
        return np.where(peaks > limit, q / np.maximum(peaks, limit) * limit, q)


def strain_fields(robot: Robot) -> StrainFields:
    """Return the strain fields of a robot."""
    counts = [field.size for link in robot.links for field in link.strains.values()]
    rows = [(link, strain) for link in robot.links for strain in strain_rows(link)]
    weight = np.zeros((robot.n_q, robot.n_q))
    first = 0
    for link in robot.links:
        behind = first + link.n_q
        weight[first:behind, first:behind] = shape_integrals(link) / link.length
        first = behind
    places = np.linspace(0.0, 1.0, _POINTS)
    samples = np.concatenate([shape_values(link, places * link.length) for link in robot.links])
    return StrainFields(
        links=tuple(i for i, link in enumerate(robot.links) for _ in link.strains),
        strains=tuple(strain for link in robot.links for strain in link.strains),
        index=np.repeat(np.arange(len(counts)), counts),
        first=np.cumsum([0, *counts])[:-1],
        stretch=np.array([strain in STRETCHES for _, strain in rows]),
        length=np.array([link.length for link, _ in rows]),
        weight=weight,
        root=np.linalg.inv(np.linalg.cholesky(weight)),
        mean=np.concatenate([shape_means(link) for link in robot.links]),
        uniform=np.concatenate([_uniform(link) for link in robot.links]),
        samples=samples,
        largest=np.max(np.abs(samples), axis=1),
    )


def _uniform(link: Link) -> Array:
    weight, mean = shape_integrals(link) / link.length, shape_means(link)
    parts, first = [], 0
    for field in link.strains.values():
        rows = slice(first, first + field.size)
        parts.append(field.shape_functions.uniform(field, weight[rows, rows], mean[rows]))
        first += field.size
    return np.concatenate(parts)
