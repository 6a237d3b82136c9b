"""The arm as triangle meshes that move with its backbone, for viewers that draw it many times a second."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from soro_core.arrays import Array
from soro_core.robot import Robot
from soro_ros.view.arm_shape import between, bodies, full_part, shade


class Skin:
    """Bellows, core, plates and payload of a robot, each a mesh of constant triangles.

    Parameters
    ----------
    robot : Robot
    around : int
        Points of a ring.
    per_fold : int
        Rings a fold of the narrowest bellow.
    payload_kg : float
        Payload at the tip, drawn as a ball of steel; 0 for none.

    Attributes
    ----------
    names : tuple of str
        Of each mesh: those of the chambers, and ``core``, ``plate0``, ..., ``payload``.
    triangles : tuple of ndarray (f, 3)
        Of each mesh: three vertices of each face, counter-clockwise seen from outside.
    """

    def __init__(self, robot: Robot, around: int = 12, per_fold: int = 4, payload_kg: float = 0.0) -> None:
        self._bodies = bodies(robot, payload_kg, per_fold)
        self._chambers, self._length = set(robot.chamber_names), robot.length
        self._around = around
        self.names = tuple(body.name for body in self._bodies)
        self.triangles = tuple(_triangles(len(body.s), around) for body in self._bodies)

    def vertices(self, poses: Array) -> list[Array]:
        """Return the vertices (v, 3) [m] of each mesh.

        Parameters
        ----------
        poses : ndarray (n, 4, 4)
            Poses of the backbone at equal distances from base to tip, n >= 2, as arm/backbone has them.
        """
        s = np.linspace(0.0, self._length, len(poses))
        return [body.rings(between(s, poses, body.s), self._around).reshape(-1, 3) for body in self._bodies]

    def colours(self, pressure: Mapping[str, float]) -> list[Array]:
        """Return the colour (3,) of each mesh, from 0 to 1.

        Parameters
        ----------
        pressure : mapping of str to float
            Pressure of each chamber relative to the highest one, 0 to 1: an empty chamber is pale, one that
            is not known (NaN, or missing) dark grey.
        """
        return [
            shade(body.colour, full_part(pressure.get(body.name, np.nan)))
            if body.name in self._chambers
            else body.colour
            for body in self._bodies
        ]


def _triangles(rings: int, around: int) -> NDArray[np.int32]:
    """Two triangles a quadrilateral between neighbouring rings."""
    first, k = np.meshgrid(np.arange(rings - 1) * around, np.arange(around), indexing="ij")
    a, b = first + k, first + (k + 1) % around
    corners = np.stack([a, b, b + around, a, b + around, a + around], axis=-1)
    return corners.reshape(-1, 3).astype(np.int32)
