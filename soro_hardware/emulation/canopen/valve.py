"""Valve of an emulated node: CiA 408 states if it has them, scaling, limits, fail-safe."""

from __future__ import annotations

from collections.abc import Callable

from soro_hardware.canopen.cia408 import (
    STATUS_CONTROL_EFFECTIVE,
    STATUS_LIMIT,
    UNIT_BAR,
    UNIT_NORMALISED,
    UNIT_PA,
    ValveState,
    limits_of,
    next_state,
    pascal_per_count,
)
from soro_hardware.canopen.config import CanopenEmulation
from soro_hardware.canopen.device import Device
from soro_hardware.canopen.mapping import FixedScaling, Linear
from soro_hardware.canopen.sdo_frames import SdoAbort
from soro_hardware.emulation.air import EmulatedPressures
from soro_hardware.emulation.canopen.dictionary import ObjectDictionary, Refused

REACTION_NS = 10_000_000  # duration of FAULT_REACTION [ns]
_LIMITS = ("upper_limit", "lower_limit")
_KINDS = ("setpoint", "reading", "control", "status", "hold_setpoint", *_LIMITS)
_UNITS = {"pa": UNIT_PA, "bar": UNIT_BAR, "normalised": UNIT_NORMALISED}


class EmulatedValve:
    """One valve.

    The valve follows the set point of the bus in ACTIVE, and the hold set point in HOLD and FAULT_HOLD. In
    all other states it vents. A valve without states, as behind an analog coupler, is ACTIVE while the node
    is OPERATIONAL. `advance` precedes every change of the valve.

    Parameters
    ----------
    dictionary : ObjectDictionary
        Objects of the node.
    device : Device
        EDS and mapping of the node.
    channel : int
        Number of the valve in the node.
    emulation : CanopenEmulation
        Behaviour of the emulated device.
    now : callable
        Returns the emulated time [ns].
    """

    def __init__(
        self,
        dictionary: ObjectDictionary,
        device: Device,
        channel: int,
        emulation: CanopenEmulation,
        now: Callable[[], int],
    ) -> None:
        self.state = ValveState.NOT_READY
        self._dictionary, self._now = dictionary, now
        self._control = 0
        self._wake_pa = emulation.wake_pa
        self._has_states = device.has_states
        self._after_reaction = (0, ValveState.FAULT_DISABLED)
        self._air: tuple[EmulatedPressures, int] | None = None
        objects = ((kind, device.find(kind, channel)) for kind in _KINDS)
        self._keys = {kind: (found.index, found.sub) for kind, found in objects if found is not None}
        reading = device.require("reading", channel)
        self._limits = limits_of(reading.bits, reading.is_signed)
        self._setpoint, self._reading = _scaling(dictionary, device, channel, emulation)
        reads = {"status": self._status, "reading": self._actual}
        dictionary.on_read |= {self._keys[kind]: read for kind, read in reads.items() if kind in self._keys}
        writes = {"control": self._on_control, "setpoint": lambda _: self.advance()}
        writes |= dict.fromkeys(("hold_setpoint", *_LIMITS), self._on_parameter)
        dictionary.on_write |= {
            self._keys[kind]: write for kind, write in writes.items() if kind in self._keys
        }

    def connect(self, air: EmulatedPressures, number: int) -> None:
        """Connect the valve to its air, given its number there."""
        self._air = (air, number)

    def supply_pa(self, supply_pa: float) -> float:
        """Return the supply pressure [Pa gauge] at this valve, with its faults."""
        return supply_pa if self._air is None else self._air[0].supply_pa(self._air[1], supply_pa)

    def advance(self) -> None:
        """Advance the pressure to the present."""
        if self._air is not None:
            self._air[0].advance(self._now())

    def demand_pa(self) -> float | None:
        """Return the set point [Pa gauge] that the valve follows, or None while it vents."""
        counts = self._followed()
        if counts is None:
            return None
        return (self._limited(counts) - self._setpoint.zero_count) * self._setpoint.pa_per_count

    def power_on(self) -> None:
        """Enter INIT, in which the valve vents."""
        self.advance()
        self.state, self._control = ValveState.INIT, 0
        self._stand_by()
        if self._wake_pa is not None:
            self.give(self._wake_pa, "setpoint", "hold_setpoint")

    def give(self, pressure_pa: float, *kinds: str) -> None:
        """Set some objects to a pressure [Pa gauge], as the front panel does."""
        self.advance()
        counts = round(pressure_pa / self._setpoint.pa_per_count) + self._setpoint.zero_count
        for kind in kinds:
            if kind in self._keys:
                self._dictionary.values[self._keys[kind]] = counts

    def power_off(self) -> None:
        """Vent while the node boots."""
        self.advance()
        self.state = ValveState.NOT_READY

    def enter_operational(self) -> None:
        """Activate a valve without states."""
        self.advance()
        if not self._has_states and self.state is ValveState.INIT:
            self.state = ValveState.ACTIVE

    def leave_operational(self) -> None:
        """Vent; a fault stays in a valve with states, where a command can reset it."""
        self.advance()
        if self.state.is_fault and not self._has_states:
            self.state = ValveState.INIT
        if not self.state.is_fault and self.state not in (ValveState.NOT_READY, ValveState.INIT):
            self.state, self._control = ValveState.INIT, 0
            self._stand_by()

    def fault(self, end: ValveState) -> bool:
        """Enter FAULT_REACTION, and `end` after it; return False if the valve already has a fault."""
        if self.state.is_fault or self.state is ValveState.NOT_READY:
            return False
        self.advance()
        self.state, self._after_reaction = ValveState.FAULT_REACTION, (self._now() + REACTION_NS, end)
        return True

    def poll(self) -> None:
        """End FAULT_REACTION when its time is over."""
        self.advance()
        due_ns, end = self._after_reaction
        if self.state is ValveState.FAULT_REACTION and self._now() >= due_ns:
            self.state = end

    def _stand_by(self) -> None:
        """Reset the control word, or the set point of a valve without control word."""
        key = self._keys.get("control")
        if key is not None:
            self._dictionary.values[key] = 0
        else:
            self._dictionary.values[self._keys["setpoint"]] = self._setpoint.zero_count

    def _followed(self) -> int | None:
        if self.state is ValveState.ACTIVE:
            return self._dictionary.values[self._keys["setpoint"]]
        if self.state in (ValveState.HOLD, ValveState.FAULT_HOLD):
            return self._value("hold_setpoint", self._setpoint.zero_count)
        return None

    def _limited(self, counts: int) -> int:
        return max(min(counts, self._value("upper_limit", counts)), self._value("lower_limit", counts))

    def _value(self, kind: str, otherwise: int) -> int:
        key = self._keys.get(kind)
        return otherwise if key is None else self._dictionary.values[key]

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
        counts = round(air.reading_pa(number) / self._reading.pa_per_count) + self._reading.zero_count
        return max(min(counts, self._limits[1]), self._limits[0])

    def _on_control(self, word: int) -> None:
        self.advance()
        self.state = next_state(self.state, word, self._control)
        self._control = word

    def _on_parameter(self, _: int) -> None:
        if self.state is not ValveState.INIT:
            raise Refused(SdoAbort.DEVICE_STATE)


def _scaling(
    dictionary: ObjectDictionary, device: Device, channel: int, emulation: CanopenEmulation
) -> tuple[Linear, Linear]:
    """Return the scales of set point and reading, and store the units in the dictionary."""
    fixed = device.mapping.scaling
    if isinstance(fixed, FixedScaling):
        return fixed.setpoint, fixed.reading
    unit = _UNITS[emulation.pressure_unit]
    prefix = emulation.pressure_prefix if unit else 0
    for kind in ("setpoint", "reading"):
        index = device.require(kind, channel).index
        dictionary.override(index, 2, unit)
        dictionary.override(index, 3, prefix)
    scale = Linear(pa_per_count=pascal_per_count(unit, prefix, emulation.full_scale_pa))
    return scale, scale
