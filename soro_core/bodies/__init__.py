"""Rigid bodies, and arms that touch them: `BodyWorld` and `simulate_world`, docs/bodies.md."""

from typing import TYPE_CHECKING

from soro_core.extras import lazy

if TYPE_CHECKING:
    from soro_core.bodies.body import Attachment as Attachment
    from soro_core.bodies.body import BodyMotion as BodyMotion
    from soro_core.bodies.body import Hinge as Hinge
    from soro_core.bodies.body import RigidBody as RigidBody
    from soro_core.bodies.shapes import BallShape as BallShape
    from soro_core.bodies.shapes import BoxShape as BoxShape
    from soro_core.bodies.shapes import CapsuleShape as CapsuleShape
    from soro_core.bodies.shapes import CylinderShape as CylinderShape
    from soro_core.bodies.shapes import GroundShape as GroundShape
    from soro_core.bodies.shapes import MeshShape as MeshShape
    from soro_core.bodies.simulate import ContactRows as ContactRows
    from soro_core.bodies.simulate import WorldResult as WorldResult
    from soro_core.bodies.simulate import simulate_world as simulate_world
    from soro_core.bodies.stepper import WorldState as WorldState
    from soro_core.bodies.stepper import WorldStepper as WorldStepper
    from soro_core.bodies.world import BodyWorld as BodyWorld

# A scene reads bodies without the code that moves them.
__all__, __getattr__ = lazy(
    __name__,
    {
        ".body": "Attachment BodyMotion Hinge RigidBody",
        ".shapes": "BallShape BoxShape CapsuleShape CylinderShape GroundShape MeshShape",
        ".simulate": "ContactRows WorldResult simulate_world",
        ".stepper": "WorldState WorldStepper",
        ".world": "BodyWorld",
    },
)
