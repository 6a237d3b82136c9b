"""Obstacles of a robot file, and the points of its arm that touch them."""

from __future__ import annotations

import numpy as np

from soro_core.arrays import Array
from soro_core.robot import Robot
from soro_ros.view.arm_shape import between


def touching(robot: Robot, backbone: Array) -> Array:
    """Return the points (k, 3) [m] of the arm that have sunk into an obstacle.

    Parameters
    ----------
    robot : Robot
    backbone : ndarray (n, 4, 4)
        Poses at equal distances from base to tip.
    """
    if robot.contacts is None:
        return np.zeros((0, 3))
    begin, places = 0.0, []
    for link in robot.links:
        parts = np.arange(1, robot.contacts.points_per_link + 1) / robot.contacts.points_per_link
        places.append(begin + parts * link.length)
        begin += link.length
    s = np.linspace(0.0, robot.length, len(backbone))
    x = between(s, backbone, np.concatenate(places))[:, :3, 3]
    gaps = [np.full(len(x), np.inf)]
    for plane in robot.contacts.planes:
        normal = np.asarray(plane.normal) / np.linalg.norm(plane.normal)
        gaps.append((x - plane.point) @ normal)
    for sphere in robot.contacts.spheres:
        gaps.append(np.linalg.norm(x - sphere.centre, axis=1) - sphere.radius)
    return np.asarray(x[np.min(gaps, axis=0) < 0.0])


def turned_to(normal: tuple[float, ...]) -> Array:
    """Return the quaternion (w, x, y, z) that turns the z axis to a direction."""
    n = np.asarray(normal) / np.linalg.norm(normal)
    half = np.array([1.0 + n[2], -n[1], n[0], 0.0])  # 1 + z . n, z x n
    size = np.linalg.norm(half)
    return np.asarray(half / size) if size > 1e-9 else np.array([0.0, 1.0, 0.0, 0.0])
