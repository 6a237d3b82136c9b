"""I2C of Linux through smbus2 (the extra `board`)."""

from __future__ import annotations

import fcntl
from typing import Any

from soro_core.errors import HardwareError

# From linux/i2c-dev.h. The kernel waits a whole second for a bus that hangs; the other buses cannot.
_I2C_RETRIES, _I2C_TIMEOUT = 0x0701, 0x0702
_TIMEOUT_10MS = 1


class LinuxI2c:
    """The bus ``/dev/i2c-<number>``.

    Raises
    ------
    HardwareError
        If smbus2 is missing or the bus cannot be opened.
    """

    def __init__(self, number: int) -> None:
        try:
            import smbus2
        except ImportError:
            raise HardwareError("I2C needs the package smbus2 (pip install smbus2)") from None
        try:
            self._bus: Any = smbus2.SMBus(number)
            fcntl.ioctl(self._bus.fd, _I2C_TIMEOUT, _TIMEOUT_10MS)
            fcntl.ioctl(self._bus.fd, _I2C_RETRIES, 0)
        except OSError as error:
            raise HardwareError(
                f"/dev/i2c-{number}: cannot open ({error.strerror}); is it enabled, and are you in group i2c?"
            ) from None
        self._message = smbus2.i2c_msg

    def write(self, address: int, data: bytes) -> None:
        self._bus.i2c_rdwr(self._message.write(address, data))

    def read(self, address: int, length: int) -> bytes:
        message = self._message.read(address, length)
        self._bus.i2c_rdwr(message)
        return bytes(message)

    def close(self) -> None:
        self._bus.close()
