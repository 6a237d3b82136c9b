"""Description of a device: the mapping of a platform with sizes and signs from the EDS, validated."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from functools import cached_property

from soro_core.errors import ConfigError
from soro_hardware.canopen.cia408 import (
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
from soro_hardware.canopen.config import CanopenPlatform
from soro_hardware.canopen.eds import Key, ObjectEntry, read_eds
from soro_hardware.canopen.frames import RPDO_BASES, TPDO_BASES
from soro_hardware.canopen.mapping import DeviceMapping, ObjectAddress, ObjectValue, PdoMapping, slot


@dataclass(frozen=True)
class Mapped:
    """One mapped object."""

    index: int
    sub: int
    bits: int
    is_signed: bool = False  # not part of `entry`

    @property
    def entry(self) -> int:
        """As the mapping object stores it: index << 16 | sub << 8 | bits."""
        return self.index << 16 | self.sub << 8 | self.bits

    @classmethod
    def from_entry(cls, entry: int) -> Mapped:
        """The reverse of `entry`, without the sign."""
        return cls(entry >> 16, entry >> 8 & 0xFF, entry & 0xFF)


@dataclass(frozen=True)
class PdoLayout:
    """Order of the objects in a PDO."""

    objects: tuple[Mapped, ...]

    @cached_property
    def length(self) -> int:
        """Length in bytes."""
        return sum(mapped.bits for mapped in self.objects) // 8

    def pack(self, values: tuple[int, ...]) -> bytes:
        """Return the bytes of values in the order of the objects, each reduced to its bits."""
        word, shift = 0, 0
        for mapped, value in zip(self.objects, values, strict=True):
            word |= (value & (1 << mapped.bits) - 1) << shift
            shift += mapped.bits
        return word.to_bytes(self.length, "little")

    def unpack(self, data: bytes) -> tuple[int, ...]:
        """Return the values; those of signed objects by two's complement."""
        word, values = int.from_bytes(data, "little"), []
        for mapped in self.objects:
            value = word & (1 << mapped.bits) - 1
            is_negative = mapped.is_signed and value >> (mapped.bits - 1)
            values.append(value - (1 << mapped.bits) if is_negative else value)
            word >>= mapped.bits
        return tuple(values)


@dataclass(frozen=True)
class Scaling:
    """Scales of a regulator: pressure per count [Pa] of set point and reading, and allowed counts."""

    setpoint_pa: float
    actual_pa: float
    low: int
    high: int
    setpoint_zero: int = 0
    actual_zero: int = 0

    def rounded(self, setpoint_pa: float) -> tuple[int, float]:
        """Return the nearest allowed count of a set point [Pa gauge], and the pressure of this count."""
        count = round(setpoint_pa / self.setpoint_pa) + self.setpoint_zero
        count = min(max(count, self.low), self.high)
        return count, (count - self.setpoint_zero) * self.setpoint_pa

    def read_pa(self, counts: int) -> float:
        """Return the pressure of a reading in counts [Pa gauge]."""
        return (counts - self.actual_zero) * self.actual_pa


_DEADLINE = 5  # sub-object of an RPDO's communication record


@dataclass(frozen=True)
class Object:
    """One object of the device, with its size and sign."""

    index: int
    sub: int
    bits: int
    is_signed: bool

    @property
    def size(self) -> int:
        """Size in bytes."""
        return self.bits // 8


@dataclass(frozen=True)
class PdoEntry:
    """One entry of a PDO; `kind` as in `mapping.slot`."""

    kind: str
    channel: int
    value: int


