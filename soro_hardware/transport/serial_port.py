"""Opens a serial port or pseudo-terminal for reads and writes that do not block."""

from __future__ import annotations

import os
import termios

import serial

from soro_core.errors import HardwareError
from soro_hardware.error_text import reason


def open_serial(path: str, baud: int) -> serial.Serial:
    """Open a port: 8N1, raw, for this program alone.

    Raises
    ------
    HardwareError
        If the port cannot be opened.
    """
    try:
        port = serial.Serial(path, baud, timeout=0, exclusive=True)
    except (OSError, serial.SerialException, ValueError, termios.error) as error:
        raise HardwareError(f"cannot open the port ({reason(error)})", path, "open") from None
    os.set_blocking(port.fileno(), False)
    # With VMIN = 1 "nothing yet" is EAGAIN, so that an empty read always means that the port is gone.
    attributes = termios.tcgetattr(port.fileno())
    attributes[6][termios.VMIN] = 1
    termios.tcsetattr(port.fileno(), termios.TCSANOW, attributes)
    return port
