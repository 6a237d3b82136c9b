"""Keys of an excitation: its stages, its times and the motion that it may make."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias, get_args

from pydantic import Field, field_validator, model_validator

from soro_core.config import Floats, Strict

Stage: TypeAlias = Literal["singles", "pairs", "together", "creep", "steps", "sweeps"]
STAGES: tuple[Stage, ...] = get_args(Stage)


class MotionLimits(Strict):
    """Motion beyond which an excitation stops and vents."""

    box_m: Floats = Field(
        (),
        description="box of the outermost pose sensor: half its width about the sensor's place at rest, or "
        "x, y, z lowest and x, y, z highest in the frame of the poses; default: the arm's length",
    )
    bend_rad: float = Field(
        2.6,
        gt=0,
        le=7,
        description="largest rotation of a sensor from its orientation at rest; above pi: no limit",
    )
    silence_s: float = Field(0.5, gt=0, le=10, description="longest time without a sample of a sensor")

    @field_validator("box_m")
    @classmethod
    def _one_or_six(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if len(value) == 1 and value[0] > 0.0:
            return value
        if len(value) in (0, 6) and all(a < b for a, b in zip(value[:3], value[3:], strict=True)):
            return value
        raise ValueError("one number above 0, or three lowest and three highest coordinates")


class ExciteConfig(Strict):
    """Keys of an excitation; times are the longest ones, a level ends when the arm is still."""

    stages: Annotated[tuple[Stage, ...], Field(strict=False)] = Field(
        STAGES, min_length=1, description="stages, in this order"
    )
    levels: int = Field(
        4,
        ge=1,
        le=20,
        description="levels of one chamber up to the highest, closer to each other at low ones",
    )
    maximum_pa: float | None = Field(
        None,
        gt=0,
        le=1e6,
        description="highest set point; default: that of the limits, the platform and the robot",
    )
    minimum_pa: float | None = Field(
        None,
        ge=-101e3,
        le=0,
        description="lowest set point; default: that of the limits, the platform and the robot",
    )
    rest_s: float = Field(1.5, ge=0.5, le=60, description="time without pressure before the first level")
    ramp_s: float = Field(0.2, ge=0, le=60, description="time of a change of level, longer at the limits")
    hold_s: float = Field(
        1.35,
        ge=0.4,
        le=600,
        description="time at a level, longer at the expense of what the levels before have left",
    )
    shortest_hold_s: float = Field(
        1.1,
        ge=0.4,
        le=600,
        description="shortest time at a level, and for how long the arm must have stood still at its end; "
        "soro identify takes rests of 0.75 s and more",
    )
    creep_s: float = Field(4.0, gt=0, le=3600, description="time at the highest level, and after it at none")
    step_s: float = Field(0.8, gt=0, le=600, description="time after each fast step")
    sweep_s: float = Field(4.0, gt=0, le=3600, description="time of each sweep")
    sweep_low_hz: float = Field(0.4, gt=0, le=50, description="frequency at the start of a sweep")
    sweep_high_hz: float = Field(
        12.0,
        gt=0,
        le=100,
        description="frequency at the end of a sweep; lower where the lag of the regulators leaves less than "
        "a quarter of the amplitude",
    )
    sweep_part: float = Field(
        0.15,
        gt=0,
        le=0.5,
        description="amplitude of a sweep, part of the range; smaller where the rate limits need it",
    )
    repeat: int = Field(1, ge=1, le=100, description="times that all stages are done")
    duration_s: float = Field(
        0.0, ge=0, le=86400, description="longest time of all stages, to which their times are scaled; 0: no"
    )
    release: bool = Field(False, description="at the end a person bends the arm and lets it go")
    release_s: float = Field(60.0, ge=1, le=3600, description="longest wait for the release")
    motion: MotionLimits = Field(MotionLimits(), description="motion that ends the excitation")

    @field_validator("stages")
    @classmethod
    def _once_each(cls, value: tuple[Stage, ...]) -> tuple[Stage, ...]:
        if len(set(value)) != len(value):
            raise ValueError(f"each of {', '.join(STAGES)} once")
        return value

    @model_validator(mode="after")
    def _ordered(self) -> ExciteConfig:
        if self.shortest_hold_s > self.hold_s:
            raise ValueError("shortest_hold_s must not be above hold_s")
        if self.sweep_low_hz >= self.sweep_high_hz:
            raise ValueError("sweep_low_hz must be below sweep_high_hz")
        return self
