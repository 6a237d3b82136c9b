"""Frozen description of a robot and its strict loading."""

from soro_core.robot.description import Calibration, Robot
from soro_core.robot.link import Chamber, Creep, Hysteresis, Link, Material, StrainField
from soro_core.robot.load import load_robot, robot_from_dict
from soro_core.robot.section import link_damping, link_stiffness, shear_factors

__all__ = [
    "Calibration",
    "Chamber",
    "Creep",
    "Hysteresis",
    "Link",
    "Material",
    "Robot",
    "StrainField",
    "link_damping",
    "link_stiffness",
    "load_robot",
    "robot_from_dict",
    "shear_factors",
]
