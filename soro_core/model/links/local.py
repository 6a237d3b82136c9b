"""Strains at the quadrature nodes of a link, for laws that hold at every section by itself.

A strain that does not vary along its link is evaluated once, for the whole link.
"""

from __future__ import annotations

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.tables import Tables


@inner
def n_samples(t: Tables, i: int) -> int:
    """Return the number of nodes at which a law of link i is evaluated."""
    return t.nodes.shape[0] if t.varying[i] else 1


@inner
def local_strain(t: Tables, i: int, r: int, k: int, q: Array) -> float:
    """Elongation, bending_x or bending_y (r = 0, 1, 2) of link i at node k."""
    strain = 0.0
    for c in range(t.columns[i, r, 0], t.columns[i, r, 1]):
        strain += t.shape_node[c, k] * q[c]
    return strain
