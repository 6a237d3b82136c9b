"""Process data objects: mapping entries, and packing values into at most eight bytes."""

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
        """Bytes."""
        return sum(mapped.bits for mapped in self.objects) // 8

    def pack(self, values: tuple[int, ...]) -> bytes:
        """Values in the order of the objects, each cut to its bits."""
        word, shift = 0, 0
        for mapped, value in zip(self.objects, values, strict=True):
            word |= (value & (1 << mapped.bits) - 1) << shift
            shift += mapped.bits
        return word.to_bytes(self.length, "little")

    def unpack(self, data: bytes) -> tuple[int, ...]:
        """Raw unsigned values; the caller knows which of them are signed."""
        word, values = int.from_bytes(data, "little"), []
        for mapped in self.objects:
            values.append(word & (1 << mapped.bits) - 1)
            word >>= mapped.bits
        return tuple(values)


def signed(value: int, bits: int) -> int:
    """Two's complement of a raw value."""
    return value - (1 << bits) if value >> (bits - 1) & 1 else value
