"""Check of devices on serial lines: which devices answer, and what they report."""

from __future__ import annotations

import select
from collections.abc import Callable, Iterator, Sequence

from soro_core.errors import HardwareError
from soro_hardware.finding import Finding, run_check
from soro_hardware.serial_line.config import SerialPlatform
from soro_hardware.serial_line.line.engine import LineEngine
from soro_hardware.serial_line.line.port import BytePort
from soro_hardware.serial_line.line.session import StartupSession


class _Patience:
    """Time on one line while nothing else happens."""

    def __init__(self, port: BytePort, clock: Callable[[], float]) -> None:
        self._port, self._clock = port, clock

    def now_ns(self) -> int:
        """Return the time of the line [ns]."""
        return round(self._clock() * 1e9)

    def wait(self, timeout_s: float) -> None:
        """Wait until bytes arrive, at most `timeout_s` [s]."""
        select.select([self._port.fileno()], [], [], max(timeout_s, 0.0))


def examine(
    platform: SerialPlatform,
    open_ports: Callable[[], Sequence[BytePort]],
    make_lines: Callable[[Sequence[BytePort]], list[LineEngine]],
    stop_streaming: Callable[[StartupSession], None],
    clock: Callable[[], float],
) -> Iterator[Finding]:
    """Yield findings for every device; set points do not change.

    Parameters
    ----------
    platform : SerialPlatform
        Valves and times.
    open_ports, make_lines, stop_streaming : callable
        Hooks of the driver: open its ports, make the devices, and stop streaming devices.
    clock : callable
        Returns a monotonic time [s].
    """
    ports: Sequence[BytePort] = ()
    try:
        ports = open_ports()
        for port in ports:
            port.read()  # raises if the port does not exist
    except HardwareError as error:
        for port in ports:
            port.close()
        advice = "name as many serial ports as the platform has; no other program may use them"
        yield Finding("port", "fail", str(error), advice)
        return

    def close() -> None:
        for port in ports:
            port.close()

    found = _ask(platform, make_lines(ports), stop_streaming, clock)
    yield from run_check("line", "check the adapter and its cable", found, close)


def _ask(
    platform: SerialPlatform,
    lines: list[LineEngine],
    stop_streaming: Callable[[StartupSession], None],
    clock: Callable[[], float],
) -> Iterator[Finding]:
    for engine in lines:
        waiter = _Patience(engine.port, clock)
        stop_streaming(StartupSession(engine, waiter, engine.port.name, platform.line))
        for channel in engine.channels:
            session = StartupSession(engine, waiter, channel.source, platform.line)
            advice = f"check its kind, power, TX and RX, {platform.baud} baud, and /dev/serial/by-id"
            try:
                session.wait_for_boot(channel.wake, platform.line.boot_timeout_s)
                advice = "correct the device's settings, or the platform file if it is another device"
                yield Finding(channel.source, "ok", channel.describe(session))
            except HardwareError as error:
                found = str(error).removeprefix(f"{channel.source}: ")
                yield Finding(channel.source, "fail", found, advice)
