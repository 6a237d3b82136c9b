"""An emulated regulator on a serial line, for all dialects: set point, power, faults."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

FOREVER_NS = 1 << 62  # time of the first answer of a device without power


@dataclass(frozen=True)
class ValveSetup:
    """What a regulator on a serial line is made of.

    Attributes
    ----------
    full_scale_pa : float
        Highest set point [Pa gauge].
    reading_pa : callable
        Returns the measured pressure [Pa gauge].
    boot_ns : int
        Time [ns] from power-on to the first answer.
    up_ns : int
        Time [ns] of the first answer at the start of the emulation.
    """

    full_scale_pa: float
    reading_pa: Callable[[], float]
    boot_ns: int = 0
    up_ns: int = 0


class SerialValve(ABC):
    """One regulator, without a watchdog: without a host it keeps its set point.

    Parameters
    ----------
    setup : ValveSetup
        Range, sensor and times.

    Attributes
    ----------
    setpoint : float
        Set point in the unit of the device.
    muted : bool
        Whether a fault suppresses the answers.
    ignores_setpoint : bool
        Whether the device accepts set points, but keeps the last one.
    """

    def __init__(self, setup: ValveSetup) -> None:
        self._full_scale_pa, self.reading_pa = setup.full_scale_pa, setup.reading_pa
        self._boot_ns, self._up_ns = setup.boot_ns, setup.up_ns
        self.setpoint = self._wake_setpoint = 0.0
        self.muted = self.ignores_setpoint = False

    @abstractmethod
    def to_unit(self, pressure_pa: float) -> float:
        """Convert a pressure [Pa gauge] to the unit and resolution of the device."""

    @abstractmethod
    def demand_pa(self) -> float:
        """Return the set point [Pa gauge] that the valve follows."""

    def wake(self, pressure_pa: float) -> None:
        """Set the set point [Pa gauge] for now and after each power-on."""
        self.give(pressure_pa)
        self._wake_setpoint = self.setpoint

    def give(self, pressure_pa: float) -> None:
        """Set the set point [Pa gauge], as the front panel does."""
        self.setpoint = self.to_unit(min(max(pressure_pa, 0.0), self._full_scale_pa))

    def reboot(self, now_ns: int) -> None:
        """Restart as after a loss of power, with the set point of `wake`."""
        self.setpoint, self._up_ns = self._wake_setpoint, now_ns + self._boot_ns

    def power(self, now_ns: int, is_on: bool) -> None:
        """Switch the power; without it the device gives no answer and its valve is closed."""
        self.reboot(now_ns)
        if not is_on:
            self.setpoint, self._up_ns = 0.0, FOREVER_NS

    def mute(self, is_on: bool) -> None:
        """Suppress the answers while `is_on`."""
        self.muted = is_on

    def ignore_setpoints(self, is_on: bool) -> None:
        """Accept set points, but keep the last one, while `is_on`."""
        self.ignores_setpoint = is_on

    def is_up(self, now_ns: int) -> bool:
        """Return whether the device has power and has started."""
        return now_ns >= self._up_ns
