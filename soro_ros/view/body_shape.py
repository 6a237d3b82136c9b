"""The surface of rigid bodies as quadrilaterals, in the frame of each."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from soro_core.arrays import Array
from soro_core.bodies import BallShape, BoxShape, CapsuleShape, GroundShape, MeshShape, RigidBody
from soro_core.robot import Plane

FREE_COLOUR, FIXED_COLOUR = np.array([0.90, 0.62, 0.0]), np.array([0.80, 0.74, 0.62])
_AROUND = 24


def faces_of(body: RigidBody) -> Array:
    """Corners (n, 4, 3) [m] of the faces of a body, counter-clockwise from outside; none of the ground."""
    shape = body.shape
    if isinstance(shape, GroundShape):
        return np.zeros((0, 4, 3))
    if isinstance(shape, BoxShape):
        side = np.array([[1, -1, -1], [1, 1, -1], [1, 1, 1], [1, -1, 1]])
        sides = [np.roll(sign * side[::sign], k, axis=1) for k in range(3) for sign in (1, -1)]
        return np.asarray(np.array(sides) * 0.5 * np.array(shape.size))
    if isinstance(shape, MeshShape):
        solid = shape.solid
        return np.asarray(solid.corners[solid.triangles[:, [0, 1, 2, 2]]])
    half = 0.0 if isinstance(shape, BallShape) else 0.5 * shape.length
    if isinstance(shape, BallShape | CapsuleShape):
        latitude = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 13)
        radius, height = shape.radius * np.cos(latitude), shape.radius * np.sin(latitude)
        low, high = latitude <= 1e-9, latitude >= -1e-9
        radius = np.concatenate((radius[low], radius[high]))
        height = np.concatenate((height[low] - half, height[high] + half))
    else:
        radius = np.array([0.0, shape.radius, shape.radius, 0.0])
        height = np.array([-half, -half, half, half])
    turn = np.linspace(0.0, 2.0 * np.pi, _AROUND + 1)
    rings = np.stack(
        [radius[:, None] * np.cos(turn), radius[:, None] * np.sin(turn), np.tile(height[:, None], turn.size)],
        axis=-1,
    )
    corners = (rings[:-1, :-1], rings[:-1, 1:], rings[1:, 1:], rings[1:, :-1])
    return np.stack(corners, axis=2).reshape(-1, 4, 3)


def colour_of(body: RigidBody) -> Array:
    """Colour (3,) of a body, from 0 to 1."""
    return FIXED_COLOUR if body.fixed else FREE_COLOUR


def grounds_of(bodies: Iterable[RigidBody]) -> tuple[Plane, ...]:
    """Return the surfaces of those bodies that are the ground."""
    return tuple(
        Plane(point=body.position, normal=tuple(body.rotation[:, 2].tolist()), stiffness=1.0)
        for body in bodies
        if isinstance(body.shape, GroundShape)
    )


def triangles_of(faces: Array) -> tuple[Array, NDArray[np.int32]]:
    """Vertices (4 n, 3) and triangles (2 n, 3) of faces (n, 4, 3)."""
    first = 4 * np.arange(len(faces))[:, None]
    triangles = np.concatenate((first + np.array([0, 1, 2]), first + np.array([0, 2, 3])))
    return faces.reshape(-1, 3), triangles.astype(np.int32)
