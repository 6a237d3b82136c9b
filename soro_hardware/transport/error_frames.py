"""Error frames of the Linux kernel (linux/can/error.h)."""

from __future__ import annotations

CONTROLLER, PROTOCOL, NO_ACKNOWLEDGE, BUS_OFF, RESTARTED = 0x04, 0x08, 0x20, 0x40, 0x100
_OVERFLOW = 0x03  # of the controller, in data byte 1
_LETTERS = {NO_ACKNOWLEDGE: "a", PROTOCOL: "b"}


def letters(classes: int, data: bytes = b"") -> str:
    """Return bus errors as letters of slcan: a = no acknowledge, b = bit or form, o = overrun."""
    found = "".join(letter for bit, letter in _LETTERS.items() if classes & bit)
    overrun = bool(classes & CONTROLLER and len(data) > 1 and data[1] & _OVERFLOW)
    return found + ("o" if overrun else "")
