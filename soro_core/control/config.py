"""Parameters of the controller; the defaults are tuned for the three-bellow robot."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from soro_core.config import Floats, Strict, Strings
from soro_core.errors import ConfigError
from soro_core.robot import Robot

ADAPTABLE = (
    "a1",
    "a2",
    "a4",
    "a5",
    "damping_stretch",
    "damping_curvature",
    "tip_mass",
    "link_mass",
    "chamber_gain",
)


def require_chambers(robot: Robot, where: str) -> None:
    """Refuse a robot that nothing can be commanded of.

    Raises
    ------
    ConfigError
        If it has no chambers.
    """
    if not robot.chamber_names:
        raise ConfigError(where, "robot", f"{robot.name}, which has no chambers", "a robot with chambers")


class Gains(Strict):
    """Feedback gains: one value a strain of a link, repeated for every link, or one a coordinate.

    A value of a strain is that of a uniform strain; of one with several coefficients it acts on the mean
    square along the link (K_p = k_p W, `soro_core.robot.coordinates`), so that the law is the same in every
    basis. Values of coordinates stand on the diagonal as they are.
    """

    k_p: Floats = Field((0.4, 1e-6, 1e-6), min_length=1, description="K_p: J on stretch, J m^2 on curvature")
    k_d: Floats = Field(
        (0.0, 1e-7, 1e-7), min_length=1, description="K_d: J s on stretch, J m^2 s on curvature"
    )
    lambda_per_s: Floats = Field((4.0, 4.0, 4.0), min_length=1, description="Lambda [1/s]")

    @model_validator(mode="after")
    def _not_negative(self) -> Gains:
        for name in ("k_p", "k_d", "lambda_per_s"):
            if min(getattr(self, name)) < 0.0:
                raise ValueError(f"{name} must not be negative")
        return self


class Adaptation(Strict):
    """Which parameters are adapted, how fast, and within which bounds; the lists belong together."""

    parameters: Strings = Field(
        ("tip_mass",), description=f"adapted parameters, any of {', '.join(ADAPTABLE)}"
    )
    gain: Floats = Field((0.05,), description="diagonal of Gamma, one a parameter")
    lower: Floats = Field((0.0,), description="lower bounds, in the parameter's unit")
    upper: Floats = Field((0.1,), description="upper bounds, in the parameter's unit")
    margin_stretch_n_m: float = Field(10.0, gt=0, le=1e6, description="least a1 - a2")
    margin_bend_n_m_rad: float = Field(1e-4, gt=0, le=1e3, description="least a4 - a5")
    dead_zone_stretch_per_s: float = Field(0.0, ge=0, le=10, description="|s| below which nothing is learnt")
    dead_zone_curvature_per_m_s: float = Field(
        0.0, ge=0, le=1e3, description="|s| below which nothing is learnt"
    )
    leakage_per_s: float = Field(
        0.0, ge=0, le=10, description="sigma modification: pull to the robot's values"
    )
    hold_saturated: bool = Field(
        True,
        description="do not learn what would only ask for more of a force that the pressures cannot make",
    )

    @model_validator(mode="after")
    def _consistent(self) -> Adaptation:
        n = len(self.parameters)
        for name in ("gain", "lower", "upper"):
            if len(getattr(self, name)) != n:
                raise ValueError(f"{name} must have as many values as parameters ({n})")
        for parameter in self.parameters:
            if parameter not in ADAPTABLE:
                raise ValueError(f"parameters: {parameter!r} is none of {', '.join(ADAPTABLE)}")
        if len(set(self.parameters)) != n:
            raise ValueError("parameters: a name stands twice")
        for name, gain, lower, upper in zip(self.parameters, self.gain, self.lower, self.upper, strict=True):
            if gain < 0.0:
                raise ValueError(f"gain of {name} must not be negative")
            if not lower < upper:
                raise ValueError(f"lower bound of {name} must be below its upper bound")
            if name.endswith("mass") and lower < 0.0:
                raise ValueError(f"lower bound of {name} must not be negative")
            if name == "chamber_gain" and lower <= 0.0:
                raise ValueError(
                    "lower bound of chamber_gain must be above 0: the estimate must stay invertible"
                )
        return self


class Pressures(Strict):
    """How forces become set points."""

    minimum_pa: float = Field(0.0, ge=-1e5, le=1e6, description="lowest set point")
    maximum_pa: float = Field(90e3, gt=-1e5, le=1e6, description="highest set point")
    regularisation: float = Field(1e-8, gt=0, le=1, description="pull towards preferred_pa, relative")
    preferred_pa: float = Field(
        45e3, ge=-1e5, le=1e6, description="pressure preferred where the force leaves a choice"
    )
    force_weight: Floats = Field(
        (0.3, 1.0, 1.0),
        min_length=1,
        description="weight of each strain of a link, or coordinate, where not all forces can be made",
    )
    rise_pa_s: float = Field(200e3, gt=0, le=1e7, description="fastest rise that the limiter allows")
    fall_pa_s: float = Field(400e3, gt=0, le=1e7, description="fastest fall that the limiter allows")
    preview_s: float = Field(
        0.033,
        ge=0,
        le=1,
        description="state and reference are taken this far ahead, to when a set point acts: what the lag's "
        "inverse leaves, dead time, one tick and half a hold",
    )
    lag_s: float = Field(
        0.052, ge=0, le=10, description="time constant of the regulators, inverted; 0 for none"
    )
    lag_filter_s: float = Field(0.02, gt=0, le=10, description="time constant that is left of it")

    @model_validator(mode="after")
    def _ordered(self) -> Pressures:
        if not self.minimum_pa < self.maximum_pa:
            raise ValueError("minimum_pa must be below maximum_pa")
        if min(self.force_weight) <= 0.0:
            raise ValueError("force_weight must be positive")
        return self


class ReferenceConfig(Strict):
    """What is tracked until a topic says otherwise."""

    kind: Literal["circle", "set_point", "hold"] = Field(
        "circle", description="circle of the tip, a set point, or hold where the arm is found"
    )
    start_s: float = Field(
        3.0, gt=0, le=1e3, description="length of the smooth start, and of changes of reference"
    )
    curvature_per_m: float = Field(10.0, ge=0, le=1e3, description="curvature of every link on the circle")
    period_s: float = Field(4.0, gt=0, le=1e4, description="period of the circle")
    elongation: float = Field(0.0, gt=-0.9, le=10, description="elongation of every link on the circle")
    choose_elongation: bool = Field(
        True,
        description="choose the elongation so that the model's mean pressure is mean_pressure_pa instead",
    )
    mean_pressure_pa: float = Field(45e3, ge=-1e5, le=1e6, description="mean pressure for choose_elongation")
    set_point: Floats = Field(
        (0.0, 0.0, 0.0),
        description="for kind set_point: one value a strain of a link, uniform along it, or the coordinates",
    )
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


class ControllerConfig(Strict):
    """Parameters of the controller."""

    law: Literal["adaptive"] = Field("adaptive", description="control law")
    compensation: Literal["reference", "measured"] = Field(
        "reference",
        description="state at which the model's forces are taken: measured, as the proof wants it, or "
        "that of the reference, which keeps the arm's own stiffness in the loop and so bears delay and lag",
    )
    adapt: bool = Field(True, description="false: the same law and gains with the robot file's parameters")
    gains: Gains = Field(Gains(), description="feedback")
    adaptation: Adaptation = Field(Adaptation(), description="adaptation")
    pressures: Pressures = Field(Pressures(), description="allocation and regulators")
    reference: ReferenceConfig = Field(ReferenceConfig(), description="reference")
