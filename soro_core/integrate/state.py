"""State of an arm in time, and the status of a step."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from soro_core.arrays import Array


@dataclass(frozen=True)
class State:
    """State of an arm.

    Attributes
    ----------
    q, qd : ndarray (n_q,)
        Coordinates and their rates [1/s].
    internal : ndarray (n_internal,)
        States of creep and hysteresis; behind valves, mass [kg] and volume [m^3] of the air in each chamber
        follow, (2 n_u,).
    """

    q: Array
    qd: Array
    internal: Array = field(default_factory=lambda: np.zeros(0))


class Status(str):
    """Result of a step: the text ``ok``, or one line with the failure, its time, and a remedy.

    A string with a property: ``status.ok``, ``status == "ok"``, ``print(status)``.
    """

    __slots__ = ()

    @property
    def ok(self) -> bool:
        """Whether nothing failed."""
        return str(self) == "ok"

    @property
    def message(self) -> str:
        """The text."""
        return str(self)


OK = Status("ok")
