"""Frozen description of a robot and its strict loading."""

from soro_core.robot.basis import shape_integrals, shape_values, strain_rows
from soro_core.robot.chamber import Chamber, Tendon
from soro_core.robot.description import Calibration, Robot, SensorBody, refuse_tendons
from soro_core.robot.discretisation import Discretisation, with_basis
from soro_core.robot.link import Creep, Hysteresis, Link, Material
from soro_core.robot.load import load_robot, robot_from_dict, save_robot
from soro_core.robot.section import link_damping, link_stiffness, shear_factors
from soro_core.robot.strain import StrainField
from soro_core.robot.surroundings import BaseState, Contacts, Plane, PointMass, Shake, Sphere, TipConstraint

__all__ = [
    "BaseState",
    "Calibration",
    "Chamber",
    "Contacts",
    "Creep",
    "Discretisation",
    "Hysteresis",
    "Link",
    "Material",
    "Plane",
    "PointMass",
    "Robot",
    "SensorBody",
    "Shake",
    "Sphere",
    "StrainField",
    "Tendon",
    "TipConstraint",
    "link_damping",
    "link_stiffness",
    "load_robot",
    "refuse_tendons",
    "robot_from_dict",
    "save_robot",
    "shape_integrals",
    "shape_values",
    "shear_factors",
    "strain_rows",
    "with_basis",
]
