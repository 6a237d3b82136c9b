"""Why a motion is refused before anything moves."""

from __future__ import annotations

from typing import Literal, TypeAlias

from soro_core.errors import ConfigError

Reason: TypeAlias = Literal["reach", "pressure", "rate", "contact"]


class MotionError(ConfigError):
    """The tip, the pressures, their rates or obstacles do not allow a motion.

    Parameters
    ----------
    reason : str
        reach, pressure, rate or contact.
    key, got, allowed : str
        Parts of the line, as in `ConfigError`.
    nearest_m : tuple of float or None
        For reach and pressure: the nearest point that pressures hold [m], or None if none was found.
    chamber : str
        For pressure and rate: the chamber with the largest deficit.
    pressure_pa : float or None
        For pressure: what that chamber would need [Pa gauge].
    factor : float or None
        For rate: the smallest factor of time that works.
    """

    def __init__(
        self,
        reason: Reason,
        key: str,
        got: str,
        allowed: str,
        nearest_m: tuple[float, ...] | None = None,
        chamber: str = "",
        pressure_pa: float | None = None,
        factor: float | None = None,
    ) -> None:
        self.reason, self.nearest_m, self.chamber = reason, nearest_m, chamber
        self.pressure_pa, self.factor = pressure_pa, factor
        super().__init__("motion", key, got, allowed)
