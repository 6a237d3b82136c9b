"""Forces on an arm from outside, for callers."""

from __future__ import annotations

from dataclasses import dataclass

from soro_core.arrays import Array, Integers


@dataclass(frozen=True)
class ExternalForces:
    """Forces from outside at one state, without gravity.

    Attributes
    ----------
    generalised : (n_q,)
        On the right-hand side of the equation of motion.
    place : (n_places,)
        Metres along the arm where something can act, outward.
    force : (n_places, 3)
        Force there, in the world [N]: of contact, of the held tip, of a wrench of `wrench_places`.
    kind : (n_places,)
        `soro_core.model.tables.CONTACT`, `HELD`, or 0 and above for a wrench.
    energy : float
        Stored in contact and in what holds the tip [J].
    """

    generalised: Array
    place: Array
    force: Array
    kind: Integers
    energy: float
