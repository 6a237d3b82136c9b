"""Object dictionary of an emulated node, from an EDS file, with the checks of an SDO server."""

from __future__ import annotations

from collections.abc import Callable

from soro_hardware.canopen.eds import Key, ObjectEntry
from soro_hardware.canopen.sdo_frames import SdoAbort


class Refused(Exception):  # noqa: N818 - an answer of the protocol, not an error of the program
    """The node refuses an access with an SDO abort code."""

    def __init__(self, code: SdoAbort) -> None:
        self.code = code
        super().__init__(code.name)


class ObjectDictionary:
    """Values of one node.

    Parameters
    ----------
    entries : dict
        Entry of each object, by index and sub-index.

    Attributes
    ----------
    values : dict of int
        Present value of each object.
    on_read : dict of callable
        Functions that return the value of an object that is measured.
    on_write : dict of callable
        Functions that process a value before it is stored; they may raise `Refused`.
    """

    def __init__(self, entries: dict[Key, ObjectEntry]) -> None:
        self.entries = entries
        self.values = {key: entry.default for key, entry in entries.items()}
        self.overrides: dict[Key, int] = {}
        self.on_read: dict[Key, Callable[[], int]] = {}
        self.on_write: dict[Key, Callable[[int], None]] = {}

    def reset(self, communication_only: bool) -> None:
        """Reset all objects, or those of the communication profile (1000 to 1FFF), to power-on values."""
        for key, entry in self.entries.items():
            if not communication_only or key[0] < 0x2000:
                self.values[key] = self.overrides.get(key, entry.default)

    def override(self, index: int, sub: int, value: int) -> None:
        """Set a power-on value that differs from that in the EDS; parameters as in `put`."""
        self.overrides[index, sub] = self.values[index, sub] = value

    def find(self, index: int, sub: int) -> ObjectEntry:
        """Return the entry of an object; raises `Refused` if there is none."""
        entry = self.entries.get((index, sub))
        if entry is None:
            is_there = any(index == other for other, _ in self.entries)
            raise Refused(SdoAbort.NO_SUBINDEX if is_there else SdoAbort.NO_OBJECT)
        return entry

    def get(self, index: int, sub: int) -> int:
        """Return the value of an object, with `on_read` if it is measured."""
        read = self.on_read.get((index, sub))
        return self.values[index, sub] if read is None else read()

    def read(self, index: int, sub: int) -> bytes:
        """Return the bytes of an object for a read from the bus; raises `Refused`."""
        entry = self.find(index, sub)
        if not entry.readable:
            raise Refused(SdoAbort.WRITE_ONLY)
        return self.get(index, sub).to_bytes(entry.bits // 8, "little", signed=entry.is_signed)

    def writable(self, index: int, sub: int) -> ObjectEntry:
        """Return the entry of a writable object; raises `Refused` if there is none."""
        entry = self.find(index, sub)
        if not entry.writable:
            raise Refused(SdoAbort.READ_ONLY)
        return entry

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Store a value that is written from the bus.

        Parameters
        ----------
        index, sub : int
            Index and sub-index of the object.
        data : bytes
            Value, little-endian.

        Raises
        ------
        Refused
            If the object is read-only, or the length or the value is not allowed.
        """
        entry = self.writable(index, sub)
        if len(data) != entry.bits // 8:
            raise Refused(SdoAbort.LENGTH)
        self.put(index, sub, int.from_bytes(data, "little", signed=entry.is_signed))

    def put(self, index: int, sub: int, value: int) -> None:
        """Store a value after the checks of its range and of `on_write`.

        Parameters
        ----------
        index, sub : int
            Index and sub-index of the object.
        value : int

        Raises
        ------
        Refused
            If the value is not allowed.
        """
        entry = self.entries[index, sub]
        if entry.high is not None and value > entry.high:
            raise Refused(SdoAbort.TOO_HIGH)
        if entry.low is not None and value < entry.low:
            raise Refused(SdoAbort.TOO_LOW)
        check = self.on_write.get((index, sub))
        if check is not None:
            check(value)
        self.values[index, sub] = value
