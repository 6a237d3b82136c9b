"""What an analysis returns to the iterations."""

from __future__ import annotations

from dataclasses import dataclass

from soro_core.arrays import Array


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A goal and its gradient.

    Attributes
    ----------
    objective : float
        To be made small.
    gradient : ndarray, (e,)
        Its derivative by the densities.
    motion_m : float
        Of the output [m], NaN without one.
    u : ndarray, (n, 2)
        Displacements [m].
    pressure : ndarray, (n,)
        Of the nodes [Pa].
    residual : float
        Unbalanced force over the force of the air, as norms.
    """

    objective: float
    gradient: Array
    motion_m: float
    u: Array
    pressure: Array
    residual: float
