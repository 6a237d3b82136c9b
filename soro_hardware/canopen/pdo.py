"""Process data objects: pressures as counts, mapping entries, values packed into at most eight bytes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property


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
