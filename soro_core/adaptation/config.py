"""Keys of the learner; in units of the model, so that they hold for other arms."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field, model_validator

from soro_core.arrays import Array
from soro_core.config import Strict, parse
from soro_core.robot.coordinates import strain_fields

if TYPE_CHECKING:
    from soro_core.adaptation.scales import Scales
    from soro_core.model import SoftArm


# Mass at the tip that is expected, and the least one, as parts of the mass of the links: the three-bellow arm
# of 17 g carries 30 g and is tuned with a prior of 100 g.
MASS_PART, LEAST_PART = 6.0, -0.6
# Readings, play, and errors of the model that change from sample to sample, as a pressure in each chamber
# [Pa]; on the three-bellow arm it is 0.3 units of force.
NOISE_PA = 500.0


# Gain of the mass on the tracking error, in units of the model: 0.05 kg^2/J on the three-bellow arm.
FOLLOW = 0.0087


class LearnerConfig(Strict):
    """How fast and how far is learned."""

    mass_std_kg: float | None = Field(
        None, gt=0, le=100, description="prior deviation of the mass at the tip; default: six times the arm's"
    )
    weight_std: float = Field(
        1.0, gt=0, le=100, description="prior deviation of each entry of W, in units of the arm's stiffness"
    )
    mass_lower_kg: float | None = Field(
        None,
        ge=-100,
        le=0,
        description="least mass at the tip beyond the robot file's; default: -0.6 of the arm's mass",
    )
    mass_upper_kg: float | None = Field(
        None,
        gt=0,
        le=100,
        description="largest mass at the tip beyond the robot file's; default: six times the arm's mass",
    )
    damping_std: float = Field(
        0.3,
        gt=0,
        le=10,
        description="prior deviation of the damping of the stretch and of the bend of a link, as a part of "
        "the critical one",
    )
    gain_std: float = Field(
        0.015, gt=0, le=1, description="prior deviation of a chamber's gain from the mean of its link"
    )
    slope_std: float = Field(
        3.0,
        gt=0,
        le=20,
        description="prior deviation of the area slope of a link's chambers from the file's",
    )
    weight_bound: float = Field(20.0, gt=0, le=1e4, description="largest entry of W")
    noise: float | None = Field(
        None,
        gt=0,
        le=100,
        description="deviation of the residual, in units of force; default: that of 500 Pa in the chambers",
    )
    low_pass_per_s: float = Field(5.0, gt=0, le=1e3, description="low-pass of both sides [rad/s]")
    forget_s: float = Field(4.0, gt=0, le=1e4, description="time after which samples are forgotten")
    damping_forget_s: float = Field(
        8.0, gt=0, le=1e4, description="the same of the damping, however large the residual"
    )
    forget_factor: float = Field(
        8.0, ge=0, le=1e3, description="how much faster they are forgotten while the residual is large"
    )
    mass_walk_per_s: float = Field(
        1e-3,
        ge=0,
        le=1,
        description="variance by which the mass may move in a second while the residual is large, as a part "
        "of its prior variance",
    )
    bound_s: float = Field(
        1.0, gt=0, le=100, description="time of the mass at its bound after which the status says so"
    )

    @model_validator(mode="after")
    def _ordered(self) -> LearnerConfig:
        if self.weight_bound <= self.weight_std:
            raise ValueError("weight_bound must be above weight_std")
        return self


class CompleteLearnerConfig(LearnerConfig):
    """Keys of the learner with a value for each of them."""

    mass_std_kg: float
    mass_lower_kg: float
    mass_upper_kg: float
    noise: float


def mass_prior(arm: SoftArm) -> tuple[float, float, float]:
    """Return deviation, lower and upper bound [kg] of the mass at the tip beyond that of the robot file."""
    mass = sum(link.mass for link in arm.robot.links)
    return MASS_PART * mass, LEAST_PART * mass, MASS_PART * mass


def follow_rate(mass_std_kg: float, arm: SoftArm, scales: Scales) -> float:
    """Return g of m' = -g Y_m' s [kg^2/J]: the mass's variance by the energy of one unit of q and force.

    Parameters
    ----------
    mass_std_kg : float
        Deviation of the mass [kg].
    arm : SoftArm
        Strains that are uniform along its links count, whatever other coefficients there are.
    scales : Scales
    """
    uniform = strain_fields(arm.robot).uniform ** 2
    return FOLLOW * mass_std_kg**2 / float((uniform * scales.force) @ scales.q)


def complete_learner(config: LearnerConfig, arm: SoftArm, force: Array) -> CompleteLearnerConfig:
    """Return the keys of the learner with what is not stated found from the model.

    Parameters
    ----------
    config : LearnerConfig
        Keys as they are stated.
    arm : SoftArm
        Its links give the masses, its chambers the noise.
    force : ndarray (n_q,)
        Units of force.
    """
    # The row on which the noise acts most; an arm without chambers has none, and learns nothing.
    by_pa = np.linalg.norm(arm.actuation_matrix(np.zeros(arm.n_q)), axis=1) / force
    noise = NOISE_PA * float(np.max(by_pa)) or 1.0
    stated = {
        name: value for name in LearnerConfig.model_fields if (value := getattr(config, name)) is not None
    }
    found = dict(zip(("mass_std_kg", "mass_lower_kg", "mass_upper_kg"), mass_prior(arm), strict=True))
    return parse(found | {"noise": noise} | stated, CompleteLearnerConfig, where="controller: law_options")
