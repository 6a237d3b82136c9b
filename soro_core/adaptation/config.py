"""Keys of the learner; in units of the model, so that they hold for other arms."""

from __future__ import annotations

from pydantic import Field, model_validator

from soro_core.config import Strict


class LearnerConfig(Strict):
    """How fast and how far is learned."""

    mass_std_kg: float = Field(0.1, gt=0, le=100, description="prior deviation of the mass at the tip")
    weight_std: float = Field(
        1.0, gt=0, le=100, description="prior deviation of each entry of W, in units of the arm's stiffness"
    )
    mass_lower_kg: float = Field(-0.01, ge=-100, le=0, description="least mass beyond the robot file's")
    mass_upper_kg: float = Field(0.1, gt=0, le=100, description="largest mass beyond the robot file's")
    weight_bound: float = Field(20.0, gt=0, le=1e4, description="largest entry of W")
    noise: float = Field(0.3, gt=0, le=100, description="deviation of the residual, in units of force")
    low_pass_per_s: float = Field(5.0, gt=0, le=1e3, description="low-pass of both sides [rad/s]")
    forget_s: float = Field(5.0, gt=0, le=1e4, description="time after which samples are forgotten")
    forget_factor: float = Field(
        30.0, ge=0, le=1e3, description="how much faster they are forgotten while the residual is large"
    )
    bound_s: float = Field(1.0, gt=0, le=100, description="time at a bound after which the prior is restored")

    @model_validator(mode="after")
    def _ordered(self) -> LearnerConfig:
        if self.weight_bound <= self.weight_std:
            raise ValueError("weight_bound must be above weight_std")
        return self
