"""Where the stiffness of elements and faces goes in the sparse matrix, computed once for a mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix

from soro_core.arrays import Array, Integers
from soro_core.errors import ModelError


@dataclass(frozen=True, eq=False)
class Pattern:
    """Places of the entries of a square matrix, by columns.

    Attributes
    ----------
    n : int
        Number of rows.
    d : int
        Numbers of a node: row d a + k is displacement k of node a.
    keys : ndarray of int
        n column + row of each entry, rising.
    start, row : ndarray of int
        First entry of each column, and row of each entry.
    cells : ndarray of int, (e, m d, m d)
        Entries of the elements.
    """

    n: int
    d: int
    keys: Integers
    start: Integers
    row: Integers
    cells: Integers

    def entries(self, groups: Integers) -> Integers:
        """Return the entries (f, m d, m d) of nodes (f, m).

        Raises
        ------
        ModelError
            If the nodes of a group do not lie in one element.
        """
        keys = _keys(groups, self.d, self.n)
        found = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1).astype(np.int64)
        if (self.keys[found] != keys).any():
            raise ModelError(
                "faces or fibres with nodes of different elements; allowed: nodes of one element", "faces"
            )
        return found

    def diagonal(self) -> Integers:
        """Return the entries (n,) of the diagonal."""
        rows = np.arange(self.n)
        return np.searchsorted(self.keys, self.n * rows + rows).astype(np.int64)

    def matrix(self, data: Array) -> Any:
        """Return the matrix that has these entries."""
        return csc_matrix((data, self.row, self.start), shape=(self.n, self.n))


def make_pattern(cells: Integers, n_nodes: int, d: int) -> Pattern:
    """Return the pattern of elements.

    Parameters
    ----------
    cells : ndarray of int, (e, m)
        Nodes of the elements.
    n_nodes : int
        Number of all nodes.
    d : int
        Displacements of a node.
    """
    n = n_nodes * d
    all_keys = _keys(cells, d, n)
    keys, entries = np.unique(all_keys, return_inverse=True)
    start = np.searchsorted(keys, n * np.arange(n + 1))
    entries = entries.reshape(all_keys.shape).astype(np.int64)
    return Pattern(n, d, keys, start.astype(np.int32), (keys % n).astype(np.int32), entries)


def _keys(groups: Integers, d: int, n: int) -> Integers:
    rows = (groups[:, :, None] * d + np.arange(d)).reshape(len(groups), -1)
    return rows[:, :, None] + n * rows[:, None, :]
