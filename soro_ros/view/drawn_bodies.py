"""Rigid bodies in the scene of a viser server."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import viser

from soro_core.arrays import Array
from soro_core.bodies import GroundShape, RigidBody
from soro_core.rotation import quaternion_from_matrix
from soro_ros.view.body_shape import colour_of, faces_of, triangles_of

# What is drawn of a ground [m].
_SQUARE = 0.5 * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
# Smaller changes of a pose are not worth a message [m, and parts of a rotation].
_STEP = 1e-5


class DrawnBodies:
    """Meshes of bodies; a pose that has not changed is not sent.

    Parameters
    ----------
    server : viser.ViserServer
    bodies : mapping of str to RigidBody
        By name.
    """

    def __init__(self, server: viser.ViserServer, bodies: Mapping[str, RigidBody]) -> None:
        self._poses: dict[str, Array] = {}
        self._meshes: dict[str, viser.SceneNodeHandle] = {}
        for name, body in bodies.items():
            faces = _SQUARE[None] if isinstance(body.shape, GroundShape) else faces_of(body)
            vertices, triangles = triangles_of(faces)
            red, green, blue = (round(255 * float(part)) for part in colour_of(body))
            self._meshes[name] = server.scene.add_mesh_simple(
                f"/bodies/{name}", vertices, triangles, color=(red, green, blue), side="double"
            )
            start = np.eye(4)
            start[:3, :3], start[:3, 3] = body.rotation, body.position
            self._show(name, start)

    def show(self, poses: Mapping[str, Array]) -> None:
        """Draw bodies at poses (4, 4) in the world; the others stay where they are."""
        for name, pose in poses.items():
            if np.abs(pose - self._poses[name]).max() > _STEP:
                self._show(name, pose)

    def _show(self, name: str, pose: Array) -> None:
        self._poses[name] = pose
        x, y, z, w = quaternion_from_matrix(pose[:3, :3])
        mesh = self._meshes[name]
        mesh.wxyz, mesh.position = np.array([w, x, y, z]), pose[:3, 3]
