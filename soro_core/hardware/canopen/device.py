"""A device as the driver uses it: the mapping of a platform, with sizes and signs from the EDS, checked."""

from __future__ import annotations

import functools
from dataclasses import dataclass

from soro_core.errors import ConfigError
from soro_core.hardware.canopen.cia408 import (
    CONSUMER_HEARTBEAT,
    CYCLE_PERIOD,
    GUARD_TIME,
    LIFE_TIME_FACTOR,
    PRODUCER_HEARTBEAT,
    RPDO_COMMUNICATION,
    RPDO_MAPPING,
    TPDO_COMMUNICATION,
    TPDO_MAPPING,
)
from soro_core.hardware.canopen.eds import Entry, Key, read_eds
from soro_core.hardware.canopen.frames import RPDO_BASES, TPDO_BASES
from soro_core.hardware.canopen.mapping import DeviceMapping, ObjectAddress, PdoMapping, Setting, slot
from soro_core.hardware.canopen.pdo import Mapped, PdoLayout

_DEADLINE = 5  # sub-object of an RPDO's communication record


@dataclass(frozen=True)
class Object:
    """One object with its size in the device."""

    index: int
    sub: int
    bits: int
    is_signed: bool

    @property
    def size(self) -> int:
        """Bytes."""
        return self.bits // 8


@dataclass(frozen=True)
class Slot:
    """One place of a PDO and its `kind`, as `mapping.slot` names it."""

    kind: str
    channel: int
    value: int
    is_signed: bool


@dataclass(frozen=True)
class Pdo:
    """One PDO of the device, the same in every node."""

    number: int
    slots: tuple[Slot, ...]
    layout: PdoLayout
    event: bool
    fixed: bool
    receive: bool

    @property
    def cyclic(self) -> bool:
        """Whether it carries set points or readings; control and status words alone need no cycle."""
        return any(s.kind in ("setpoint", "reading") for s in self.slots)

    @property
    def on_change(self) -> bool:
        """Whether it goes out as soon as a value changes, if by event; others only from time to time."""
        return any(s.kind == "status" for s in self.slots)

    @property
    def communication(self) -> int:
        """Index of the communication record."""
        return (RPDO_COMMUNICATION if self.receive else TPDO_COMMUNICATION) + self.number - 1

    @property
    def mapping(self) -> int:
        """Index of the mapping record."""
        return (RPDO_MAPPING if self.receive else TPDO_MAPPING) + self.number - 1

    def cob_id(self, node: int) -> int:
        """Predefined identifier."""
        return (RPDO_BASES if self.receive else TPDO_BASES)[self.number - 1] + node


@dataclass(frozen=True)
class Device:
    """What the driver, the emulation and the doctor know of a kind of device."""

    mapping: DeviceMapping
    entries: dict[Key, Entry]
    rpdos: tuple[Pdo, ...]
    tpdos: tuple[Pdo, ...]

    @property
    def has_states(self) -> bool:
        """Whether it has the CiA 408 state machine."""
        return self.mapping.control is not None

    @property
    def is_guarded(self) -> bool:
        """Whether host and device watch each other by node guarding, so not by heartbeats."""
        return self.mapping.guarding

    @property
    def has_producer(self) -> bool:
        """Whether it sends heartbeats."""
        return (PRODUCER_HEARTBEAT, 0) in self.entries and not self.is_guarded

    @property
    def has_consumer(self) -> bool:
        """Whether it watches the host's heartbeat."""
        return (CONSUMER_HEARTBEAT, 1) in self.entries and not self.is_guarded

    @property
    def has_cycle_period(self) -> bool:
        """Whether it wants to know the period of SYNC."""
        return (CYCLE_PERIOD, 0) in self.entries

    def has_deadline(self, pdo: Pdo) -> bool:
        """Whether it watches the time between two set points."""
        return (pdo.communication, _DEADLINE) in self.entries

    @property
    def has_watchdog(self) -> bool:
        """Whether it vents by itself when the host falls silent."""
        return (
            self.has_consumer
            or self.is_guarded
            or any(self.has_deadline(pdo) for pdo in self.rpdos if pdo.cyclic)
        )

    def find(self, kind: str, channel: int) -> Object | None:
        """Object of one channel (setpoint, reading, control, status, ...), or supply; None without it."""
        address = self.mapping.address(kind, channel)
        return None if address is None else self.object(address)

    def require(self, kind: str, channel: int) -> Object:
        """The same where the mapping must have it."""
        found = self.find(kind, channel)
        if found is None:
            raise ConfigError("canopen.mapping", kind, "nothing", "the object's index and sub-index")
        return found

    def object(self, address: ObjectAddress) -> Object:
        """Object with size and sign."""
        entry = self.entries[address.index, address.sub]
        return Object(address.index, address.sub, entry.bits, entry.is_signed)


