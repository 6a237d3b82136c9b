"""What valves do over a time, as whoever moves the air in their chambers has to know it: values alone."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class ValveCondition:
    """Orifices, lines and chambers against those of a `ValveModel`; every array has one entry a chamber.

    Attributes
    ----------
    fill, vent : ndarray (n,)
        Factors of the sonic conductances.
    supply_pa : ndarray (n,)
        What is left of the supply [Pa gauge]; inf: all of it.
    loss_1_s : ndarray (n,)
        Part of its gauge pressure that a chamber loses a second, beside the valve.
    is_open : ndarray (n,) of 0 or 1
        Whether the valve has let go: its chamber is open to the air outside, whatever the target.
    """

    fill: Array
    vent: Array
    supply_pa: Array
    loss_1_s: Array
    is_open: Array

    def at(self, places: list[int]) -> Self:
        """Return that of some of the chambers, in this order."""
        return type(self)(*(getattr(self, field.name)[places] for field in fields(self)))


def healthy(n: int) -> ValveCondition:
    """Return the condition of `n` valves with nothing wrong."""
    one, none = np.ones(n), np.zeros(n)
    return ValveCondition(fill=one, vent=one, supply_pa=np.full(n, np.inf), loss_1_s=none, is_open=none)


@dataclass(frozen=True)
class ValveAction:
    """What valves do over a time.

    Attributes
    ----------
    spans : tuple of (float, ndarray (n,))
        Times [s], 0 or more, each with the targets [Pa gauge] that the valves' regulators hold over it.
    condition : ValveCondition
    """

    spans: tuple[tuple[float, Array], ...]
    condition: ValveCondition

    def at(self, places: list[int]) -> Self:
        """Return that of some of the chambers, in this order."""
        spans = tuple((span, target[places]) for span, target in self.spans)
        return type(self)(spans, self.condition.at(places))
