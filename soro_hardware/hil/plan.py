"""Plan, state and orders of a first pressurisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from pydantic import Field, field_validator

from soro_core.arrays import Array
from soro_core.config import Floats, Strict
from soro_hardware.finding import Finding
from soro_hardware.hil.judge import Expectation
from soro_hardware.hil.measured import PressureHold, RestReadings, Vent
from soro_hardware.hil.paced import CycleSample

Phase: TypeAlias = Literal["rest", "confirm", "settle", "hold", "direction", "vent", "done"]
Do: TypeAlias = Literal["hold", "vent", "reset"]
# Name of the finding that lists chambers without a complete examination.
NOT_EXAMINED = "not examined"


class FirstPressureConfig(Strict):
    """Steps and times of a first pressurisation."""

    steps_pa: Floats = Field((5e3, 10e3, 20e3), description="set points of each chamber, rising [Pa gauge]")
    rest_s: float = Field(1.0, ge=0.2, le=60, description="time without pressure before the first step")
    hold_s: float = Field(2.0, ge=0.5, le=600, description="time for which each step is held")
    vent_s: float = Field(5.0, ge=0.5, le=60, description="longest time of a vent")
    rise_pa_s: float = Field(50e3, gt=0, le=200e3, description="fastest rise of a set point")

    @field_validator("steps_pa")
    @classmethod
    def _rising(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if not value or any(b <= a for a, b in zip((0.0, *value), value, strict=False)):
            raise ValueError("set points above 0, each higher than the one before")
        return value


@dataclass(frozen=True)
class HilPlan:
    """Steps of a procedure, and expectations.

    Attributes
    ----------
    config : FirstPressureConfig
        Steps and times.
    expected : Expectation
        Behaviour of a healthy platform.
    confirm : bool
        Whether the operator confirms each chamber.
    directions : tuple of str
        Expected direction of the tip for each chamber, a question at its highest step; empty for no question.
    """

    config: FirstPressureConfig
    expected: Expectation
    confirm: bool = True
    directions: tuple[str, ...] = ()


@dataclass(frozen=True)
class ProcedureState:
    """State of the procedure.

    Attributes
    ----------
    phase : Phase
        Present phase.
    chamber, step : int
        Numbers of the present chamber and step.
    samples : tuple of CycleSample
        Samples of the present phase.
    rest, before : RestReadings or None
        Readings at rest at the start, and just before the present chamber.
    holds, vents : tuple of PressureHold, tuple of Vent
        Results so far.
    findings : tuple of Finding
        Findings so far.
    answer : Finding or None
        The operator's answer about the present chamber.
    tripped : bool
        Whether the limiter has tripped.
    skipped : tuple of str
        Chambers that the operator skipped.
    asks : bool
        Whether a question is open.
    """

    phase: Phase = "rest"
    chamber: int = 0
    step: int = 0
    samples: tuple[CycleSample, ...] = ()
    rest: RestReadings | None = None
    before: RestReadings | None = None
    holds: tuple[PressureHold, ...] = ()
    vents: tuple[Vent, ...] = ()
    findings: tuple[Finding, ...] = ()
    answer: Finding | None = None
    tripped: bool = False
    skipped: tuple[str, ...] = ()
    asks: bool = False


@dataclass(frozen=True)
class Order:
    """Order for the next cycle: set points (n,) [Pa gauge], a vent or a reset; a question to the operator."""

    setpoint_pa: Array
    do: Do = "hold"
    question: str = ""
