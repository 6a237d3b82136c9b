"""What a first pressurisation is given, where it is, and what it orders."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from pydantic import Field, field_validator

from soro_core.config import Floats, Strict
from soro_core.hardware.finding import Finding
from soro_core.hardware.port import Array
from soro_core.hil.judge import Expectation
from soro_core.hil.measured import Hold, Rest, Vent
from soro_core.hil.paced import Sample

Phase: TypeAlias = Literal["rest", "confirm", "settle", "hold", "direction", "vent", "done"]
Do: TypeAlias = Literal["hold", "vent", "reset"]
# The finding that names chambers of which nothing is known, or not all.
NOT_EXAMINED = "not examined"


class FirstPressureConfig(Strict):
    """How far and how slowly."""

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
class Plan:
    """What is done and what is expected of it.

    Attributes
    ----------
    confirm : bool
        Whether a person is asked before each chamber.
    directions : tuple of str
        For each chamber in which direction the tip goes, to be asked at its highest step; empty: not asked.
    """

    config: FirstPressureConfig
    expected: Expectation
    confirm: bool = True
    directions: tuple[str, ...] = ()


@dataclass(frozen=True)
class State:
    """Where the procedure is, and what it has found.

    Attributes
    ----------
    samples : tuple of Sample
        Those of the present phase.
    rest, before : Rest or None
        Readings before everything, and just before the present chamber.
    answer : Finding or None
        What the person who watches has said of the present chamber.
    asks : bool
        Whether a question is open.
    """

    phase: Phase = "rest"
    chamber: int = 0
    step: int = 0
    samples: tuple[Sample, ...] = ()
    rest: Rest | None = None
    before: Rest | None = None
    holds: tuple[Hold, ...] = ()
    vents: tuple[Vent, ...] = ()
    findings: tuple[Finding, ...] = ()
    answer: Finding | None = None
    tripped: bool = False
    skipped: tuple[str, ...] = ()
    asks: bool = False


@dataclass(frozen=True)
class Order:
    """What the loop has to do next: set points (n,) [Pa gauge], or a vent, or a reset; and what to ask."""

    setpoint_pa: Array
    do: Do = "hold"
    question: str = ""
