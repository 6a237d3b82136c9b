"""A CAN frame as the pure protocol layers see it, and how long it occupies the wire."""

from __future__ import annotations

from typing import NamedTuple


class Frame(NamedTuple):
    """One classic CAN frame; `length` is the DLC, which a remote frame has without data."""

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
    """Bits on the wire with worst-case stuffing and the three bits between frames (ISO 11898-1).

    The worst case is what a bus has to be planned for; a frame of 4 bytes takes 95 bits, of 8 bytes 135.
    """
    payload = 0 if frame.remote else 8 * len(frame.data)
    if frame.extended:
        return 67 + payload + (54 + payload - 1) // 4
    return 47 + payload + (34 + payload - 1) // 4
