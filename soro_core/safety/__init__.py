"""The limiter, the watchdogs, the monitors and the latch: the one place that every command passes.

Everything is a pure function of a frozen state: `offer` takes a command in, `cycle` gives the set points of
the next exchange with the regulators, `request_vent` and `reset` are what a person asks for. Once tripped the
state is latched: it answers zero set points and `vented` until `reset` is called with a zero command. A
`Limiter` holds the state for a loop.
"""

from soro_core.safety.limiter import (
    SafetyState,
    cycle,
    initial_state,
    interpolated,
    offer,
    request_vent,
    reset,
)
from soro_core.safety.limits import HARD_LIMIT_PA, Limits, Monitors, Rating, check_rating, for_regulators
from soro_core.safety.remembered import MonitorState
from soro_core.safety.stateful import Limiter

__all__ = [
    "HARD_LIMIT_PA",
    "Limiter",
    "Limits",
    "MonitorState",
    "Monitors",
    "Rating",
    "SafetyState",
    "check_rating",
    "cycle",
    "for_regulators",
    "initial_state",
    "interpolated",
    "offer",
    "request_vent",
    "reset",
]
