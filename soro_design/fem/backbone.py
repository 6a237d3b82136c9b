"""The backbone of a deformed part: a pose of each section, and the strains between neighbours.

docs/parts.md (3) and (4). The conventions are those of docs/model.md: twists have their angular part
first.
"""

from __future__ import annotations

import numpy as np

from soro_core.arrays import Array, Integers
from soro_core.rotation import left_jacobian_inverse, rotation_log


def section_poses(points: Array, u: Array, sections: Integers, share: Array) -> Array:
    """Return the poses (s, 4, 4) of sections, by the rigid motion that fits each best.

    Parameters
    ----------
    points, u : ndarray, (n, 3)
        Undeformed places and displacements of the nodes [m].
    sections : ndarray of int, (s, m)
        Nodes of each section, which is plane and normal to z in the undeformed part.
    share : ndarray, (m,)
        Area of each node [m2], or a multiple of it.

    Notes
    -----
    R and p minimise sum_a w_a |x_a - p - R (X_a - c)|^2, where c is the place of the axis, (0, 0, z): the
    rotation of the singular value decomposition of the weighted covariance.
    """
    weight = share / share.sum()
    poses = np.tile(np.eye(4), (len(sections), 1, 1))
    for pose, nodes in zip(poses, sections, strict=True):
        X = points[nodes]
        x = X + u[nodes]
        flat = X - [0.0, 0.0, X[0, 2]]
        middle, moved = weight @ flat, weight @ x
        left, _, right = np.linalg.svd((weight[:, None] * (x - moved)).T @ (flat - middle))
        # The points lie in a plane: the sign of the third axis is that of a rotation, not of a mirror.
        left[:, 2] *= np.linalg.det(left @ right)
        pose[:3, :3] = left @ right
        pose[:3, 3] = moved - pose[:3, :3] @ middle
    return poses


def twist_of(pose: Array) -> Array:
    """Return the logarithm (6,) of a pose (4, 4): the twist that leads there in unit time."""
    turn = rotation_log(pose[:3, :3])
    return np.concatenate([turn, left_jacobian_inverse(turn) @ pose[:3, 3]])


def section_strains(poses: Array, z: Array) -> Array:
    """Return the strains (s - 1, 6) between sections: curvatures and torsion [1/m], shears and stretch.

    Parameters
    ----------
    poses : ndarray, (s, 4, 4)
        Of the sections.
    z : ndarray, (s,)
        Their undeformed places along the axis [m].
    """
    steps = np.linalg.solve(poses[:-1], poses[1:])
    return np.stack([twist_of(step) for step in steps]) / np.diff(z)[:, None]
