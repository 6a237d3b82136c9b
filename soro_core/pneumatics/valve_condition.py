"""Condition and action of valves, the inputs of the air in the chambers."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from soro_core.arrays import Array


@dataclass(frozen=True)
class ValveCondition:
    """Faults of valves, lines and chambers, relative to a `ValveModel`.

    Attributes
    ----------
    fill, vent : ndarray (n,)
        Factors of the sonic conductances.
    supply_pa : ndarray (n,)
        Pressure that is left of the supply [Pa gauge]; inf for the whole.
    loss_1_s : ndarray (n,)
        Rate at which a chamber loses its gauge pressure through a leak beside the valve [1/s].
    is_open : ndarray (n,) of 0 or 1
        1 if the valve has failed open: its chamber is open to the air outside for every target.
    """

    fill: Array
    vent: Array
    supply_pa: Array
    loss_1_s: Array
    is_open: Array

    def at(self, places: list[int]) -> Self:
        """Return the same for some of the chambers, in this order."""
        return type(self)(*(getattr(self, field.name)[places] for field in fields(self)))


def healthy(n: int) -> ValveCondition:
    """Return the condition of `n` valves without faults."""
    one, none = np.ones(n), np.zeros(n)
    return ValveCondition(fill=one, vent=one, supply_pa=np.full(n, np.inf), loss_1_s=none, is_open=none)


@dataclass(frozen=True)
class ValveAction:
    """Targets and condition of valves over a time.

    Attributes
    ----------
    spans : tuple of (float, ndarray (n,))
        Times [s], 0 or more, each with the targets [Pa gauge] that the valves' regulators hold over it.
    condition : ValveCondition
        Faults over this time.
    """

    spans: tuple[tuple[float, Array], ...]
    condition: ValveCondition

    def at(self, places: list[int]) -> Self:
        """Return the same for some of the chambers, in this order."""
        spans = tuple((span, target[places]) for span, target in self.spans)
        return type(self)(spans, self.condition.at(places))
