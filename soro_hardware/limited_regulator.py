"""A regulator behind the limiter, without ROS; every program sends its set points through this class."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from soro_core import safety
from soro_core.arrays import Array, Flags
from soro_core.errors import HardwareError
from soro_hardware.platform import IN_TURN, PlatformBase, watched
from soro_hardware.port import Exchange, Regulator


class LimitedRegulator(safety.Limiter):
    """A regulator behind the limiter: slew, exchange, judge, and vent when the limiter latches.

    Parameters
    ----------
    platform : PlatformBase
        Platform of the regulator; its rate is the rate of the cycles.
    regulator : Regulator
        Configured regulator, because some devices report their rate only then; the caller closes it.
    limits : Limits
        Limits of commands and readings; the age limit of readings is raised for slow devices.
    where : str
        Name of the limits in errors.

    Attributes
    ----------
    lost : str or None
        First fault of the devices since their start-up. A reset then repeats the start-up, because the
        devices may have lost their configuration.
    in_turn : bool
        Whether a cycle serves only some of the chambers, in turn.

    Raises
    ------
    ConfigError
        If the devices are too slow for the monitors, or the limits are beyond the platform's rating.
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
        """Send the slewed set points of the newest command and judge the readings.

        Returns None if the connection is lost, which trips the limiter.
        """
        was_vented, result = self.state.vented, None
        setpoint_pa = self.slew(now_ns)
        if self.state.vented and not was_vented:  # at once: the exchange would lower the set points by slew
            self.regulator.vent()
            was_vented = True
        try:
            result = self.regulator.exchange(setpoint_pa, now_ns)
        except HardwareError as error:
            self.lost = self.lost or str(error)
            self.trip(str(error))
        else:
            self.lost = self.lost or result.fault_text
            self.judge(result.known_pa, result.fresh, now_ns, result.fault_text, result.supply_pa)
        # Devices without a watchdog keep their pressure until this call reaches them.
        unreached = result is None and not self.regulator.device_watchdog
        if self.state.vented and (unreached or not was_vented):
            self.regulator.vent()
        return result

    def readings_pa(self, exchange: Exchange, now_ns: int, every_cycle: bool = False) -> Array | None:
        """Return what is known of the pressures after a cycle, or None if it has brought nothing new.

        Parameters
        ----------
        exchange : Exchange
        now_ns : int
            Its time [ns].
        every_cycle : bool
            Whether readings count that are not of this cycle, for loops that need some at each tick.

        Returns
        -------
        ndarray (n,) or None
            Readings [Pa gauge], extrapolated for chambers served in turn. NaN for a chamber without a
            reading for so long that the limiter has latched, or whose sensor gives no number. None if all
            chambers are like that, or one of the others was not sampled in this cycle: an old reading with
            a new stamp would be wrong in an estimator.
        """
        no_number = ~np.isfinite(exchange.pressure_pa)
        silent = self._silent(now_ns) | (exchange.fresh & no_number)
        sampled = exchange.fresh | (self.in_turn or every_cycle)
        if np.any(~silent & (no_number | ~sampled)) or (silent.all() and not every_cycle):
            return None
        known = exchange.known_pa
        if self.in_turn:
            known = safety.interpolated(self.state, known, exchange.fresh)
        return np.where(silent, np.nan, known)

    def _silent(self, now_ns: int) -> Flags:
        """Return the chambers (n,) whose last reading is older than a reading may be."""
        if self.state.reading_ns is None:
            return np.zeros(len(self.names), dtype=np.bool_)
        return np.asarray((now_ns - self.state.reading_ns) * 1e-9 > self.limits.reading_age_s)

    def vent(self, cause: str) -> None:
        """Latch, and send zeros at once."""
        self.latch(cause)
        self.regulator.vent()

    def reset(self, now_ns: Callable[[], int]) -> str | None:
        """Open the latch and return None, or return the refusal.

        Succeeds only if the last accepted command was zero, whatever its age, and no emergency stop is
        pressed. If a device reported a fault, the reset first repeats the start-up; if that fails, the latch
        stays closed and the refusal names the device and the step.
        """
        _, refusal = safety.reset(self.limits, self.state, now_ns())
        # Devices that keep their pressure may need the start-up to vent, and those with a fault to end it.
        if refusal not in (None, self.state.kept, self.state.standing):
            return refusal
        if (why := self.why_stopped()) is not None:
            return why
        if self.lost is not None:
            try:
                self.regulator.configure()
            except HardwareError as error:
                return str(error)
            self.lost = None
            self.begin_anew()
        # No command arrives during a start-up: the last one may be too old by now.
        return super().reset(now_ns)
