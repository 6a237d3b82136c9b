"""What the doctor asks the devices on serial lines: who is there, and what they say of themselves."""

from __future__ import annotations

import select
from collections.abc import Callable, Iterator, Sequence

from soro_core.errors import HardwareError
from soro_core.hardware.finding import Finding
from soro_core.hardware.serial_line.config import SerialPlatform
from soro_core.hardware.serial_line.engine import LineEngine
from soro_core.hardware.serial_line.port import BytePort
from soro_core.hardware.serial_line.session import Session


class _Patience:
    """Time on one line while nothing else happens."""

    def __init__(self, port: BytePort, clock: Callable[[], float]) -> None:
        self._port, self._clock = port, clock

    def now_ns(self) -> int:
        """Time of the line."""
        return round(self._clock() * 1e9)

    def wait(self, timeout_s: float) -> None:
        """Until bytes come, at most so long."""
        select.select([self._port.fileno()], [], [], max(timeout_s, 0.0))


def look(
    platform: SerialPlatform,
    open_ports: Callable[[], Sequence[BytePort]],
    make_lines: Callable[[Sequence[BytePort]], list[LineEngine]],
    calm: Callable[[Session], None],
    clock: Callable[[], float],
) -> Iterator[Finding]:
    """Findings for every device; set points stay as they are.

    Parameters
    ----------
    open_ports, make_lines, calm : callable
        The driver's: open its ports, divide them into devices, and stop those that send without being asked.
    """
    try:
        ports = open_ports()
    except HardwareError as error:
        advice = "name as many serial ports as the platform has, which no other program holds"
        yield Finding("port", "fail", str(error), advice)
        return
    try:
        for engine in make_lines(ports):
            waiter = _Patience(engine.port, clock)
            calm(Session(engine, waiter, engine.port.name, platform.line))
            for channel in engine.channels:
                session = Session(engine, waiter, channel.source, platform.line)
                advice = f"check its kind, power, TX and RX, {platform.baud} baud, and /dev/serial/by-id"
                try:
                    session.wait_for_boot(channel.wake, platform.line.boot_timeout_s)
                    advice = "correct the device's settings, or the platform file if it is another device"
                    yield Finding(channel.source, "ok", channel.look(session))
                except HardwareError as error:
                    found = str(error).removeprefix(f"{channel.source}: ")
                    yield Finding(channel.source, "fail", found, advice)
    except HardwareError as error:
        yield Finding("line", "fail", str(error), "check the adapter and its cable")
    finally:
        for port in ports:
            port.close()
