"""A regulator behind the limiter, without ROS: the one way in which a program gives chambers pressure."""

from __future__ import annotations

from collections.abc import Callable

from soro_core import safety
from soro_core.errors import HardwareError
from soro_core.hardware.platform import IN_TURN, PlatformBase, watched
from soro_core.hardware.port import Array, Exchange, Regulator


class GuardedRegulator(safety.Limiter):
    """A regulator that is commanded through the limiter only: exchange, judge, vent when the latch closes.

    Parameters
    ----------
    platform : PlatformBase
        Of the regulator; its rate is that of the cycles.
    regulator : Regulator
        Configured, for some devices tell their rate only then; its caller closes it.
    limits : Limits
        Of commands and readings, as asked for; readings may be as old as the platform's bus makes them.
    where : str
        What errors call the limits.

    Attributes
    ----------
    lost : str or None
        What the devices complained of first since their start-up: a reset takes them through it again, for
        nobody knows what else they have lost.
    in_turn : bool
        Whether chambers are served one after another, not all in every cycle.

    Raises
    ------
    ConfigError
        If the devices are too slow to be watched, or limits are beyond the platform's rating.
    """

    def __init__(
        self, platform: PlatformBase, regulator: Regulator, limits: safety.Limits, where: str = "platform"
    ) -> None:
        safety.check_rating(limits, platform.rating, where)
        limits, response = watched(platform, regulator, limits, platform.cycle_hz, where)
        super().__init__(limits, regulator.chamber_names, response)
        self.regulator = regulator
        self.in_turn = regulator.update_hz < IN_TURN * platform.cycle_hz
        self.lost: str | None = None

    def cycle(self, now_ns: int) -> Exchange | None:
        """Exchange and judge; None when the connection is gone, which is a trip like any other."""
        was_vented, result = self.state.vented, None
        try:
            result = self.regulator.exchange(self.state.setpoint_pa, now_ns)
        except HardwareError as error:
            self.lost = self.lost or str(error)
            self.latch(str(error))
        else:
            self.lost = self.lost or result.trouble
            self.judge(result.known_pa, result.fresh, now_ns, result.trouble, result.supply_pa)
        # Of devices that keep their pressure nobody else gets it out when they can be reached again.
        unreached = result is None and not self.regulator.device_watchdog
        if self.state.vented and (unreached or not was_vented):
            self.regulator.vent()
        return result

    def known_pa(self, exchange: Exchange) -> Array:
        """Readings (n,) [Pa gauge] of the last cycle; chambers served in turn are carried on to now."""
        known = exchange.known_pa
        return safety.interpolated(self.state, known, exchange.fresh) if self.in_turn else known

    def vent(self, cause: str) -> None:
        """Latch, and send zeros at once."""
        self.latch(cause)
        self.regulator.vent()

    def reset(self, now_ns: Callable[[], int]) -> str | None:
        """Leave the latch, after the devices' start-up where they complained; the refusal, or None."""
        _, refusal = safety.reset(self.limits, self.state, now_ns())
        # Devices that keep their pressure may need their start-up to let it go.
        if refusal not in (None, self.state.kept):
            return refusal
        if self.lost is not None:
            try:
                self.regulator.configure()
            except HardwareError as error:
                return str(error)
            self.lost = None
        # A start-up takes time in which nobody could command: by now the last command may be an old one.
        return super().reset(now_ns)