@dataclass(frozen=True)
class Pdo:
    """One PDO of the device; all nodes have the same."""

    number: int
    slots: tuple[PdoEntry, ...]
    layout: PdoLayout
    event: bool
    fixed: bool
    receive: bool

    @cached_property
    def cyclic(self) -> bool:
        """Whether the PDO has set points or readings, and so is sent in every cycle."""
        return any(s.kind in ("setpoint", "reading") for s in self.slots)

    @property
    def on_change(self) -> bool:
        """Whether a PDO sent by event is sent at each change of a value, not only periodically."""
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
    """One kind of device: its mapping, and objects and PDOs from its EDS."""

    mapping: DeviceMapping
    entries: dict[Key, ObjectEntry]
    rpdos: tuple[Pdo, ...]
    tpdos: tuple[Pdo, ...]

    @property
    def has_states(self) -> bool:
        """Whether the device has the CiA 408 state machine."""
        return self.mapping.control is not None

    @property
    def is_guarded(self) -> bool:
        """Whether host and device use node guarding in place of heartbeats."""
        return self.mapping.guarding

    @property
    def has_producer(self) -> bool:
        """Whether the device sends heartbeats."""
        return (PRODUCER_HEARTBEAT, 0) in self.entries and not self.is_guarded

    @property
    def has_consumer(self) -> bool:
        """Whether the device watches the host's heartbeat."""
        return (CONSUMER_HEARTBEAT, 1) in self.entries and not self.is_guarded

    @property
    def has_sync_period(self) -> bool:
        """Whether the device has an object for the period of SYNC, and so may watch SYNC."""
        return (CYCLE_PERIOD, 0) in self.entries

    def has_deadline(self, pdo: Pdo) -> bool:
        """Return whether the device watches the time between two set points."""
        return (pdo.communication, _DEADLINE) in self.entries

    @property
    def has_watchdog(self) -> bool:
        """Whether the device vents by itself when messages of the host stop."""
        return (
            self.has_consumer
            or self.is_guarded
            or any(self.has_deadline(pdo) for pdo in self.rpdos if pdo.cyclic)
        )

    def find(self, kind: str, channel: int) -> Object | None:
        """Return the object of one channel (setpoint, reading, control, status, ...) or supply, or None."""
        address = self.mapping.address(kind, channel)
        return None if address is None else self.object(address)

    def require(self, kind: str, channel: int) -> Object:
        """Return an object as `find`; raises `ConfigError` if the mapping has none."""
        found = self.find(kind, channel)
        if found is None:
            raise ConfigError("canopen.mapping", kind, "nothing", "the object's index and sub-index")
        return found

    def object(self, address: ObjectAddress) -> Object:
        """Return an object with size and sign."""
        entry = self.entries[address.index, address.sub]
        return Object(address.index, address.sub, entry.bits, entry.is_signed)


@functools.lru_cache(maxsize=8)
def describe(mapping: DeviceMapping) -> Device:
    """Combine a mapping with its EDS.

    Raises
    ------
    ConfigError
        If the EDS lacks an object or forbids its mapping, or a PDO is longer than 8 bytes.
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
    if mapping.temperature is not None:
        _check(mapping, entries, "temperature", mapping.temperature, writable=False)
    for setting in mapping.settings:
        for channel in range(mapping.channels):
            _check(mapping, entries, "settings", mapping.of_channel(setting, channel), writable=True)
    return Device(
        mapping,
        entries,
        tuple(_pdo(mapping, entries, pdo, receive=True) for pdo in mapping.rpdos),
        tuple(_pdo(mapping, entries, pdo, receive=False) for pdo in mapping.tpdos),
    )


def check_sync_period(platform: CanopenPlatform) -> None:
    """Check that the EDS has an object for the period of SYNC, if the platform states one.

    Raises
    ------
    ConfigError
        If it has none.
    """
    mapping, period_s = platform.canopen.mapping, platform.canopen.sync_period_s
    if period_s is not None and not describe(mapping).has_sync_period:
        raise ConfigError(
            "canopen", "sync_period_s", period_s, f"nothing: {mapping.eds_path.name} has no object 1006"
        )


def _check(
    mapping: DeviceMapping, entries: dict[Key, ObjectEntry], key: str, address: ObjectAddress, writable: bool
) -> ObjectEntry:
    entry = entries.get((address.index, address.sub))
    if entry is None or not (entry.writable if writable else entry.readable):
        what = f"{address.index:04X}:{address.sub}"
        allowed = f"an object that {mapping.eds_path.name} has as {'writable' if writable else 'readable'}"
        raise ConfigError("canopen.mapping", key, what, allowed)
    return entry


def _pdo(mapping: DeviceMapping, entries: dict[Key, ObjectEntry], given: PdoMapping, receive: bool) -> Pdo:
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
        objects.append(Mapped(address.index, address.sub, entry.bits, entry.is_signed))
        value = item.value if isinstance(item, ObjectValue) else 0
        slots.append(PdoEntry(kind, channel, value))
    layout = PdoLayout(tuple(objects))
    pdo = Pdo(given.number, tuple(slots), layout, given.transmission == "event", given.fixed, receive)
    if layout.length > 8:
        raise ConfigError("canopen.mapping", key, f"{layout.length} bytes", "at most 8 bytes in a PDO")
    if (pdo.communication, 1) not in entries:
        allowed = f"a PDO that {mapping.eds_path.name} has ({pdo.communication:04X})"
        raise ConfigError("canopen.mapping", key, f"PDO {given.number}", allowed)
    return pdo
