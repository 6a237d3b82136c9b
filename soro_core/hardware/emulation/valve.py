"""A CiA 408 pressure valve as application of an emulated node: state machine, scaling, limits, fail-safe."""

from __future__ import annotations

from soro_core.hardware.canopen.cia408 import (
    ACTUAL,
    CONTROL_WORD,
    HOLD_SETPOINT,
    LOWER_LIMIT,
    SETPOINT,
    STATUS_CONTROL_EFFECTIVE,
    STATUS_LIMIT,
    STATUS_WORD,
    UNIT_BAR,
    UNIT_NORMALISED,
    UNIT_PA,
    UPPER_LIMIT,
    State,
    next_state,
    pascal_per_count,
)
from soro_core.hardware.canopen.frames import SdoAbort
from soro_core.hardware.emulation.air import Air
from soro_core.hardware.emulation.dictionary import ObjectDictionary, Refused
from soro_core.hardware.platform import Emulation

REACTION_NS = 10_000_000  # stay in FAULT_REACTION
_UNITS = {"pa": UNIT_PA, "bar": UNIT_BAR, "normalised": UNIT_NORMALISED}


class EmulatedValve:
    """One valve.

    It follows a set point only in HOLD (object 6394), ACTIVE (6380) and FAULT_HOLD (6394); in every other
    state it vents. The node tells it the time by `advance` before anything that may change what it does.
    """

    def __init__(self, dictionary: ObjectDictionary, emulation: Emulation) -> None:
        self.state = State.NOT_READY
        self.now_ns = 0
        self._dictionary = dictionary
        self._control = 0
        self._after_reaction = (0, State.FAULT_DISABLED)
        self._air: tuple[Air, int] | None = None
        unit = _UNITS[emulation.pressure_unit]
        prefix = emulation.pressure_prefix if unit else 0
        self._scale = pascal_per_count(unit, prefix, emulation.full_scale_pa)
        for index in (SETPOINT, ACTUAL):
            dictionary.override(index, 2, unit)
            dictionary.override(index, 3, prefix)
        dictionary.on_read[STATUS_WORD, 0] = self._status
        dictionary.on_read[ACTUAL, 1] = self._actual
        dictionary.on_write[CONTROL_WORD, 0] = self._on_control
        dictionary.on_write[SETPOINT, 1] = lambda _: self.advance(self.now_ns)
        for index in (HOLD_SETPOINT, UPPER_LIMIT, LOWER_LIMIT):
            dictionary.on_write[index, 1] = self._on_parameter

    def connect(self, air: Air, number: int) -> None:
        """Put the air behind the registers."""
        self._air = (air, number)

    def advance(self, now_ns: int) -> None:
        """Let the pressure follow up to a time."""
        self.now_ns = now_ns
        if self._air is not None:
            self._air[0].advance(now_ns)

    def demand_pa(self) -> float | None:
        """Set point that the loop follows now [Pa gauge], or None while it vents."""
        counts = self._followed()
        return None if counts is None else self._limited(counts) * self._scale

    def power_on(self) -> None:
        """Start anew: ready, venting."""
        self.advance(self.now_ns)
        self.state, self._control = State.INIT, 0

    def power_off(self) -> None:
        """Vent while the node boots."""
        self.advance(self.now_ns)
        self.state = State.NOT_READY

    def leave_operational(self) -> None:
        """Vent, since no set points can come; a fault stays."""
        self.advance(self.now_ns)
        if not self.state.is_fault and self.state is not State.NOT_READY:
            self.state, self._control = State.INIT, 0
            self._dictionary.values[CONTROL_WORD, 0] = 0

    def fault(self, end: State) -> bool:
        """Enter FAULT_REACTION, and `end` after it; False if there is a fault already."""
        if self.state.is_fault or self.state is State.NOT_READY:
            return False
        self.advance(self.now_ns)
        self.state, self._after_reaction = State.FAULT_REACTION, (self.now_ns + REACTION_NS, end)
        return True

    def poll(self, now_ns: int) -> None:
        """End the fault reaction when its time is over."""
        self.advance(now_ns)
        due_ns, end = self._after_reaction
        if self.state is State.FAULT_REACTION and now_ns >= due_ns:
            self.state = end

    def _followed(self) -> int | None:
        values = self._dictionary.values
        if self.state is State.ACTIVE:
            return values[SETPOINT, 1]
        if self.state in (State.HOLD, State.FAULT_HOLD):
            return values[HOLD_SETPOINT, 1]
        return None

    def _limited(self, counts: int) -> int:
        values = self._dictionary.values
        return max(min(counts, values[UPPER_LIMIT, 1]), values[LOWER_LIMIT, 1])

    def _status(self) -> int:
        counts, status = self._followed(), self.state.bits
        if counts is not None:
            status |= STATUS_CONTROL_EFFECTIVE
            status |= STATUS_LIMIT if self._limited(counts) != counts else 0
        return status

    def _actual(self) -> int:
        if self._air is None:
            return 0
        air, number = self._air
        return max(min(round(air.reading_pa(number) / self._scale), 32767), -32768)

    def _on_control(self, word: int) -> None:
        self.advance(self.now_ns)
        self.state = next_state(self.state, word, self._control)
        self._control = word

    def _on_parameter(self, _: int) -> None:
        if self.state is not State.INIT:
            raise Refused(SdoAbort.DEVICE_STATE)
