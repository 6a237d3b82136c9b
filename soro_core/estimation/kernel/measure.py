"""Predicted values of a sample and their derivatives by (q, qd); rotations as in `soro_core.rotation`."""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.estimation.kernel.noise import noise_variance
from soro_core.estimation.kernel.parts import IMU, IMU_ORIENTED, POSE, FilterArm, SampleValues
from soro_core.model.links.linear import clear_matrix
from soro_core.model.method import kinematics
from soro_core.model.records import CrossSection

# Below this angle [rad] the closed form loses digits; its series is exact to round-off there.
_SMALL = 1e-4


@inner
def to_matrix(quaternion: Array, R: Array) -> None:
    """R <- rotation of a quaternion (x, y, z, w) of any length above 0."""
    x, y, z, w = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    s = 2.0 / (x * x + y * y + z * z + w * w)
    R[0, 0], R[1, 1], R[2, 2] = 1 - s * (y * y + z * z), 1 - s * (x * x + z * z), 1 - s * (x * x + y * y)
    R[0, 1], R[1, 0] = s * (x * y - z * w), s * (x * y + z * w)
    R[0, 2], R[2, 0] = s * (x * z + y * w), s * (x * z - y * w)
    R[1, 2], R[2, 1] = s * (y * z - x * w), s * (y * z + x * w)


@inner
def relative_log(R: Array, Rm: Array) -> tuple[float, float, float]:
    """Rotation vector of R' Rm, of length at most pi, by Shepperd's method."""
    d = (
        R[0, 0] * Rm[0, 0] + R[1, 0] * Rm[1, 0] + R[2, 0] * Rm[2, 0],
        R[0, 1] * Rm[0, 1] + R[1, 1] * Rm[1, 1] + R[2, 1] * Rm[2, 1],
        R[0, 2] * Rm[0, 2] + R[1, 2] * Rm[1, 2] + R[2, 2] * Rm[2, 2],
    )
    d01 = R[0, 0] * Rm[0, 1] + R[1, 0] * Rm[1, 1] + R[2, 0] * Rm[2, 1]
    d10 = R[0, 1] * Rm[0, 0] + R[1, 1] * Rm[1, 0] + R[2, 1] * Rm[2, 0]
    d02 = R[0, 0] * Rm[0, 2] + R[1, 0] * Rm[1, 2] + R[2, 0] * Rm[2, 2]
    d20 = R[0, 2] * Rm[0, 0] + R[1, 2] * Rm[1, 0] + R[2, 2] * Rm[2, 0]
    d12 = R[0, 1] * Rm[0, 2] + R[1, 1] * Rm[1, 2] + R[2, 1] * Rm[2, 2]
    d21 = R[0, 2] * Rm[0, 1] + R[1, 2] * Rm[1, 1] + R[2, 2] * Rm[2, 1]
    trace = d[0] + d[1] + d[2]
    # The largest of the four squared components is at least 1/4: dividing by it is safe at every angle.
    sx, sy, sz, sw = 1 + 2 * d[0] - trace, 1 + 2 * d[1] - trace, 1 + 2 * d[2] - trace, 1 + trace
    most = max(sx, sy, sz, sw)
    if most == sw:
        x, y, z, w = d21 - d12, d02 - d20, d10 - d01, sw
    elif most == sx:
        x, y, z, w = sx, d10 + d01, d20 + d02, d21 - d12
    elif most == sy:
        x, y, z, w = d10 + d01, sy, d21 + d12, d02 - d20
    else:
        x, y, z, w = d20 + d02, d21 + d12, sz, d10 - d01
    if w < 0.0:  # q and -q are one rotation; this is the short way round
        x, y, z, w = -x, -y, -z, -w
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 * math.atan2(sine, w) / sine if sine > 1e-12 * w else 2.0 / w
    return scale * x, scale * y, scale * z


@inner
def _rotation_rows(arm: FilterArm, first: int) -> None:
    """Residual and rows of the measured rotation, from row `first` on: J_l(angle)^-1 J_angular."""
    w = arm.scratch
    x, y, z = relative_log(w.rotation, w.measured)
    w.residual[first], w.residual[first + 1], w.residual[first + 2] = x, y, z
    angle2 = x * x + y * y + z * z
    factor = 1.0 / 12.0
    if angle2 > _SMALL * _SMALL:
        half = 0.5 * math.sqrt(angle2)
        factor = (1.0 - half * math.cos(half) / math.sin(half)) / angle2
    for i in range(w.columns.shape[0]):
        a, b, c = w.columns[i, 0], w.columns[i, 1], w.columns[i, 2]
        k0, k1, k2 = y * c - z * b, z * a - x * c, x * b - y * a
        w.rows[first, i] = a - 0.5 * k0 + factor * (y * k2 - z * k1)
        w.rows[first + 1, i] = b - 0.5 * k1 + factor * (z * k0 - x * k2)
        w.rows[first + 2, i] = c - 0.5 * k2 + factor * (x * k1 - y * k0)


