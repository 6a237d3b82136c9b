"""Parameters of the controller; gains come from the model, other defaults are for the three-bellow robot."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError, ValidationInfo, field_validator, model_validator

from soro_core.config import Floats, InnerError, Points, Strict
from soro_core.control.laws.registry import SHIPPED, find_law, named, with_folder
from soro_core.control.motion_config import EnableBounds, ForceControlConfig, MotionConfig
from soro_core.control.passivity.adaptation_config import Adaptation
from soro_core.errors import ConfigError
from soro_core.robot import Robot, refuse_tendons
from soro_core.robot.vectors import Vector3


def require_chambers(robot: Robot, where: str) -> None:
    """Refuse a robot without chambers, or with tendons.

    Raises
    ------
    ConfigError
        With the key `robot`.
    """
    refuse_tendons(robot, where)
    if not robot.chamber_names:
        raise ConfigError(where, "robot", f"{robot.name}, which has no chambers", "a robot with chambers")


class Gains(Strict):
    """Feedback gains: one value for each strain of a link, used for every link, or one for each coordinate.

    A value of a strain weighs the mean square of the strain along the link (K_p = k_p W with W of
    docs/model.md (4)), so that the law is the same in every basis. Values of coordinates are the diagonal.
    What is not stated comes from the model and the delay of the platform; ``gains: auto`` states nothing.
    """

    k_p: Floats | None = Field(
        None, min_length=1, description="K_p: J on stretch, J m^2 on curvature; default: from the model"
    )
    k_d: Floats | None = Field(
        None, min_length=1, description="K_d: J s on stretch, J m^2 s on curvature; default: from the model"
    )
    lambda_per_s: Floats | None = Field(
        None, min_length=1, description="Lambda [1/s]; default: from the delay of the platform"
    )

    @model_validator(mode="before")
    @classmethod
    def _short(cls, value: Any) -> Any:
        if value == "auto":
            return {}
        if not isinstance(value, Mapping | Gains):
            raise ValueError(f"auto, or a mapping of keys: {', '.join(cls.model_fields)}")
        return value

    @property
    def automatic(self) -> bool:
        """Whether no gain of the feedback is stated."""
        return self.k_p is None and self.k_d is None

    @model_validator(mode="after")
    def _not_negative(self) -> Gains:
        for name in ("k_p", "k_d", "lambda_per_s"):
            if min(getattr(self, name) or (0.0,)) < 0.0:
                raise ValueError(f"{name} must not be negative")
        return self

    @property
    def stated(self) -> bool:
        """Whether any of them is stated."""
        return self != Gains()


class AllocationConfig(Strict):
    """Allocation of pressures; keys of limits and lag default to those of limiter and platform."""

    minimum_pa: float | None = Field(
        None, ge=-1e5, le=1e6, description="lowest set point; default: that of the limits"
    )
    maximum_pa: float | None = Field(
        None, gt=-1e5, le=1e6, description="highest set point; default: that of the limits"
    )
    regularisation: float = Field(1e-8, gt=0, le=1, description="pull towards preferred_pa, relative")
    preferred_pa: float = Field(
        45e3, ge=-1e5, le=1e6, description="pressure preferred where the force leaves a choice"
    )
    force_weight: Floats | None = Field(
        None,
        min_length=1,
        description="weight of each strain of a link, or coordinate, if the pressures cannot make all "
        "forces; default: 0.3 of elongation and shears, 1 of bending and torsion",
    )
    rise_pa_s: float | None = Field(
        None, gt=0, le=1e7, description="fastest rise of a set point; default: that of the limits"
    )
    fall_pa_s: float | None = Field(
        None, gt=0, le=1e7, description="fastest fall of a set point; default: that of the limits"
    )
    preview_s: float | None = Field(
        None,
        ge=0,
        le=1,
        description="time ahead at which state and reference are taken, when a set point acts; default: one "
        "tick between nodes, dead time, and the part of lag and half a hold that the inverse leaves",
    )
    lag_s: float | None = Field(
        None,
        ge=0,
        le=10,
        description="time constant of the regulators, inverted, 0 for none; default: the platform's",
    )
    dead_time_s: float | None = Field(
        None, ge=0, le=1, description="time until a set point acts; default: a tick between nodes, dead time"
    )
    play_pa: float | None = Field(
        None, ge=0, le=1e5, description="play of set point and pressure, its width; default: the platform's"
    )
    lag_filter_s: float = Field(0.02, gt=0, le=10, description="time constant that remains of the lag")

    @model_validator(mode="after")
    def _ordered(self) -> AllocationConfig:
        low, high = self.minimum_pa, self.maximum_pa
        if low is not None and high is not None and not low < high:
            raise ValueError("minimum_pa must be below maximum_pa")
        if min(self.force_weight or (1.0,)) <= 0.0:
            raise ValueError("force_weight must be positive")
        return self


class ReferenceConfig(Strict):
    """The reference that is followed until a topic gives another one."""

    kind: Literal["circle", "set_point", "path", "hold"] = Field(
        "circle",
        description="circle of the tip, a set point, a path of the tip, or hold where the arm is found",
    )
    start_s: float = Field(
        3.0,
        gt=0,
        le=1e3,
        description="duration of the smooth start, and of the transition to a new reference; a stream of "
        "references (one within 1 s of the last) is followed from message to message",
    )
    curvature_per_m: float = Field(10.0, ge=0, le=1e3, description="curvature of every link on the circle")
    period_s: float = Field(4.0, gt=0, le=1e4, description="period of the circle")
    elongation: float = Field(0.0, gt=-0.9, le=10, description="elongation of every link on the circle")
    choose_elongation: bool = Field(
        True,
        description="choose the elongation so that the model's mean pressure is mean_pressure_pa instead",
    )
    mean_pressure_pa: float = Field(45e3, ge=-1e5, le=1e6, description="mean pressure for choose_elongation")
    learned_elongation: bool = Field(
        True,
        description="with choose_elongation: choose it anew by what the law has learned where a chamber that "
        "differs from the robot file lacks pressure on the circle; false: the circle stays as it is",
    )
    set_point: Floats = Field(
        (0.0, 0.0, 0.0),
        description="for kind set_point: one value a strain of a link, uniform along it, or the coordinates",
    )
    path_m: Points = Field(
        (),
        description="for kind path: points of the tip in the world, x, y and z of each, in rows or not; the "
        "tip goes straight from one to the next, as fast as `motion` says, and rests at each",
    )
    pause_s: float = Field(0.0, ge=0, le=1e4, description="for kind path: length of the rest at each point")
    press_n: Vector3 = Field(
        (0.0, 0.0, 0.0),
        description="force of the arm on what it meets, in the world: from press_s on the tip goes along it "
        "and presses; zeros: no press",
    )
    press_s: float = Field(0.0, ge=0, le=1e4, description="time after the begin of control of the press")
    rotation_weight_m: float = Field(
        0.0,
        ge=0,
        le=10,
        description="metres that a radian is worth in the inverse kinematics of a tip reference",
    )
    tip_tolerance_m: float = Field(
        0.01, gt=0, le=10, description="tip references that the arm misses by more are refused"
    )
    stretch_limit: float = Field(0.6, gt=0, lt=1, description="largest elongation or shear of a reference")
    bend_limit_rad: float = Field(
        3.0, gt=0, le=30, description="largest bending or torsion of a link of a reference"
    )
    stretch_rate_per_s: float = Field(
        0.3,
        gt=0,
        le=100,
        description="fastest elongation or shear of a reference by topic, and of the transition to it",
    )
    bend_rate_rad_s: float = Field(
        2.0,
        gt=0,
        le=1e3,
        description="fastest bending or torsion of a link of a reference by topic, and in the transition",
    )
    smoothing_s: float = Field(
        0.05,
        ge=0.005,
        le=10,
        description="time constant of each of the two lags that smooth transitions and streams; "
        "accelerations are at most 2 / smoothing_s times the fastest rates",
    )

    @model_validator(mode="after")
    def _in_threes(self) -> ReferenceConfig:
        if len(self.path_m) % 3 or (self.kind == "path" and not self.path_m):
            raise ValueError(f"x, y and z of one point or more as path_m, not {len(self.path_m)} numbers")
        return self


class ControllerConfig(Strict):
    """Parameters of the controller."""

    robot: str = Field(
        "",
        description="robot of the stated gains, a file or a name; default: the controlled robot",
    )
    law: str = Field(
        "composite",
        description="control law, a name of the registry or FILE.py:CLASS (docs/adding_a_law.md), or, in a "
        "program, its class",
    )
    law_options: Mapping[str, Any] = Field({}, description="keys of the law")
    joint: str = Field(
        "",
        description="topic of the measured angle of a joint (sensor_msgs/JointState, its first position), "
        "for a law that needs it: bodies/hand/joint; an angle that is missing or old ends the commands",
    )
    compensation: Literal["reference", "measured"] = Field(
        "reference",
        description="state at which the model's forces are evaluated: measured, as the proof requires, or "
        "reference, which keeps the stiffness of the arm in the loop and so tolerates delay and lag",
    )
    adapt: bool = Field(True, description="false: the same law and gains with the robot file's parameters")
    gains: Gains = Field(
        Gains(), description="feedback; auto: from the model of the arm and the delay of the platform"
    )
    adaptation: Adaptation = Field(Adaptation(), description="adaptation")
    pressures: AllocationConfig = Field(AllocationConfig(), description="allocation and regulators")
    reference: ReferenceConfig = Field(ReferenceConfig(), description="reference")
    motion: MotionConfig = Field(MotionConfig(), description="motions along paths of the tip")
    force: ForceControlConfig = Field(
        ForceControlConfig(), description="force at the tip: pressing, and its bound"
    )
    check_at_enable: Literal["refuse", "warn", "off"] = Field(
        "refuse",
        description="what a finding of the checks before ~/enable does; samples that are not fresh refuse "
        "with warn too; lockstep has no samples before it is enabled and is not checked",
    )
    probe_at_enable: Literal["auto", "refuse", "warn", "off"] = Field(
        "auto",
        description="what a finding of the probe does: a small pressure in each chamber before the law "
        "begins shows whether wiring, base and valves are those of the files; auto: refuse in real time, off "
        "in lockstep",
    )
    enable: EnableBounds = Field(EnableBounds(), description="bounds of the checks before ~/enable")

    @field_validator("law", mode="before")
    @classmethod
    def _known(cls, law: object) -> object:
        if isinstance(law, type):
            return named(law)
        if isinstance(law, str):
            find_law(law := with_folder(law, Path()))
        return law

    @field_validator("law_options")
    @classmethod
    def _allowed(cls, values: Mapping[str, Any], info: ValidationInfo) -> Mapping[str, Any]:
        if "law" not in info.data or (not values and info.data["law"] in SHIPPED):  # all have defaults
            return values
        law = find_law(info.data["law"])
        try:
            law.Options.model_validate(dict(values))
        except ValidationError as error:
            raise InnerError(error, law.Options) from None
        return values

    @model_validator(mode="after")
    def _of_one_law(self) -> ControllerConfig:
        # A value that is the default is no statement: scenes and nodes write every key out.
        own = [name for name in ("compensation", "adaptation") if getattr(self, name) not in _DEFAULTS[name]]
        if self.law != "adaptive" and own:
            raise ValueError(
                f"no {own[0]} beside law: {self.law}: it needs law: adaptive, which is to be stated"
            )
        return self


# Those of now, and of scenes that former versions have kept.
_DEFAULTS = {
    "compensation": (ControllerConfig.model_fields["compensation"].default,),
    "adaptation": (Adaptation(), Adaptation(gain=(0.05,), lower=(0.0,), upper=(0.1,))),
}
