"""A CAN frame, and the number of its bits on the bus."""

from __future__ import annotations

from typing import NamedTuple


class Frame(NamedTuple):
    """One classic CAN frame; `length` is the DLC of a remote frame, which has no data."""

    can_id: int
    data: bytes = b""
    extended: bool = False
    remote: bool = False
    length: int = -1

    @property
    def dlc(self) -> int:
        """Data length code."""
        return len(self.data) if self.length < 0 else self.length

    def __str__(self) -> str:
        identifier = f"{self.can_id:08X}" if self.extended else f"{self.can_id:03X}"
        body = f"R{self.dlc}" if self.remote else self.data.hex(" ").upper()
        return f"{identifier} [{self.dlc}] {body}".rstrip()


def frame_bits(frame: Frame) -> int:
    """Return the bits of a frame with worst-case stuffing and three bits between frames (ISO 11898-1).

    The budget of a bus uses this worst case: 95 bits for 4 bytes, 135 bits for 8 bytes.
    """
    payload = 0 if frame.remote else 8 * len(frame.data)
    if frame.extended:
        return 67 + payload + (54 + payload - 1) // 4
    return 47 + payload + (34 + payload - 1) // 4


CONTROLLER, PROTOCOL, NO_ACKNOWLEDGE, BUS_OFF, RESTARTED = 0x04, 0x08, 0x20, 0x40, 0x100
_OVERFLOW = 0x03  # of the controller, in data byte 1
_LETTERS = {NO_ACKNOWLEDGE: "a", PROTOCOL: "b"}


def letters(classes: int, data: bytes = b"") -> str:
    """Return bus errors as letters of slcan: a = no acknowledge, b = bit or form, o = overrun."""
    found = "".join(letter for bit, letter in _LETTERS.items() if classes & bit)
    overrun = bool(classes & CONTROLLER and len(data) > 1 and data[1] & _OVERFLOW)
    return found + ("o" if overrun else "")
