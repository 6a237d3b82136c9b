"""Noise of the filter for another arm: that of the three-bellow arm, times the ratio of the arms' scales.

The defaults of `EstimatorConfig` are tuned for the three-bellow arm. They are parts of scales of its model:
an error of the model is a part of the elastic force of a bend, and accelerates the arm as this force does.
A ratio of 1 gives the defaults themselves. docs/gains.md has the table.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

from soro_core.adaptation.modes import first_mode
from soro_core.adaptation.scales import BEND_RAD
from soro_core.config import Strict, with_changes
from soro_core.errors import ConfigError
from soro_core.estimation.config import EstimatorConfig, InitialNoise, LearnedProcessNoise, ProcessNoise
from soro_core.model import SoftArm
from soro_core.robot import Robot
from soro_core.robot.coordinates import strain_fields

Section = TypeVar("Section", bound=Strict)

# A force that changes as fast as the arm: its second derivative grows with the square of the frequency, and
# the density of noise that makes it with the root of a period. The sensors of a faster arm are no faster: its
# noise is that of the tuned one.
_DRIFT = 1.5
# Figures of a ratio: the noises are not known better, and the arm that they are tuned for gets exactly 1.
_FIGURES = 3


@dataclass(frozen=True)
class NoiseScales:
    """What the noises of an arm are parts of.

    Attributes
    ----------
    curvature_per_m : float
        Curvature of a link that is bent by one unit [1/m].
    bend_acceleration, stretch_acceleration : float
        Accelerations of curvature [1/(m s^2)] and of elongation [1/s^2] by one unit of force.
    bend_rate_per_s, stretch_rate_per_s : float
        Angular frequencies of the first modes of strains that are uniform along their links [rad/s].
    shapes : float
        Coefficients of one bending along the arm.
    """

    curvature_per_m: float
    bend_acceleration: float
    stretch_acceleration: float
    bend_rate_per_s: float
    stretch_rate_per_s: float
    shapes: float


# Of tue_three_bellow, which tests/soro_core/estimation compares with its robot file.
TUNED_FOR = NoiseScales(10.0, 1625.8, 558.0, 40.321, 236.22, 1.0)


def noise_scales(robot: Robot) -> NoiseScales:
    """Return the scales of a robot; those of a kind of strain that it does not have are the tuned ones.

    Raises
    ------
    ConfigError
        If a coordinate has no stiffness.
    """
    arm = SoftArm(robot)
    fields = strain_fields(robot)
    bend, stretch = first_mode(arm, stretch=False), first_mode(arm, stretch=True)
    bends = [strain for strain in fields.strains if strain.startswith("bending")]
    coefficients = sum(fields.strains[field].startswith("bending") for field in fields.index)
    return NoiseScales(
        curvature_per_m=BEND_RAD * len(robot.links) / robot.length,
        bend_acceleration=bend.acceleration if bend else TUNED_FOR.bend_acceleration,
        stretch_acceleration=stretch.acceleration if stretch else TUNED_FOR.stretch_acceleration,
        bend_rate_per_s=bend.uniform_rate_per_s if bend else TUNED_FOR.bend_rate_per_s,
        stretch_rate_per_s=stretch.uniform_rate_per_s if stretch else TUNED_FOR.stretch_rate_per_s,
        shapes=float(max(coefficients, 1) / max(len(set(bends)), 1)),
    )


def scaled_noise(config: EstimatorConfig, robot: Robot) -> EstimatorConfig:
    """Return the parameters with every noise that has its default scaled to a robot.

    Parameters
    ----------
    config : EstimatorConfig
        With `scale_noise: false`, it is returned as it is.
    robot : Robot
        Robot of the robot file. Without stiffness in one of its strains it has no scale, and gets the
        defaults.
    """
    if not config.scale_noise:
        return config
    try:
        arm = noise_scales(robot)
    except ConfigError:
        return with_changes(config, scale_noise=False)
    bend = _ratio(arm.bend_acceleration, TUNED_FOR.bend_acceleration)
    stretch = _ratio(arm.stretch_acceleration, TUNED_FOR.stretch_acceleration)
    curvature = _ratio(arm.curvature_per_m, TUNED_FOR.curvature_per_m)
    stretch_rate = arm.stretch_rate_per_s / TUNED_FOR.stretch_rate_per_s
    bend_rate = arm.bend_rate_per_s / TUNED_FOR.bend_rate_per_s
    process = {
        "stretch_acceleration": stretch,
        "curvature_acceleration_per_m": bend,
        "stretch_disturbance": _ratio(stretch * min(stretch_rate, 1.0) ** _DRIFT, 1.0),
        "curvature_disturbance_per_m": _ratio(bend * min(bend_rate, 1.0) ** _DRIFT, 1.0),
    }
    initial = {
        "curvature_std_per_m": curvature,
        "stretch_rate_std_per_s": _ratio(stretch_rate, 1.0),
        "curvature_rate_std_per_m_s": curvature * _ratio(bend_rate, 1.0),
        "stretch_disturbance_std": stretch,
        "curvature_disturbance_std_per_m": bend,
    }
    # What a model of constant strain leaves of the orientation falls with the square of its coefficients.
    pose = {"orientation_model_std_rad": _ratio(1.0, arm.shapes**2)}
    return with_changes(
        config,
        scale_noise=False,
        process=_scaled(config.process, ProcessNoise(), process),
        learned_process=_scaled(config.learned_process, LearnedProcessNoise(), process),
        initial=_scaled(config.initial, InitialNoise(), initial),
        pose=_scaled(config.pose, type(config.pose)(), pose),
    )


def _ratio(value: float, tuned: float) -> float:
    return float(f"{value / tuned:.{_FIGURES}g}")


def _scaled(section: Section, default: Section, ratios: dict[str, float]) -> Section:
    """Return a section in which each value that is the default is multiplied by its ratio."""
    values = {
        name: getattr(default, name) * ratio
        for name, ratio in ratios.items()
        if getattr(section, name) == getattr(default, name)
    }
    return with_changes(section, **values)
