"""Valve as application of an emulated node: CiA 408 states where it has them, scaling, limits, fail-safe."""

from __future__ import annotations

from soro_core.hardware.canopen.cia408 import (
    STATUS_CONTROL_EFFECTIVE,
    STATUS_LIMIT,
    UNIT_BAR,
    UNIT_NORMALISED,
    UNIT_PA,
    State,
    limits_of,
    next_state,
    pascal_per_count,
)
from soro_core.hardware.canopen.config import CanopenEmulation
from soro_core.hardware.canopen.device import Device
from soro_core.hardware.canopen.frames import SdoAbort
from soro_core.hardware.canopen.mapping import FixedScaling, Linear
from soro_core.hardware.emulation.air import Air
from soro_core.hardware.emulation.dictionary import ObjectDictionary, Refused

REACTION_NS = 10_000_000  # stay in FAULT_REACTION
_UNITS = {"pa": UNIT_PA, "bar": UNIT_BAR, "normalised": UNIT_NORMALISED}


class EmulatedValve:
    """One valve.

    It follows a set point only in HOLD (the hold set point), ACTIVE (that of the bus) and FAULT_HOLD; in
    every other state it vents. Without a state machine, as behind an analog coupler, it is ACTIVE while the
    node is operational. The node tells it the time by `advance` before anything that may change what it does.
    """

    def __init__(
        self, dictionary: ObjectDictionary, device: Device, channel: int, emulation: CanopenEmulation
    ) -> None:
        self.state = State.NOT_READY
        self.now_ns = 0
        self._dictionary = dictionary
        self._control = 0
        self._has_states = device.has_states
        self._after_reaction = (0, State.FAULT_DISABLED)
        self._air: tuple[Air, int] | None = None
        objects = {
            kind: device.find(kind, channel)
            for kind in (
                "setpoint",
                "reading",
                "control",
                "status",
                "hold_setpoint",
                "upper_limit",
                "lower_limit",
            )
        }
        self._keys = {kind: (o.index, o.sub) for kind, o in objects.items() if o is not None}
        reading = device.require("reading", channel)
        self._limits = limits_of(reading.bits, reading.is_signed)
        self._setpoint, self._reading = _scaling(dictionary, device, channel, emulation)
        for kind, read in (("status", self._status), ("reading", self._actual)):
            if kind in self._keys:
                dictionary.on_read[self._keys[kind]] = read
        if "control" in self._keys:
            dictionary.on_write[self._keys["control"]] = self._on_control
        dictionary.on_write[self._keys["setpoint"]] = lambda _: self.advance(self.now_ns)
        for kind in ("hold_setpoint", "upper_limit", "lower_limit"):
            if kind in self._keys:
                dictionary.on_write[self._keys[kind]] = self._on_parameter

    def connect(self, air: Air, number: int) -> None:
        """Put the air behind the registers."""
        self._air = (air, number)

    def supply_pa(self, supply_pa: float) -> float:
        """What it has left of a supply [Pa gauge]."""
        return supply_pa if self._air is None else self._air[0].supply_pa(self._air[1], supply_pa)

    def advance(self, now_ns: int) -> None:
        """Let the pressure follow up to a time."""
        self.now_ns = now_ns
        if self._air is not None:
            self._air[0].advance(now_ns)

    def demand_pa(self) -> float | None:
        """Set point that the loop follows now [Pa gauge], or None while it vents."""
        counts = self._followed()
        if counts is None:
            return None
        return (self._limited(counts) - self._setpoint.zero_count) * self._setpoint.pa_per_count

    def power_on(self) -> None:
        """Start anew: ready, venting."""
        self.advance(self.now_ns)
        self.state, self._control = State.INIT, 0
        self._stand_by()

    def power_off(self) -> None:
        """Vent while the node boots."""
        self.advance(self.now_ns)
        self.state = State.NOT_READY

    def enter_operational(self) -> None:
        """Set points can come: a valve without states follows them from now on."""
        self.advance(self.now_ns)
        if not self._has_states and self.state is State.INIT:
            self.state = State.ACTIVE

    def leave_operational(self) -> None:
        """Vent, since no set points can come; a fault stays where a command can reset it."""
        self.advance(self.now_ns)
        if self.state.is_fault and not self._has_states:
            self.state = State.INIT
        if not self.state.is_fault and self.state is not State.NOT_READY:
            self.state, self._control = State.INIT, 0
            self._stand_by()

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

    def _stand_by(self) -> None:
        """Forget the last control word, or the last set point of a valve that follows it without one."""
        key = self._keys.get("control")
        if key is not None:
            self._dictionary.values[key] = 0
        else:
            self._dictionary.values[self._keys["setpoint"]] = self._setpoint.zero_count

    def _followed(self) -> int | None:
        if self.state is State.ACTIVE:
            return self._dictionary.values[self._keys["setpoint"]]
        if self.state in (State.HOLD, State.FAULT_HOLD):
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
        self.advance(self.now_ns)
        self.state = next_state(self.state, word, self._control)
        self._control = word

    def _on_parameter(self, _: int) -> None:
        if self.state is not State.INIT:
            raise Refused(SdoAbort.DEVICE_STATE)


def _scaling(
    dictionary: ObjectDictionary, device: Device, channel: int, emulation: CanopenEmulation
) -> tuple[Linear, Linear]:
    """Counts of set point and reading; units that the device tells are put into its dictionary."""
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