@functools.lru_cache(maxsize=8)
def describe(mapping: DeviceMapping) -> Device:
    """Lay a mapping over its EDS.

    Raises
    ------
    ConfigError
        If the EDS lacks an object, says that it cannot be mapped, or a PDO gets longer than 8 bytes.
    """
    entries = read_eds(mapping.eds_path, 1)
    for kind, writable in (
        ("setpoint", True),
        ("reading", False),
        ("control", True),
        ("status", False),
        ("hold_setpoint", True),
        ("upper_limit", True),
        ("lower_limit", True),
    ):
        for channel in range(mapping.channels):
            address = mapping.address(kind, channel)
            if address is not None:
                _check(mapping, entries, kind, address, writable)
    for index in (GUARD_TIME, LIFE_TIME_FACTOR) if mapping.guarding else ():
        _check(mapping, entries, "guarding", ObjectAddress(index=index), writable=True)
    if mapping.supply is not None:
        _check(mapping, entries, "supply", mapping.supply, writable=False)
    for setting in mapping.settings:
        for channel in range(mapping.channels):
            _check(mapping, entries, "settings", mapping.of_channel(setting, channel), writable=True)
    return Device(
        mapping,
        entries,
        tuple(_pdo(mapping, entries, pdo, receive=True) for pdo in mapping.rpdos),
        tuple(_pdo(mapping, entries, pdo, receive=False) for pdo in mapping.tpdos),
    )


def _check(
    mapping: DeviceMapping, entries: dict[Key, Entry], key: str, address: ObjectAddress, writable: bool
) -> Entry:
    entry = entries.get((address.index, address.sub))
    if entry is None or not (entry.writable if writable else entry.readable):
        what = f"{address.index:04X}:{address.sub}"
        allowed = f"an object that {mapping.eds_path.name} has as {'writable' if writable else 'readable'}"
        raise ConfigError("canopen.mapping", key, what, allowed)
    return entry


def _pdo(mapping: DeviceMapping, entries: dict[Key, Entry], given: PdoMapping, receive: bool) -> Pdo:
    key = f"{'rpdos' if receive else 'tpdos'}[number {given.number}]"
    objects, slots = [], []
    for item in given.entries:
        kind, channel = slot(item)
        address = item if isinstance(item, ObjectAddress) else mapping.address(kind, channel)
        assert address is not None, "a mapping has an address for each of its entries"
        entry = _check(mapping, entries, key, address, writable=receive)
        if not entry.mappable:
            allowed = f"an object that {mapping.eds_path.name} has as mappable"
            raise ConfigError("canopen.mapping", key, f"{address.index:04X}:{address.sub}", allowed)
        objects.append(Mapped(address.index, address.sub, entry.bits))
        value = item.value if isinstance(item, Setting) else 0
        slots.append(Slot(kind, channel, value, entry.is_signed))
    layout = PdoLayout(tuple(objects))
    pdo = Pdo(given.number, tuple(slots), layout, given.transmission == "event", given.fixed, receive)
    if layout.length > 8:
        raise ConfigError("canopen.mapping", key, f"{layout.length} bytes", "at most 8 bytes in a PDO")
    if (pdo.communication, 1) not in entries:
        allowed = f"a PDO that {mapping.eds_path.name} has ({pdo.communication:04X})"
        raise ConfigError("canopen.mapping", key, f"PDO {given.number}", allowed)
    return pdo
