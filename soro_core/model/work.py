"""Workspace of the kernels: arrays that a computation writes into, made once and used again.

An allocation costs a tenth of a link's dynamics; a workspace belongs to one thread at a time.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core._jit import inner
from soro_core.model.tables import Tables

Array: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]


class Work(NamedTuple):
    """Arrays for n links of at most m coordinates each."""

    node: Array
    """B1 at the present node, one column a row, (m, 6)."""
    powers: Array
    """ad_xi^k of each column of B, (5, m, 6); for varying strain of the columns of a sub-interval."""
    chain: Array
    """ad_xi^k of B v and its rates, (2, 5, 6)."""
    vectors: Array
    """Twists and wrenches in use, (28, 6)."""
    scalars: Array
    """Stumpff functions and tangent coefficients, (18,)."""
    frames: Array
    """Poses in use: rotations above, positions below, (4, 4, 3)."""
    rotation: Array
    """Of the end of each link in its base, (n, 3, 3)."""
    position: Array
    end: Array
    """B1 at the end of each link, (n, m, 6)."""
    own: Array
    """Wrench of each link's own mass about its base, (n, 6)."""
    inertia: Array
    """Inertia of each link as a rigid body about its base, (n, 6, 6)."""
    coupling: Array
    """Momentum of each link by its coordinates, int N B1, (n, m, 6)."""
    mass: Array
    """Inertia matrix of each link by itself, (n, m, m), lower triangle; then the factors of the joint."""
    gain: Array
    """D^-1 U of each joint (n, m, 6)."""
    force: Array
    """U of each joint (n, m, 6)."""
    block: Array
    """What is added to the inertia matrix, link by link: (n_q, m)."""
    dense: Array
    """Columns of all coordinates, (3, n_q, 6)."""
    rows: Array
    """Generalised forces and velocities, (5, n_q); row 0 stays zero."""
    matrix6: Array
    """(2, 6, 6)."""
    matrix: Array
    """For the method `mde` (3, n_q, n_q); empty for `exact`."""
    pivots: Integers
    extra: Array
    """Tangents of what acts from outside, as bodies about the links' bases: (n, 6, 6), empty without."""
    site_force: Array
    """Force at each place where something acts, in the world, (n_places, 3)."""
    site_frames: Array
    """Poses on the way from place to place, (4, 4, 3)."""
    site_vectors: Array
    """Twists and wrenches there, (5, 6)."""
    site_columns: Array
    """B1 there, (2, m, 6)."""
    points: Array
    """Positions, velocities and forces there, (5, 3)."""


class Arm(NamedTuple):
    """What the kernels need of an arm: its numbers, and room to compute in."""

    tables: Tables
    work: Work


@inner
def workspace(t: Tables, dense: int) -> Work:
    """Arrays for the robot of these tables; `dense` matrices of all coordinates."""
    n = t.length.shape[0]
    n_q = t.basis.shape[0]
    m = t.stiffness.shape[1]
    n_places = t.external.kind.shape[0]
    return Work(
        np.zeros((m, 6)),
        np.zeros((5, max(m, 12), 6)),
        np.zeros((2, 5, 6)),
        np.zeros((28, 6)),
        np.zeros(18),
        np.zeros((4, 4, 3)),
        np.zeros((n, 3, 3)),
        np.zeros((n, 3)),
        np.zeros((n, m, 6)),
        np.zeros((n, 6)),
        np.zeros((n, 6, 6)),
        np.zeros((n, m, 6)),
        np.zeros((n, m, m)),
        np.zeros((n, m, 6)),
        np.zeros((n, m, 6)),
        np.zeros((n_q, m)),
        np.zeros((3, n_q, 6)),
        np.zeros((5, n_q)),
        np.zeros((2, 6, 6)),
        np.zeros((dense, n_q, n_q)),
        np.zeros(n_q, dtype=np.int64),
        np.zeros((n if n_places > 0 else 0, 6, 6)),
        np.zeros((n_places, 3)),
        np.zeros((4, 4, 3)),
        np.zeros((5, 6)),
        np.zeros((2, m, 6)),
        np.zeros((5, 3)),
    )


@inner
def dense_workspace(t: Tables) -> Work:
    """Workspace of the method `mde`."""
    return workspace(t, 3)


@inner
def sparse_workspace(t: Tables) -> Work:
    """Workspace of the method `exact`, which needs no matrix of all coordinates."""
    return workspace(t, 0)
