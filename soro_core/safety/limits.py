"""Limits of commands and readings: configurable, within bounds that no configuration crosses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pydantic import Field, model_validator

from soro_core.config import Strict, with_changes
from soro_core.errors import NEXT_CONFIGURE, ConfigError

# Rating of the three-bellow platform, below 0.1 MPa gauge; that of every platform which states no other.
HARD_LIMIT_PA = 100e3
# No platform is rated higher than this [Pa gauge].
HIGHEST_RATING_PA = 1e6
# The longest age of a reading, and the least readings a second of a chamber that can be watched with it.
OLDEST_READING_S, SLOWEST_HZ = 0.5, 4.0
# Parts of the rating at which an over-pressure trips at the latest: after its time, and at once.
OVER_PRESSURE, BURST = 1.05, 1.2


class Rating(Strict):
    """Pressures that the mechanics of a platform bear; only the platform file states them."""

    minimum_pa: float = Field(
        -HARD_LIMIT_PA, ge=-101e3, le=0, description="lowest permitted set point [Pa gauge]"
    )
    maximum_pa: float = Field(
        HARD_LIMIT_PA,
        gt=0,
        le=HIGHEST_RATING_PA,
        description="set points stay below this pressure [Pa gauge]",
    )


class Monitors(Strict):
    """Thresholds beyond which a reading or a valve counts as faulty."""

    model_pa: float = Field(
        8e3, ge=1e3, le=30e3, description="difference between a reading and what the valve's lag explains"
    )
    model_s: float = Field(0.3, ge=0.05, le=1, description="time that it may last")
    stuck_pa: float = Field(10e3, ge=3e3, le=30e3, description="change of a set point that must show")
    stuck_motion_pa: float = Field(2e3, ge=200, le=2.5e3, description="change of a reading that shows it")
    stuck_s: float = Field(0.5, ge=0.1, le=2, description="time within which it must show")
    frozen_pa: float = Field(
        3e3, ge=0, le=20e3, description="expected change during which readings cannot be all equal"
    )
    frozen_s: float = Field(0.5, ge=0.1, le=5, description="shortest time of equal readings that vents")
    spike_pa: float = Field(50e3, ge=5e3, le=100e3, description="unexpected change in one sample that vents")
    open_circuit_pa: float = Field(
        -105e3, ge=-150e3, le=-102e3, description="reading below which a wire is open"
    )
    short_circuit_pa: float = Field(
        150e3, gt=0, le=1.5 * HIGHEST_RATING_PA, description="reading above which a wire is shorted"
    )
    leak_pa_s: float = Field(2e3, ge=100, le=20e3, description="drift at a constant set point that vents")
    leak_s: float = Field(1.0, ge=0.2, le=10, description="time over which the drift is measured")
    supply_margin_pa: float = Field(
        50e3, ge=0, le=500e3, description="supply above the highest set point, where a device reports it"
    )
    # The default suits compressed air up to 10 bar, and set points up to the highest rating.
    supply_most_pa: float = Field(
        1.1e6, ge=50e3, le=5e6, description="highest supply, where a device reports it"
    )
    supply_s: float = Field(0.1, ge=0.01, le=1, description="time that the supply may be lower or higher")


class Limits(Strict):
    """Limits of commands and readings; defaults for the three-bellow platform."""

    minimum_pa: float = Field(0.0, ge=-101e3, le=0.0, description="lowest set point")
    maximum_pa: float = Field(90e3, gt=0, lt=HIGHEST_RATING_PA, description="highest set point")
    rise_pa_s: float = Field(200e3, gt=0, le=2e6, description="fastest rise of a set point")
    fall_pa_s: float = Field(
        400e3, gt=0, le=2e6, description="fastest fall of a set point; a vent is not limited"
    )
    command_age_s: float = Field(0.1, gt=0, le=0.5, description="age of the last good command that vents")
    reading_age_s: float = Field(
        0.05,
        gt=0,
        le=OLDEST_READING_S,
        description="age of the last fresh reading that vents; longer where the platform's bus needs it",
    )
    over_pressure_pa: float = Field(
        100e3, gt=0, le=OVER_PRESSURE * HIGHEST_RATING_PA, description="measured pressure that vents"
    )
    over_pressure_s: float = Field(0.02, ge=0, le=0.1, description="time that it may be exceeded")
    burst_pressure_pa: float = Field(
        110e3, gt=0, le=BURST * HIGHEST_RATING_PA, description="measured pressure that vents at once"
    )
    # 90 to 5 kPa takes 0.2 s on the three-bellow platform and 1.1 s from 60 ml through 0.05 l/(s bar); on a
    # slow line readings and vent may be another 0.5 s late.
    vent_limit_s: float = Field(
        2.0, ge=0.1, le=10, description="time after a vent within which every chamber must be empty"
    )
    vented_pa: float = Field(
        5e3, ge=1e3, le=20e3, description="pressure, of either sign, below which a chamber counts as empty"
    )
    monitors: Monitors = Field(Monitors(), description="plausibility of valves and sensors")

    @model_validator(mode="after")
    def _ordered(self) -> Limits:
        if self.over_pressure_pa <= self.maximum_pa:
            raise ValueError("over_pressure_pa must be above maximum_pa")
        if self.burst_pressure_pa < self.over_pressure_pa:
            raise ValueError("burst_pressure_pa must not be below over_pressure_pa")
        if self.monitors.short_circuit_pa <= self.burst_pressure_pa:
            raise ValueError("monitors.short_circuit_pa must be above burst_pressure_pa")
        return self


# Highest set point of a robot's range that leaves room for the trips above it [Pa gauge].
_HIGHEST_PA = 0.9 * HIGHEST_RATING_PA


def usable_range(range_pa: Sequence[float]) -> tuple[float, float]:
    """Return the lowest and highest set point of the range of a robot, with 0 to vent [Pa gauge]."""
    low, high = range_pa
    return max(min(low, 0.0), -HARD_LIMIT_PA), min(max(high, 0.0), _HIGHEST_PA)


def rating_of(range_pa: Sequence[float]) -> Rating:
    """Return the rating where there is no platform: the range of the robot [Pa gauge] is the bound."""
    usual = Limits()
    above = usual.over_pressure_pa / usual.maximum_pa
    return Rating(maximum_pa=max(HARD_LIMIT_PA, above * usable_range(range_pa)[1]))


def trips_above(maximum_pa: float) -> dict[str, Any]:
    """Return the trips above a highest set point [Pa gauge], by key, in the proportions of the defaults.

    A monitor is there only where its default is too narrow.
    """
    usual = Limits()
    part, monitors = maximum_pa / usual.maximum_pa, usual.monitors
    burst_pa, model_pa = usual.burst_pressure_pa * part, min(monitors.model_pa * part, 30e3)
    wider = {}
    if monitors.short_circuit_pa <= 1.2 * burst_pa:
        wider["short_circuit_pa"] = monitors.short_circuit_pa * part
    if model_pa > monitors.model_pa:
        wider["model_pa"] = model_pa
    found = {"over_pressure_pa": usual.over_pressure_pa * part, "burst_pressure_pa": burst_pa}
    return found | ({"monitors": wider} if wider else {})


# Limits that can become narrower while pressures are on, without a step of a set point or a trip; those that
# are lower bounds.
NARROWED = ("minimum_pa", "maximum_pa", "rise_pa_s", "fall_pa_s")
_LEAST = ("minimum_pa",)


def narrowed(limits: Limits, wanted: Limits, where: str) -> Limits:
    """Return limits with the range and the rates of others that are nowhere wider.

    Parameters
    ----------
    limits : Limits
        Limits as configured.
    wanted : Limits
        Limits from now on.
    where : str
        Node in errors.

    Raises
    ------
    ConfigError
        For a limit that is wider, or one that cannot change now.
    """
    for name in Limits.model_fields:
        now, later = getattr(limits, name), getattr(wanted, name)
        is_least = name in _LEAST
        if later == now or (name in NARROWED and (later > now if is_least else later < now)):
            continue
        side = ("at least " if is_least else "at most ") if name in NARROWED else ""
        allowed = f"{side}{now}, as configured; another value {NEXT_CONFIGURE}"
        raise ConfigError(where, f"limits.{name}", later, allowed)
    return with_changes(limits, **{name: getattr(wanted, name) for name in NARROWED})


def for_regulators(limits: Limits, update_hz: float, reading_age_s: float, where: str) -> Limits:
    """Return limits for the regulators of a platform, whose bus determines the age of readings.

    Parameters
    ----------
    limits : Limits
        Limits of the file.
    update_hz : float
        Rate of readings of one chamber [Hz].
    reading_age_s : float
        Age at which a reading on the bus counts as lost [s].
    where : str
        Name of the platform in errors.

    Raises
    ------
    ConfigError
        If the devices are too slow to be watched.
    """
    if update_hz < SLOWEST_HZ:
        allowed = f"at least {SLOWEST_HZ:g}: fewer devices a line, or a higher baud rate"
        raise ConfigError(where, "readings of a chamber a second", f"{update_hz:.2g}", allowed)
    age_s = max(limits.reading_age_s, min(reading_age_s, OLDEST_READING_S))
    return with_changes(limits, reading_age_s=age_s)


def check_rating(limits: Limits, rating: Rating, where: str) -> None:
    """Refuse limits beyond a platform's rating.

    Parameters
    ----------
    limits : Limits
        Limits of commands and readings.
    rating : Rating
    where : str
        File in errors.

    Raises
    ------
    ConfigError
        With the key of the limit.
    """
    top = rating.maximum_pa
    rated = f"the platform is rated for {rating.minimum_pa:g} to {top:g} Pa"
    if limits.maximum_pa >= top:
        allowed = f"input should be less than {top:g}: {rated}"
        raise ConfigError(where, "limits.maximum_pa", limits.maximum_pa, allowed)
    for name, value, most in (
        ("over_pressure_pa", limits.over_pressure_pa, OVER_PRESSURE * top),
        ("burst_pressure_pa", limits.burst_pressure_pa, BURST * top),
    ):
        if value > most:
            raise ConfigError(where, f"limits.{name}", value, f"at most {most:g}: {rated}")
    if limits.minimum_pa < rating.minimum_pa:
        allowed = f"at least {rating.minimum_pa:g}: {rated}"
        raise ConfigError(where, "limits.minimum_pa", limits.minimum_pa, allowed)
