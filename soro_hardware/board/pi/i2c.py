"""I2C of Linux through smbus2 (the extra `board`)."""

from __future__ import annotations

import fcntl
from typing import Any

from soro_core.errors import HardwareError
from soro_core.extras import named_packages

# From linux/i2c-dev.h. By default the kernel waits one second for a blocked bus, too long for the others.
_I2C_RETRIES, _I2C_TIMEOUT = 0x0701, 0x0702
_TIMEOUT_10MS = 1


class LinuxI2c:
    """The bus ``/dev/i2c-<number>``.

    Raises
    ------
    MissingPackageError
        If smbus2 is not installed.
    HardwareError
        If the bus cannot be opened.
    """

    def __init__(self, number: int) -> None:
        with named_packages():
            import smbus2
        try:
            self._bus: Any = smbus2.SMBus(number)
            fcntl.ioctl(self._bus.fd, _I2C_TIMEOUT, _TIMEOUT_10MS)
            fcntl.ioctl(self._bus.fd, _I2C_RETRIES, 0)
        except OSError as error:
            text = f"cannot open ({error.strerror}); is it enabled, and are you in group i2c?"
            raise HardwareError(text, f"/dev/i2c-{number}", "open") from None
        self._message = smbus2.i2c_msg

    def write(self, address: int, data: bytes) -> None:
        self._bus.i2c_rdwr(self._message.write(address, data))

    def read(self, address: int, length: int) -> bytes:
        message = self._message.read(address, length)
        self._bus.i2c_rdwr(message)
        return bytes(message)

    def close(self) -> None:
        self._bus.close()
