"""The contact of the emergency stop at a GPIO of the board; an open circuit counts as pressed.

The line is read through the character device of the kernel, ABI version 2 of linux/gpio.h.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import struct
from typing import Protocol

from soro_core.errors import HardwareError
from soro_hardware.board.config import StopContact
from soro_hardware.error_text import reason

# struct gpio_v2_line_request: offsets, consumer, flags of the configuration and its 10 attributes (none),
# number of lines, size of the event buffer, padding, file descriptor of the answer.
_REQUEST = struct.Struct("=64I 32s Q 264x I I 20x i")
_VALUES = struct.Struct("=QQ")  # struct gpio_v2_line_values: bits and mask
_GET_LINE, _GET_VALUES = 0xC250B407, 0xC010B40E
_INPUT, _PULL_UP = 1 << 2, 1 << 8


class ContactLine(Protocol):
    """The input that the contact pulls to ground; a line that cannot be read is an `OSError`."""

    def is_open(self) -> bool:
        """Return whether the contact is open: the input is high."""

    def close(self) -> None:
        """Give the line back."""


class GpioLine:
    """A line of a GPIO chip as an input with a pull-up.

    Raises
    ------
    HardwareError
        If the chip has no such line, or another program has it.
    """

    def __init__(self, contact: StopContact) -> None:
        offsets = (contact.line, *(0,) * 63)
        request = bytearray(_REQUEST.pack(*offsets, b"soro stop", _INPUT | _PULL_UP, 1, 0, 0))
        try:
            chip = os.open(contact.chip, os.O_RDONLY | os.O_CLOEXEC)
            try:
                fcntl.ioctl(chip, _GET_LINE, request)
            finally:
                os.close(chip)
        except OSError as error:
            text = f"cannot read line {contact.line} ({reason(error)}); are you in group gpio?"
            raise HardwareError(text, contact.chip, "open") from None
        self._line: int = _REQUEST.unpack(request)[-1]

    def is_open(self) -> bool:
        values = bytearray(_VALUES.pack(0, 1))
        fcntl.ioctl(self._line, _GET_VALUES, values)
        return bool(_VALUES.unpack(values)[0] & 1)

    def close(self) -> None:
        with contextlib.suppress(OSError):
            os.close(self._line)


class StopInput:
    """The contact without its bounces.

    A change counts when every reading has shown it for `debounce_s`; the first reading counts at once. A line
    that cannot be read counts as open.

    Parameters
    ----------
    contact : StopContact
        Place of the contact, and its time of bouncing.
    line : ContactLine
        The input.
    """

    def __init__(self, contact: StopContact, line: ContactLine) -> None:
        self._line, self._debounce_ns = line, round(contact.debounce_s * 1e9)
        self._read: bool | None = None
        self._since_ns = 0
        self._is_pressed = True

    def is_pressed(self, now_ns: int) -> bool:
        """Read the line at a monotonic time [ns]; return whether the stop is pressed."""
        try:
            is_open = self._line.is_open()
        except OSError:
            is_open = True
        if self._read is None:
            self._is_pressed = is_open
        if is_open is not self._read:
            self._read, self._since_ns = is_open, now_ns
        if now_ns - self._since_ns >= self._debounce_ns:
            self._is_pressed = is_open
        return self._is_pressed
