"""Rigid bodies, and arms that touch them: `BodyWorld` and `simulate_world`, docs/bodies.md."""

from soro_core.bodies.body import (
    BallShape,
    BoxShape,
    CapsuleShape,
    CylinderShape,
    GroundShape,
    Hinge,
    RigidBody,
)
from soro_core.bodies.simulate import ContactRows, WorldResult, simulate_world
from soro_core.bodies.world import BodyWorld

__all__ = [
    "BallShape",
    "BodyWorld",
    "BoxShape",
    "CapsuleShape",
    "ContactRows",
    "CylinderShape",
    "GroundShape",
    "Hinge",
    "RigidBody",
    "WorldResult",
    "simulate_world",
]
