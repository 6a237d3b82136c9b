"""Plan of the supervisor for a serial line."""

from __future__ import annotations

from soro_hardware.serial_line.config import SerialPlatform
from soro_hardware.serial_line.line.engine import LineEngine
from soro_hardware.supervisor_client import VentPlan

_ROUNDS = 20  # rounds without a confirmation
_EMPTIES_S = 2.0  # time [s] for an arm that empties slowly, as in the limiter


def plan_of(engine: LineEngine, platform: SerialPlatform) -> VentPlan:
    """Return the plan: zeros and readings for every device, in some twenty rounds."""
    steps = tuple(step for channel in engine.channels for step in channel.vent_steps())
    # Shorter than the timeout of the driver, because an unconfirmed step is repeated at once.
    timeout_s = min(platform.line.answer_timeout_s, 0.03 + 400 / platform.baud)
    longest_s = max(_ROUNDS * timeout_s * len(steps), _EMPTIES_S)
    return VentPlan(engine.port.name, steps, timeout_s, longest_s, begin="\r\n")
