"""`soro board` on emulated chips whose transfers take the time that they take on the wire."""

from __future__ import annotations

import sys
import time
from functools import partial

from soro_hardware import load_platform
from soro_hardware.board.config import BoardPlatform
from soro_hardware.board.pi.server import serve
from soro_hardware.emulation.board.i2c import EmulatedAds1015, EmulatedI2c, EmulatedMcp4725


class TimedI2c(EmulatedI2c):
    """Bus whose chips live on the machine's clock."""

    def read(self, address: int, length: int) -> bytes:
        self.advance(time.monotonic_ns())
        return super().read(address, length)


def main(config: str) -> None:
    """Serve on a free port of this machine."""
    platform = load_platform(config)
    assert isinstance(platform, BoardPlatform)

    def open_bus(number: int) -> TimedI2c:
        bus = TimedI2c({}, time.sleep)
        for port in platform.ports:
            if port.bus == number:
                dac = EmulatedMcp4725()
                bus.chips |= {port.dac: dac, port.adc: EmulatedAds1015(partial(_volts, dac))}
        return bus

    serve(platform, open_bus, ("127.0.0.1", 0), partial(print, flush=True))


def _volts(dac: EmulatedMcp4725) -> float:
    return 2.0 * dac.fraction


if __name__ == "__main__":
    main(sys.argv[1])
