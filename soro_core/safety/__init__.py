"""The limiter, the watchdogs, the monitors and the latch: the one place that every command passes.

Everything is a pure function of a frozen state. A cycle is `offer` for each command that has come, `slew`,
which gives the set points that the exchange with the regulators sends, and `judge`, which takes the readings
of that exchange; a person asks for `request_vent` and `reset`. Once tripped the state is latched: it answers
zero set points and `vented` until `reset` is called with a zero command. A `Limiter` holds the state for a
loop.
"""

from soro_core.safety.limiter import (
    doubt,
    interpolated,
    judge,
    offer,
    request_vent,
    reset,
    slew,
)
from soro_core.safety.limits import (
    HARD_LIMIT_PA,
    Limits,
    Monitors,
    Rating,
    check_rating,
    for_regulators,
    narrowed,
    rating_of,
    trips_above,
    usable_range,
)
from soro_core.safety.monitor_state import MonitorState
from soro_core.safety.names import Names, note_message
from soro_core.safety.state import SafetyState, initial_state, parts_of
from soro_core.safety.stateful import ArmLimiter, Limiter
from soro_core.safety.stop import StopState, hear, why_stopped

__all__ = [
    "HARD_LIMIT_PA",
    "ArmLimiter",
    "Limiter",
    "Limits",
    "MonitorState",
    "Monitors",
    "Names",
    "Rating",
    "SafetyState",
    "StopState",
    "check_rating",
    "doubt",
    "for_regulators",
    "hear",
    "initial_state",
    "interpolated",
    "judge",
    "narrowed",
    "note_message",
    "offer",
    "parts_of",
    "rating_of",
    "request_vent",
    "reset",
    "slew",
    "trips_above",
    "usable_range",
    "why_stopped",
]
