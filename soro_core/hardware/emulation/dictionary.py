"""Object dictionary of an emulated node, built from an EDS file, with the checks that an SDO server makes."""

from __future__ import annotations

from collections.abc import Callable

from soro_core.hardware.canopen.eds import Entry, Key
from soro_core.hardware.canopen.frames import SdoAbort


class Refused(Exception):  # noqa: N818 - it is an answer of the protocol, not an error of the program
    """An access is refused with an SDO abort code."""

    def __init__(self, code: SdoAbort) -> None:
        self.code = code
        super().__init__(code.name)


class ObjectDictionary:
    """Values of one node.

    `on_read` gives values that are measured when they are read; `on_write` checks and acts on a value before
    it is stored, and may raise `Refused`.
    """

    def __init__(self, entries: dict[Key, Entry]) -> None:
        self.entries = entries
        self.values = {key: entry.default for key, entry in entries.items()}
        self.overrides: dict[Key, int] = {}
        self.on_read: dict[Key, Callable[[], int]] = {}
        self.on_write: dict[Key, Callable[[int], None]] = {}
        self._indices = {index for index, _ in entries}

    def reset(self, communication_only: bool) -> None:
        """Return to the power-on values: all, or those of the communication profile (1000 to 1FFF)."""
        for key, entry in self.entries.items():
            if not communication_only or key[0] < 0x2000:
                self.values[key] = self.overrides.get(key, entry.default)

    def override(self, index: int, sub: int, value: int) -> None:
        """Give this device another power-on value than the EDS."""
        self.overrides[index, sub] = self.values[index, sub] = value

    def find(self, index: int, sub: int) -> Entry:
        """Entry of a sub-object; `Refused` if there is none."""
        entry = self.entries.get((index, sub))
        if entry is None:
            raise Refused(SdoAbort.NO_SUBINDEX if index in self._indices else SdoAbort.NO_OBJECT)
        return entry

    def get(self, index: int, sub: int) -> int:
        """Value, measured where it is measured."""
        read = self.on_read.get((index, sub))
        return self.values[index, sub] if read is None else read()

    def read(self, index: int, sub: int) -> bytes:
        """Answer a read from the bus."""
        entry = self.find(index, sub)
        if not entry.readable:
            raise Refused(SdoAbort.WRITE_ONLY)
        return self.get(index, sub).to_bytes(entry.bits // 8, "little", signed=entry.is_signed)

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Answer a write from the bus."""
        entry = self.find(index, sub)
        if not entry.writable:
            raise Refused(SdoAbort.READ_ONLY)
        if len(data) != entry.bits // 8:
            raise Refused(SdoAbort.LENGTH)
        self.put(index, sub, int.from_bytes(data, "little", signed=entry.is_signed))

    def put(self, index: int, sub: int, value: int) -> None:
        """Store a value after the checks of range and of the device."""
        entry = self.entries[index, sub]
        if entry.high is not None and value > entry.high:
            raise Refused(SdoAbort.TOO_HIGH)
        if entry.low is not None and value < entry.low:
            raise Refused(SdoAbort.TOO_LOW)
        check = self.on_write.get((index, sub))
        if check is not None:
            check(value)
        self.values[index, sub] = value
