"""`soro board` on emulated chips as a process; every change of a DAC goes to a log with the time of it.

Usage: board_process.py PLATFORM LOG; the file LOG.pressed presses the emergency stop.
"""

import os
import sys
import time

from soro_hardware import load_platform
from soro_hardware.board.pi.server import run_board
from soro_hardware.emulation.board.i2c import EmulatedAds1015, EmulatedI2c, EmulatedMcp4725


class LoggedDac(EmulatedMcp4725):
    """DAC that starts at full scale, so that a missing vent shows."""

    def __init__(self, log, name):
        self._log, self._name, self._last = log, name, None
        super().__init__(stored_code=4095)

    def write(self, data):
        super().write(data)
        if self.code != self._last:
            self._last = self.code
            # One write a line: lines of the server and of its guard do not mix.
            os.write(self._log, f"{time.monotonic_ns()} {os.getpid()} {self._name} {self.code}\n".encode())


class Bus(EmulatedI2c):
    """Bus on the machine's clock whose ADCs see what the DACs ask for."""

    def write(self, address, data):
        self.advance(time.monotonic_ns())
        super().write(address, data)

    def read(self, address, length):
        self.advance(time.monotonic_ns())
        return super().read(address, length)


def main(config, log_path):
    """Serve on a free port of this machine."""
    platform = load_platform(config)
    log = os.open(log_path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)

    def open_bus(number):
        chips = {}
        for n, port in enumerate(platform.ports):
            if port.bus == number:
                dac = LoggedDac(log, n)
                chips[port.dac] = dac
                chips[port.adc] = EmulatedAds1015(lambda dac=dac: 2.0 * dac.fraction)
        return Bus(chips)

    class Contact:
        """Contact of the emergency stop: open while a file is there."""

        def __init__(self, _):
            self._pressed = f"{log_path}.pressed"

        def is_open(self):
            return os.path.exists(self._pressed)

        def close(self):
            pass

    def announce(line):
        print(line, flush=True)

    return run_board(config, "127.0.0.1:0", announce, open_bus=open_bus, open_contact=Contact)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
