"""State of the loop of the force between two ticks."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from soro_core.adaptation.external_force import ExternalForce
from soro_core.arrays import Array
from soro_core.control.force.press import Press
from soro_core.control.force.tracked_tip import TrackedTip
from soro_core.control.reference.trajectory import Reference
from soro_core.frozen import replaced

Phase: TypeAlias = Literal["", "approach", "contact", "stopped"]
# Time constant of the push on its way to another force [s], and the force that is none [N].
PUSH_S = 0.12
_NONE_N = 1e-6


def _zero() -> Array:
    return np.zeros(3)


@dataclass(frozen=True)
class ForceLoopState:
    """State of the loop of the force.

    Attributes
    ----------
    shift, shift_rate : ndarray (n_q,)
        How far the reference is moved, and its rate, in coordinates.
    moved, rate : ndarray (3,)
        The same of its tip, in the world [m, m/s].
    press : Press or None
        The press under way.
    asked : Reference or None
        The reference that was given last, and
    quiet_s : float
        the time since then [s].
    phase : str
        Of the press; "stopped" for one that has met nothing. Without a press "contact" while the cap acts.
    approach_s : float
        Time of the approach [s].
    gap_s : float
        Time without an estimate of the force that is bridged [s].
    missing_pa : ndarray (n_u,) or None
        Pressure beyond its bound that an approach needs of each chamber, negative below [Pa]; None for none.
    beyond : str
        Where, and by which chambers, the tip could not follow an approach; empty if it could.
    is_unfelt : bool
        Whether a press or a cap is without an estimate of the force.
    refusal : str
        Why the configured press is refused; empty if it is not.
    tracked : TrackedTip or None
        Of the arm; None where it is not tracked.
    toward : ndarray (3,)
        Direction of the push.
    pressed_n : float
        Force along the direction of a press [N].
    by_common : ndarray (3, n_links)
        How far a common pressure of each link moves the tip [m/Pa].
    scale : float
        What makes of a push at the tip of uniform links the same of ones that it bends non-uniformly.
    wanted_n, answer_n, added_n : float
        f, f as the estimate is to show it, and z [N].
    yields : pair of ndarray (3, 3), or None
        How far the reference moves for the force that pushes the tip [m/N], and the covariance of such forces
        about 0 [N^2]; None where nothing pushes it. Zero for an arm without a stiffness of its own.
    pressure_pa : ndarray (n_u,)
        Measured pressures [Pa gauge].
    felt : ExternalForce or None
        Estimated force on the arm; None where it is not estimated.
    """

    shift: Array
    shift_rate: Array
    moved: Array = field(default_factory=_zero)
    rate: Array = field(default_factory=_zero)
    press: Press | None = None
    asked: Reference | None = None
    quiet_s: float = 0.0
    phase: Phase = ""
    approach_s: float = 0.0
    gap_s: float = 0.0
    missing_pa: Array | None = None
    beyond: str = ""
    is_unfelt: bool = False
    refusal: str = ""
    tracked: TrackedTip | None = None
    toward: Array = field(default_factory=_zero)
    pressed_n: float = 0.0
    by_common: Array = field(default_factory=lambda: np.zeros((3, 0)))
    scale: float = 1.0
    wanted_n: float = 0.0
    answer_n: float = 0.0
    added_n: float = 0.0
    yields: tuple[Array, Array] | None = None
    pressure_pa: Array = field(default_factory=_zero)
    felt: ExternalForce | None = None

    @property
    def push_n(self) -> Array:
        """Force that is added at the tip of uniform links, (3,) [N]."""
        return np.asarray(self.scale * (self.wanted_n + self.added_n) * self.toward)

    def released(self, dt: float) -> ForceLoopState:
        """Return the state with less push, after a tick of `dt` [s]."""
        if not self.wanted_n:
            return self
        left = 0.0 if self.wanted_n < _NONE_N else float(np.exp(-dt / PUSH_S))
        wanted, answer, added = (left * n for n in (self.wanted_n, self.answer_n, self.added_n))
        return replaced(self, wanted_n=wanted, answer_n=answer, added_n=added)
