"""Parameters of the watch over the sensors: their noise, and when a residual is named."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import Field, model_validator

from soro_core.config import Strict

_FORMER = frozenset(
    f"delay_{key}" for key in ("time_s", "known_after_s", "correlation_s", "allowed_s", "deviations")
)


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
    noise_time_s: float = Field(
        1.0,
        ge=0,
        le=1e3,
        description="time constant of the noise that innovations show, which takes the place of the stated "
        "one; 0: the stated one stays",
    )

    @model_validator(mode="before")
    @classmethod
    def _without_delays(cls, data: Any) -> Any:
        """Leave out the keys of delays, which the probe judges today; files of past runs have them."""
        return {k: v for k, v in data.items() if k not in _FORMER} if isinstance(data, Mapping) else data
