"""Linear equations of large solids by iterations: conjugate gradients or GMRES under algebraic multigrid.

The multigrid (`soro_design.fem.multigrid`) keeps the motions of a rigid body, the softest of each part of a
solid.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.sparse import bsr_array
from scipy.sparse.linalg import LinearOperator, gmres

from soro_core.arrays import Array, Flags
from soro_design.fem.multigrid.levels import Levels

# Greatest residual over the right hand side: the balance of forces decides, each iteration anew.
TOLERANCE = 1e-5
# Most iterations of conjugate gradients; most of GMRES, in rounds between restarts.
ITERATIONS, ROUNDS, RESTART = 300, 4, 60
Apply = Callable[[Array], Array]


class Multigrid:
    """A sparse matrix of a solid, ready to solve with.

    Parameters
    ----------
    matrix : sparse array, (n, n)
        Three displacements a node.
    motions : ndarray, (n, 6)
        Of `rigid_motions`.
    is_symmetric : bool
        Whether it is.
    """

    is_direct = False

    def __init__(self, matrix: Any, motions: Array, is_symmetric: bool) -> None:
        # By rows; the columns of a symmetric matrix are its rows.
        self._matrix = bsr_array(matrix.T if is_symmetric else matrix, blocksize=(3, 3))
        self._is_symmetric = is_symmetric
        even = self._matrix if is_symmetric else bsr_array((matrix + matrix.T) / 2.0, blocksize=(3, 3))
        self._cycle = Levels(even, motions).cycle

    def solve(self, right: Array) -> Array:
        """Return the solution (n,) for a right hand side (n,), NaN where iterations do not find it."""
        found = None
        if self._is_symmetric:
            found = conjugate_gradients(self._matrix.dot, self._cycle, right, TOLERANCE, ITERATIONS)
        if found is None:
            near = LinearOperator(self._matrix.shape, matvec=self._cycle, dtype=right.dtype)
            found, failed = gmres(
                self._matrix, right, rtol=TOLERANCE, restart=RESTART, maxiter=ROUNDS, M=near
            )
            if failed:
                return np.full_like(right, np.nan)
        return np.asarray(found)


def conjugate_gradients(
    matrix: Apply, inverse: Apply, right: Array, tolerance: float, most: int
) -> Array | None:
    """Return the solution of a symmetric system, or None where the matrix is not positive, or it takes long.

    Parameters
    ----------
    matrix, inverse : callable
        Products with the matrix, and with something near its inverse, symmetric and positive.
    right : ndarray, (n,)
        Right hand side.
    tolerance : float
        Greatest residual over the right hand side, as norms.
    most : int
        Most iterations.
    """
    found, residual = np.zeros_like(right), right.copy()
    enough = tolerance * float(np.linalg.norm(right))
    way, last = np.zeros_like(right), 1.0
    for _ in range(most):
        if float(np.linalg.norm(residual)) <= enough:
            return found
        near = inverse(residual)
        now = float(residual @ near)
        way = near + now / last * way
        image = matrix(way)
        curvature = float(way @ image)
        if not (now > 0.0 and curvature > 0.0):
            return None
        length, last = now / curvature, now
        found += length * way
        residual -= length * image
    return None


def rigid_motions(places: Array, is_held: Flags) -> Array:
    """Return motions (3 n, 6) of nodes at places (n, 3) [m], as of a rigid body where nodes are not held.

    Parameters
    ----------
    places : ndarray, (n, 3)
        Of the nodes [m].
    is_held : ndarray of bool, (n, 3)
        Directions in which nodes do not move.
    """
    arm = places - places.mean(axis=0)
    arm = arm / np.abs(arm).max()
    motions = np.empty((*places.shape, 6))
    motions[:, :, :3] = np.eye(3)
    motions[:, :, 3:] = np.cross(np.eye(3)[None], arm[:, None]).transpose(0, 2, 1)
    motions[is_held] = 0.0
    return motions.reshape(-1, 6)
