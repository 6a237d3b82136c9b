"""Start-up of all devices on the serial lines of an arm."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence

from soro_core.errors import HardwareError
from soro_hardware.serial_line.config import LineOptions
from soro_hardware.serial_line.line.engine import LineEngine
from soro_hardware.serial_line.line.session import StartupSession, Waiter

_BOOTED_S = 0.2  # boot time of further devices after a failure


def start_all(
    engines: Sequence[LineEngine],
    waiter: Waiter,
    stop_streaming: Callable[[StartupSession], None],
    options: LineOptions,
) -> None:
    """Start all devices, also after the failure of one, so that the others are vented.

    Parameters
    ----------
    engines : sequence of LineEngine
        Lines with their devices.
    waiter : Waiter
        Time of the driver.
    stop_streaming : callable
        Stops streaming devices.
    options : LineOptions
        Times of the lines.

    Raises
    ------
    HardwareError
        The first error, after all devices have been tried.
    """
    boot_s, failed = options.boot_timeout_s, None
    for engine in engines:
        try:
            stop_streaming(StartupSession(engine, waiter, engine.port.name, options))
        except HardwareError as error:
            failed = failed or error
        for channel in engine.channels:
            session = StartupSession(engine, waiter, channel.source, options)
            try:
                session.wait_for_boot(channel.wake, boot_s)
                channel.start(session)
            except HardwareError as error:
                failed, boot_s = failed or error, _BOOTED_S  # the other devices have booted meanwhile
        with contextlib.suppress(HardwareError):  # a lost port has raised before
            engine.discard(waiter.now_ns())
    if failed is not None:
        raise failed
