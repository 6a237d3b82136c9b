"""Lengths of steps: how far the load rises, and how much of a step of Newton's method is taken."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

from soro_core.arrays import Array

CUT, GROWTH = 0.5, 1.5
SHORTENINGS = 8


class LoadSteps:
    """The load step that fits: one that fails is halved, one that succeeds grows unless it was halved.

    Parameters
    ----------
    first, least : float
        First load step, and the one below which there is no way.
    """

    def __init__(self, first: float, least: float) -> None:
        self._size, self._least, self._is_cut = first, least, False

    def next(self, load: float, stop: float) -> float:
        """Return the load after `load` on the way to a stop."""
        return stop if load + 1.001 * self._size >= stop else load + self._size

    def has_failed(self, size: float) -> bool:
        """Halve a load step that failed; return whether what is left is too small."""
        self._size, self._is_cut = CUT * size, True
        return self._size < self._least

    def has_succeeded(self, size: float) -> None:
        """Go on from a load step that succeeded."""
        # A step that was cut to end at a stop does not shorten the next one.
        self._size = (1.0 if self._is_cut else GROWTH) * max(self._size, size)
        self._is_cut = False


class HasInversion(Protocol):
    """Forces, of which nothing has a meaning where an element is inverted."""

    @property
    def inverted(self) -> int:
        """First inverted element, or -1."""


Forces = TypeVar("Forces", bound=HasInversion)


def whole_or_half(forces: HasInversion) -> float:
    """Share of a step to keep: half where an element is inverted, else all."""
    return CUT if forces.inverted >= 0 else 1.0


def shortened(
    forces_at: Callable[[Array, Array], Forces],
    u: Array,
    step: Array,
    share: Callable[[Forces], float] = whole_or_half,
    length: float = 1.0,
) -> tuple[Array, Forces]:
    """Return the end of a step, and the forces there; it is shortened as long as a rule says so.

    Parameters
    ----------
    forces_at : callable
        Of displacements (n, d) and those before.
    u, step : ndarray, (n, d)
        Displacements before the step, and the whole step [m].
    share : callable
        Of forces at its end: how much of it to keep.
    length : float
        How much of it to try first.
    """
    for _ in range(SHORTENINGS):
        end = u + length * step
        forces = forces_at(end, u)
        kept = share(forces)
        if kept == 1.0:
            break
        length *= kept
    return end, forces
