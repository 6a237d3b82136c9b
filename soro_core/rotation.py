"""Rotations as matrices (3, 3), rotation vectors (3,) [rad] and quaternions (4,) x, y, z, w.

The tests compare them with `scipy.spatial.transform.Rotation`, which is not used at run time: nodes call
them at every sample of a sensor, and a call takes 4 to 8 us here, 10 to 60 us there after an import of 0.2 s.
"""

from __future__ import annotations

import math

import numpy as np

from soro_core.arrays import Array

_ONE = np.eye(3)
# Below this angle [rad] the closed forms lose digits; their series are exact to round-off there.
_SMALL = 1e-4


def skew(v: Array) -> Array:
    """Return the (3, 3) matrix [v]x with [v]x w = v x w."""
    x, y, z = v.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_exp(v: Array) -> Array:
    """Return the rotation matrix (3, 3) of the rotation vector `v` [rad]."""
    angle = math.sqrt(float(v @ v))
    k = skew(v)
    if angle < _SMALL:
        return np.asarray(_ONE + k + 0.5 * k @ k)
    return np.asarray(
        _ONE + math.sin(angle) / angle * k + (1.0 - math.cos(angle)) / (angle * angle) * (k @ k)
    )


def rotation_log(rotation: Array) -> Array:
    """Return the rotation vector [rad] (3,) of a rotation matrix, its length at most pi."""
    return quaternion_log(quaternion_from_matrix(rotation))


def quaternion_log(quaternion: Array) -> Array:
    """Return the rotation vector [rad] (3,) of a unit quaternion (x, y, z, w), its length at most pi."""
    x, y, z, w = quaternion.tolist()
    if w < 0.0:  # q and -q are one rotation; this is the short way round
        x, y, z, w = -x, -y, -z, -w
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 * math.atan2(sine, w) / sine if sine > 1e-12 else 2.0
    return scale * np.array([x, y, z])


def left_jacobian_inverse(v: Array) -> Array:
    """Return J_l(v)^-1 (3, 3): log(exp(d) exp(v)) = v + J_l(v)^-1 d to first order in d."""
    angle = math.sqrt(float(v @ v))
    k = skew(v)
    if angle < _SMALL:
        return np.asarray(_ONE - 0.5 * k + k @ k / 12.0)
    half = 0.5 * angle
    # 1/a^2 - cot(a/2)/(2a): finite at pi, where the cotangent is 0.
    factor = (1.0 - half * math.cos(half) / math.sin(half)) / (angle * angle)
    return np.asarray(_ONE - 0.5 * k + factor * (k @ k))


def matrix_from_quaternion(quaternion: Array) -> Array:
    """Return the rotation matrix (3, 3) of a quaternion (x, y, z, w) of any length above 0."""
    x, y, z, w = (quaternion / math.sqrt(float(quaternion @ quaternion))).tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_from_matrix(rotation: Array) -> Array:
    """Return the unit quaternion (x, y, z, w), w >= 0, of a rotation matrix (Shepperd's method)."""
    R = rotation.tolist()
    trace = R[0][0] + R[1][1] + R[2][2]
    # The largest of the four squared components is at least 1/4: dividing by it is safe at every angle.
    squares = [*(1.0 + 2.0 * R[a][a] - trace for a in range(3)), 1.0 + trace]
    i = squares.index(max(squares))
    q = np.empty(4)
    if i == 3:
        q[3] = squares[3]
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            q[a] = R[c][b] - R[b][c]
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        q[i] = squares[i]
        q[j] = R[j][i] + R[i][j]
        q[k] = R[k][i] + R[i][k]
        q[3] = R[k][j] - R[j][k]
    q /= math.sqrt(float(q @ q))
    return -q if q[3] < 0.0 else q
