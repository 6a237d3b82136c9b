"""The section `model` of a scene: how the arm is computed, stated, or chosen by measurement."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import Field, field_validator, model_validator

from soro_core.config import Strict
from soro_core.robot import Discretisation
from soro_core.robot.discretisation import Integrator

REQUIREMENTS = "error: 1%, budget_us: 200 or rate_hz: 500"


class Requirement(Strict):
    """Criterion for the choice of a model: cheapest within an error, or most accurate within a time."""

    error: str = Field("", description="largest RMS error of the tip, in % of the arm's length, like 1%")
    budget_us: float = Field(0.0, ge=0, description="longest computing time of a tick [us]; 0: none")
    rate_hz: float = Field(
        0.0, ge=0, le=10000, description="rate at which the longest tick must fit into its period; 0: none"
    )

    @model_validator(mode="after")
    def _readable(self) -> Requirement:
        if sum(map(bool, (self.error, self.budget_us, self.rate_hz))) > 1:
            raise ValueError(f"one requirement: {REQUIREMENTS}")
        return self

    @field_validator("error")
    @classmethod
    def _per_cent(cls, value: str) -> str:
        if value:
            _percent(value)
        return value

    @property
    def given(self) -> bool:
        """Whether there is a requirement."""
        return bool(self.error or self.budget_us or self.rate_hz)

    @property
    def error_percent(self) -> float:
        """Largest error in % of the length; 0 for another requirement."""
        return _percent(self.error) if self.error else 0.0

    @property
    def tick_us(self) -> float:
        """Longest tick [us]; 0 for another requirement."""
        return 1e6 / self.rate_hz if self.rate_hz else self.budget_us

    @property
    def options(self) -> str:
        """The requirement as options of `soro trade`."""
        if self.error:
            return f"--error {self.error}"
        return f"--rate {self.rate_hz:g}Hz" if self.rate_hz else f"--budget {self.budget_us:g}us"

    def __str__(self) -> str:
        if self.error:
            return f"tip error of at most {self.error_percent:g} % of the length"
        if self.rate_hz:
            return f"longest tick within {self.tick_us:g} us ({self.rate_hz:g} Hz)"
        return f"longest tick within {self.budget_us:g} us"


class ModelSection(Discretisation, Requirement):
    """How the arm is computed; `auto` takes what `soro trade` has found for a requirement."""

    integrator: Integrator = Field("trapezoidal", description="time stepper of the twin")
    dt_s: float = Field(0.0025, gt=0, le=0.02, description="longest time step of the twin [s]")
    auto: bool = Field(False, description="take the model that soro trade has chosen for the requirement")

    @model_validator(mode="before")
    @classmethod
    def _short(cls, value: Any) -> Any:
        if isinstance(value, str) and value == "auto":
            return {"auto": True, "error": "1%"}
        if not isinstance(value, Mapping | ModelSection):
            raise ValueError(f"auto, or a mapping of keys: {', '.join(cls.model_fields)}")
        return value

    @model_validator(mode="after")
    def _auto_or_stated(self) -> ModelSection:
        given = self.model_fields_set
        stated = sorted(given & {*Discretisation.model_fields, "integrator", "dt_s"})
        if self.auto and stated:
            raise ValueError(f"no {stated[0]} beside auto: true, which chooses it")
        if self.auto and not self.requirement.given:
            raise ValueError(f"a requirement beside auto: true, one of {REQUIREMENTS}")
        if not self.auto and self.requirement.given:
            raise ValueError(f"auto: true beside a requirement ({REQUIREMENTS})")
        return self

    @property
    def requirement(self) -> Requirement:
        """The requirement alone."""
        return Requirement(error=self.error, budget_us=self.budget_us, rate_hz=self.rate_hz)

    @property
    def discretisation(self) -> Discretisation:
        """The keys that every node needs to build its arm."""
        return Discretisation(**{name: getattr(self, name) for name in Discretisation.model_fields})


def _percent(text: str) -> float:
    number = text.strip().removesuffix("%")
    try:
        value = float(number)
    except ValueError:
        value = 0.0
    if not text.strip().endswith("%") or not 0.0 < value <= 100.0:
        raise ValueError("a percentage of the arm's length above 0, like 1%")
    return value
