"""The linear equations of a part between its free nodes, with the held displacements taken out."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from scipy.sparse import diags_array

from soro_core.arrays import Array
from soro_design.fem.part import Balance, Part
from soro_design.fem.solve.linear import Factors, KeptFactors, factorised, regular_factors
from soro_design.fem.solve.multigrid import rigid_motions

# Share of stiffness times displacements to which forces are known: some times the precision of numbers.
ROUNDING = 2e-15
# Greatest unbalanced force over the forces of stresses, whatever the rounding.
LEAST = 1e-6
# Greatest residual of a step's linear equations over their right hand side.
STEP_RESIDUAL = 1e-5
LOOSE_CAUSE = "nothing holds the part against some motion: hold it there"


class Equations:
    """The equations of a part, with its held displacements taken out.

    Parameters
    ----------
    part : Part
        The part.
    """

    def __init__(self, part: Part) -> None:
        self.part = part
        held = part.loads.held
        self.is_held = np.isfinite(held)
        self.target = np.where(self.is_held, held, 0.0)
        self.span = float(np.ptp(part.mesh.points, axis=0).max())
        self.edge = float(np.ptp(part.mesh.points[part.mesh.cells], axis=1).mean())
        pattern = part.pattern
        flat = self.is_held.ravel()
        column = np.repeat(np.arange(pattern.n), np.diff(pattern.start))
        self.dropped = flat[pattern.row] | flat[column]
        self.diagonal = pattern.diagonal()

    def gap(self, u: Array, load: float) -> Array:
        """Displacements (n, d) [m] still to go of held nodes."""
        return np.where(self.is_held, load * self.target - u, 0.0)

    def free(self, balance: Balance) -> Array:
        """Unbalanced forces (n, d) [N] of the free nodes."""
        return np.where(self.is_held, 0.0, balance.unbalanced)

    def is_met(self, balance: Balance, u: Array, load: float, tolerance: float) -> bool:
        """Whether held nodes are in their places and free ones in balance, as far as numbers show it.

        Parameters
        ----------
        balance : Balance
            Of the part at `u` and `load`.
        u : ndarray, (n, d)
            Displacements [m].
        load : float
            Load factor.
        tolerance : float
            Greatest unbalanced force over the size of the forces.
        """
        if not self.is_there(self.gap(u, load)):
            return False
        scale = max(balance.size, 1e-9 * float(np.abs(balance.data).max()) * self.span)
        off = float(np.linalg.norm(self.free(balance)))
        if off <= tolerance * scale:
            return True
        if off > LEAST * scale:
            return False
        # Forces of small strains, and of nearly incompressible parts, are small differences of large numbers.
        large = self.part.pattern.matrix(np.abs(balance.data)) @ (np.abs(u) + self.edge).ravel()
        return off <= ROUNDING * float(np.linalg.norm(large))

    def is_there(self, gap: Array) -> bool:
        """Whether held nodes are in their places."""
        return float(np.abs(gap).max()) <= 1e-14 * self.span

    def is_loose(self) -> bool:
        """Whether the undeformed part can move without a force."""
        zero = np.zeros_like(self.target)
        matrix = self.reduced(self.part.balance(zero, 0.0))
        return regular_factors(matrix, self.is_solid, self._motions(zero)) is None

    @property
    def is_solid(self) -> bool:
        """Whether nodes move in three directions."""
        return len(self.target.T) == 3

    def _motions(self, u: Array) -> Array | None:
        return rigid_motions(self.part.mesh.points + u, self.is_held) if self.is_solid else None

    def reduced(self, balance: Balance) -> Any:
        """Return the stiffness between free nodes, with a diagonal where nodes are held."""
        data, flat = balance.data, self.is_held.ravel()
        kept = np.where(self.dropped, 0.0, data)
        # A stiffness of the usual size keeps the matrix as well scaled as it is.
        kept[self.diagonal[flat]] = np.abs(data[self.diagonal]).mean()
        matrix = self.part.pattern.matrix(kept)
        if balance.coupling is None:
            return matrix
        is_free = diags_array(np.where(flat, 0.0, 1.0))
        return (matrix + is_free @ balance.coupling @ is_free).tocsc()

    def tangent(self, balance: Balance, u: Array) -> Tangent | None:
        """Return the factors of the stiffness at u (n, d) [m], or None where it is singular."""
        solver = factorised(self.reduced(balance), self.is_solid, self._motions(u))
        return None if solver is None else Tangent(self, balance, solver)

    def step(self, balance: Balance, u: Array, load: float, kept: KeptFactors) -> Array | None:
        """Return a step (n, d) [m] of Newton's method, or None where the stiffness is singular.

        Parameters
        ----------
        balance : Balance
            Of the part at `u` and `load`.
        u : ndarray, (n, d)
            Displacements [m].
        load : float
            Load factor.
        kept : KeptFactors
            Of the steps before.
        """
        gap, off = self.gap(u, load), self.free(balance)
        # The nearer to rest, the more exact: so that steps near it square the residual.
        share = min(STEP_RESIDUAL, float(np.linalg.norm(off)) / balance.size) if balance.size else 0.0
        factorise = partial(factorised, is_solid=self.is_solid, motions=self._motions(u))
        found = kept.solve(self.reduced(balance), self.right_hand_side(balance, -off, gap), share, factorise)
        return None if found is None else finite(found.reshape(u.shape) + gap)

    def right_hand_side(self, balance: Balance, force: Array, held: Array) -> Array:
        """Return the right hand side (n d,) of the equations of the free nodes.

        Parameters
        ----------
        balance : Balance
            Of the part.
        force, held : ndarray, (n, d)
            Force on free nodes [N], motion of held ones [m].
        """
        right = force.ravel() - (self.part.matrix(balance) @ held.ravel() if held.any() else 0.0)
        return np.where(self.is_held.ravel(), 0.0, right)

    def state_forces(self, balance: Balance) -> Array:
        """Forces (n, d) [N] of the supports."""
        return np.where(self.is_held, balance.unbalanced, 0.0)


class Tangent:
    """The factorised stiffness of a part at a state: how it moves under small forces and motions of supports.

    Parameters
    ----------
    equations : Equations
        Of the part.
    balance : Balance
        Its forces and its stiffness at the state.
    solver : Factors
        Of the reduced stiffness.
    """

    def __init__(self, equations: Equations, balance: Balance, solver: Factors) -> None:
        self._equations, self._balance, self._solver = equations, balance, solver

    def move(self, force: Array, held: Array) -> Array | None:
        """Return displacements (n, d) [m], or None where they are not finite.

        Parameters
        ----------
        force : ndarray, (n, d)
            More force on the nodes [N]; what stands at held ones does not count.
        held : ndarray, (n, d)
            Motion of held nodes [m], 0 where a node is free.
        """
        right = self._equations.right_hand_side(self._balance, force, held)
        return finite(self._solver.solve(right).reshape(force.shape) + held)


def finite(found: Array) -> Array | None:
    """Return numbers if all are finite, else None."""
    return found if np.isfinite(found).all() else None
