"""Start-up of all devices on the serial lines of an arm; the plan with which the supervisor vents them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence

from soro_core.errors import HardwareError
from soro_hardware.serial_line.config import LineOptions, SerialPlatform
from soro_hardware.serial_line.line.engine import LineEngine
from soro_hardware.serial_line.line.session import StartupSession, Waiter
from soro_hardware.supervisor_client import VentPlan

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


_ROUNDS = 20  # rounds without a confirmation
_EMPTIES_S = 2.0  # time [s] for an arm that empties slowly, as in the limiter


def plan_of(engine: LineEngine, platform: SerialPlatform) -> VentPlan:
    """Return the plan: zeros and readings for every device, in some twenty rounds."""
    steps = tuple(step for channel in engine.channels for step in channel.vent_steps())
    # Shorter than the timeout of the driver, because an unconfirmed step is repeated at once.
    timeout_s = min(platform.line.answer_timeout_s, 0.03 + 400 / platform.baud)
    longest_s = max(_ROUNDS * timeout_s * len(steps), _EMPTIES_S)
    return VentPlan(engine.port.name, steps, timeout_s, longest_s, begin="\r\n")
