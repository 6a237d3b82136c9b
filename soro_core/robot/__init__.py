"""Frozen description of a robot and its strict loading."""

from soro_core.robot.basis import shape_integrals, shape_values, strain_rows
from soro_core.robot.description import Calibration, Robot
from soro_core.robot.link import Chamber, Creep, Hysteresis, Link, Material
from soro_core.robot.load import load_robot, robot_from_dict
from soro_core.robot.section import link_damping, link_stiffness, shear_factors
from soro_core.robot.strain import StrainField

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
    "shape_integrals",
    "shape_values",
    "shear_factors",
    "strain_rows",
]
