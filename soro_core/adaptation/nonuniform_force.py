"""Error of the generalised force of the constant-strain model, where weight bends links non-uniformly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soro_core.adaptation.learned import Learned
from soro_core.adaptation.scales import Scales
from soro_core.arrays import Array
from soro_core.frozen import quick


@quick
@dataclass(frozen=True)
class NonuniformForce:
    """Error of the generalised force of constant strains at rest, about coordinates and a mass at the tip.

    Attributes
    ----------
    q, mass_kg : ndarray (n_q,), float
        Where it is found; the mass is that beyond the robot file's.
    force, by_mass : ndarray (n_q,)
        The force, and its change by the mass.
    by_q : ndarray (n_q, n_q)
        Its change by q.
    """

    q: Array
    mass_kg: float
    force: Array
    by_mass: Array
    by_q: Array

    def at(self, q: Array, mass_kg: float) -> Array:
        """Return the force at coordinates (n_q,) and a mass [kg] near to those where it is found."""
        return np.asarray(self.force + self.by_q @ (q - self.q) + self.by_mass * (mass_kg - self.mass_kg))

    def added_to(self, learned: Learned, scales: Scales) -> Learned:
        """Return a learned model with this force, as far as W has its form."""
        return learned.with_force(self.q, self.force, self.by_q, scales)