@inner
def _of_mean_strain(arm: FilterArm) -> None:
    """Angular columns by q in place of the mean strains; rows of the angular velocity by the rates of q."""
    w = arm.scratch
    n, x = w.place.shape[0], w.moved
    for r in range(3):
        for j in range(n):
            x[j] = 0.0
            for i in range(n):
                x[j] += w.columns[i, r] * w.mean_strain_by_q[i, j]
                w.rows[r, n + j] += w.columns[i, r] * w.mean_strain_by_rate[i, j]
        for j in range(n):
            w.columns[j, r] = x[j]


@inner
def _set_variance(arm: FilterArm, sample: SampleValues, components: int) -> None:
    for component in range(components):
        noise, model = noise_variance(arm, sample.kind, sample.record, component)
        for r in range(3 * component, 3 * component + 3):
            arm.scratch.variance[r] = model + noise


@inner
def measure(arm: FilterArm, sample: SampleValues, mean: Array) -> int:
    """scratch.residual, .rows and .variance <- those of a sample at the mean; gives their number."""
    t, s, w = arm.tables, arm.settings, arm.scratch
    kind, first, second = sample.kind, sample.first, sample.second
    n = s.limit.shape[0]
    R, J, res = w.rotation, w.columns, w.residual
    q = mean[:n]
    if kind != POSE:
        q = w.moved
        for i in range(n):
            q[i] = w.mean_strain[i]
            for j in range(n):
                q[i] += w.mean_strain_by_q[i, j] * (mean[j] - w.place[j])
    kinematics(t, arm.work, sample.site, q, CrossSection(R, w.position, J))
    clear_matrix(w.rows)
    if kind != IMU:
        to_matrix(sample.quaternion, w.measured)
    if kind == POSE:
        for r in range(3):
            res[r] = first[r] - w.position[r]
            for i in range(n):
                w.rows[r, i] = R[r, 0] * J[i, 3] + R[r, 1] * J[i, 4] + R[r, 2] * J[i, 5]
        _rotation_rows(arm, 3)
        _set_variance(arm, sample, 2)
        return 6
    _of_mean_strain(arm)
    # d(omega)/dq = dJ/dq qd is neglected: small at the speeds of an arm, and 0 at rest.
    for r in range(3):
        res[r] = first[r]
        for i in range(n):
            res[r] -= w.rows[r, n + i] * mean[n + i]
    count = 3
    if kind == IMU_ORIENTED:
        _rotation_rows(arm, 3)
        count = 6
    _set_variance(arm, sample, count // 3)
    gravity = math.sqrt(t.gravity[0] ** 2 + t.gravity[1] ** 2 + t.gravity[2] ** 2)
    length = math.sqrt(second[0] ** 2 + second[1] ** 2 + second[2] ** 2)
    if gravity > 0.0 and abs(length - gravity) <= s.gravity_tolerance:
        x = -(R[0, 0] * t.gravity[0] + R[1, 0] * t.gravity[1] + R[2, 0] * t.gravity[2])
        y = -(R[0, 1] * t.gravity[0] + R[1, 1] * t.gravity[1] + R[2, 1] * t.gravity[2])
        z = -(R[0, 2] * t.gravity[0] + R[1, 2] * t.gravity[1] + R[2, 2] * t.gravity[2])
        res[count], res[count + 1], res[count + 2] = second[0] - x, second[1] - y, second[2] - z
        for i in range(n):
            # (R exp([w]x))' v = R' v + [R' v]x w to first order.
            a, b, c = J[i, 0], J[i, 1], J[i, 2]
            w.rows[count, i], w.rows[count + 1, i], w.rows[count + 2, i] = (
                y * c - z * b,
                z * a - x * c,
                x * b - y * a,
            )
        for r in range(count, count + 3):
            w.variance[r] = s.imu_variance[2]
        count += 3
    return count
