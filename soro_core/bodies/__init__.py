"""Rigid bodies, and arms that touch them: `BodyWorld` and `simulate_world`, docs/bodies.md."""

from soro_core.bodies.body import (
    BallShape,
    BodyMotion,
    BoxShape,
    CapsuleShape,
    CylinderShape,
    GroundShape,
    Hinge,
    RigidBody,
)
from soro_core.bodies.simulate import ContactRows, WorldResult, simulate_world
from soro_core.bodies.stepper import WorldState, WorldStepper
from soro_core.bodies.world import BodyWorld

__all__ = [
    "BallShape",
    "BodyMotion",
    "BodyWorld",
    "BoxShape",
    "CapsuleShape",
    "ContactRows",
    "CylinderShape",
    "GroundShape",
    "Hinge",
    "RigidBody",
    "WorldResult",
    "WorldState",
    "WorldStepper",
    "simulate_world",
]
