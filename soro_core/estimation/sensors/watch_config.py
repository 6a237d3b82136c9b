"""Parameters of the watch over the sensors: when a residual or a delay is named."""

from __future__ import annotations

from pydantic import Field

from soro_core.config import Strict


class WatchConfig(Strict):
    """What is still a good sensor; a worse one is named in the note of the status, which stays ok."""

    nis_time_s: float = Field(
        1.0, gt=0.05, le=60, description="time constant of the mean of the normalised innovation squared"
    )
    nis_false_alarm: float = Field(
        1e-6,
        gt=1e-15,
        lt=0.3,
        description="probability with which the mean of a good sensor, whose innovations are white, is named",
    )
    delay_time_s: float = Field(
        1.0,
        gt=0.1,
        le=1e3,
        description="time constant of the estimated delay, once the fit is four times as old: a delay that "
        "begins is then named within 2 s",
    )
    delay_known_after_s: float = Field(
        1.5,
        ge=0,
        le=1e3,
        description="age of a fit before which nothing is named: fewer rows do not tell load and delay",
    )
    delay_correlation_s: float = Field(
        0.1,
        gt=0,
        le=10,
        description="time after which the filter's errors are independent: it counts how much samples say",
    )
    delay_allowed_s: float = Field(
        0.005,
        gt=0,
        le=2,
        description="a delay not declared up to here is not named: one tick at 200 Hz",
    )
    delay_deviations: float = Field(
        0.3,
        gt=0,
        le=10,
        description="deviations of the fit, times its misfit, by which a delay exceeds the allowed one when "
        "it is named; they count the prior of the load, and are several times the scatter of the delay",
    )
