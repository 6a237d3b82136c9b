"""Process data objects: pressures as counts, mapping entries, values packed into at most eight bytes."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Mapped:
    """One mapped object."""

    index: int
    sub: int
    bits: int

    @property
    def entry(self) -> int:
        """As the mapping object stores it: index << 16 | sub << 8 | bits."""
        return self.index << 16 | self.sub << 8 | self.bits

    @classmethod
    def from_entry(cls, entry: int) -> Mapped:
        """The reverse of `entry`."""
        return cls(entry >> 16, entry >> 8 & 0xFF, entry & 0xFF)


@dataclass(frozen=True)
class PdoLayout:
    """Order of the objects in a PDO."""

    objects: tuple[Mapped, ...]

    @property
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
        """Return the values, all unsigned; the caller converts signed ones."""
        word, values = int.from_bytes(data, "little"), []
        for mapped in self.objects:
            values.append(word & (1 << mapped.bits) - 1)
            word >>= mapped.bits
        return tuple(values)


def signed(value: int, bits: int) -> int:
    """Return the signed value of an unsigned one, by two's complement."""
    return value - (1 << bits) if value >> (bits - 1) & 1 else value


@dataclass(frozen=True)
class Scaling:
    """Scales of a regulator: pressure per count [Pa] of set point and reading, and allowed counts."""

    setpoint_pa: float
    actual_pa: float
    low: int
    high: int
    setpoint_zero: int = 0
    actual_zero: int = 0

    def counts(self, setpoint_pa: float) -> int:
        """Return the nearest allowed count of a set point [Pa gauge]."""
        count = round(setpoint_pa / self.setpoint_pa) + self.setpoint_zero
        return min(max(count, self.low), self.high)

    def sent_pa(self, counts: int) -> float:
        """Return the pressure of a set point in counts [Pa gauge]."""
        return (counts - self.setpoint_zero) * self.setpoint_pa

    def read_pa(self, counts: int) -> float:
        """Return the pressure of a reading in counts [Pa gauge]."""
        return (counts - self.actual_zero) * self.actual_pa
