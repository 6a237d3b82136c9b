"""The external force, as the estimate, laws and topics carry it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from soro_core.arrays import Array

Stage: TypeAlias = Literal["free", "outside force", "contact"]


@dataclass(frozen=True)
class ExternalForce:
    """What pushes on the arm at its tip, apart from its own weight and load.

    Attributes
    ----------
    force_n : ndarray (3,)
        Force on the arm, in the world [N].
    covariance : ndarray (3, 3)
        Its covariance [N^2], with what is not known of the arm and of the scale of its gains.
    stage : {"free", "outside force", "contact"}
        Whether something pushes: a load may still explain an outside force, and no load a contact.
    mass_free : bool
        Whether the load may still be learned; not in contact.
    tip : ndarray (3,) or None
        Where the tip was measured, in the world, behind the low-pass of `fast_per_s` [m].
    """

    force_n: Array
    covariance: Array
    stage: Stage = "free"
    mass_free: bool = True
    tip: Array | None = None
