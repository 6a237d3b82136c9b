"""Deformation gradients and principal stretches at points of integration."""

from __future__ import annotations

import numpy as np

from soro_core.arrays import Array
from soro_design.fem.part import Part


def gradients(moved: Array, slope: Array, hoop: Array) -> Array:
    """Return deformation gradients (e, g, 3, 3); in a section the third direction is across or around.

    Parameters
    ----------
    moved : ndarray, (e, a, d)
        Displacements of the nodes of elements [m].
    slope, hoop : ndarray, (e, g, a, d) and (e, g, a)
        Those of `soro_design.fem.elements.solid.tables`.
    """
    d = moved.shape[2]
    found = np.zeros((*slope.shape[:2], 3, 3))
    found[..., :d, :d] = np.einsum("eai,egad->egid", moved, slope)
    found[..., 2, 2] += np.einsum("ea,ega->eg", moved[:, :, 0], hoop)
    return found + np.eye(3)


def greatest_stretch(part: Part, u: Array) -> float:
    """Return the greatest principal stretch at a point of integration.

    Means over elements, as of `soro_design.fem.strained`, leave out most of what bending adds where few
    elements lie across a wall.
    """
    found = gradients(u[part.mesh.cells], part.slope, part.hoop)
    return float(np.linalg.norm(found, ord=2, axis=(2, 3)).max())
