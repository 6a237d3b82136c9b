"""A regulator behind the limiter, without ROS: the one way in which a program gives chambers pressure."""

from __future__ import annotations

from soro_core import safety
from soro_core.errors import HardwareError
from soro_core.hardware.platform import PlatformBase, watched
from soro_core.hardware.port import Array, Exchange, Regulator


class GuardedRegulator:
    """A regulator that is commanded through the limiter only: exchange, judge, vent when the latch closes.

    Parameters
    ----------
    platform : PlatformBase
        Of the regulator; its rate is that of the cycles.
    regulator : Regulator
        Its caller configures it before the first cycle and closes it.
    limits : Limits
        Of commands and readings, as asked for; readings may be as old as the platform's bus makes them.

    Attributes
    ----------
    limits : Limits
        In force.
    state : SafetyState
        Of limiter, monitors and latch.
    lost : str or None
        Why the driver has to go through its start-up again before it takes set points.

    Raises
    ------
    ConfigError
        If the devices are too slow to be watched, or limits are beyond the platform's rating.
    """

    def __init__(self, platform: PlatformBase, regulator: Regulator, limits: safety.Limits) -> None:
        safety.check_rating(limits, platform.rating, where="platform")
        self.regulator = regulator
        self.limits, self._response = watched(platform, regulator, limits, platform.cycle_hz, "platform")
        self.state = safety.initial_state(regulator.n_chambers, regulator.chamber_names)
        self.lost: str | None = None

    @property
    def cause(self) -> str | None:
        """Why the limiter has vented, or None."""
        return self.state.cause

    def offer(self, command_pa: Array, stamp_ns: int, now_ns: int) -> str | None:
        """Take set points (n,) [Pa gauge] for the next cycle; the refusal, or None."""
        self.state, refusal = safety.offer(self.limits, self.state, command_pa, stamp_ns, now_ns)
        return refusal

    def cycle(self, now_ns: int) -> Exchange | None:
        """Exchange and judge; None when the connection is gone, which is a trip like any other."""
        was_vented, result = self.state.vented, None
        try:
            result = self.regulator.exchange(self.state.setpoint_pa, now_ns)
        except HardwareError as error:
            self.lost = self.lost or str(error)
            self.state = safety.request_vent(self.state, str(error))
        if result is not None:
            self._judge(result, now_ns)
        if self.state.vented and not was_vented:
            self.regulator.vent()
        return result

    def _judge(self, result: Exchange, now_ns: int) -> None:
        if any(fault.latched for fault in result.faults):
            self.lost = self.lost or result.trouble
        self.state = safety.cycle(
            self.limits,
            self.state,
            result.known_pa,
            result.fresh,
            now_ns,
            result.trouble,
            result.supply_pa,
            self._response,
        )

    def vent(self, cause: str) -> None:
        """Latch, and send zeros at once."""
        self.state = safety.request_vent(self.state, cause)
        self.regulator.vent()

    def reset(self, now_ns: int) -> str | None:
        """Leave the latch, after the driver's start-up where its devices were lost; the refusal, or None."""
        opened, refusal = safety.reset(self.limits, self.state, now_ns)
        if refusal is not None:
            return refusal
        if self.lost is not None:
            try:
                self.regulator.configure()
            except HardwareError as error:
                return str(error)
            self.lost = None
        self.state = opened
        return None
