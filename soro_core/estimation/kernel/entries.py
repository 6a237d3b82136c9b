"""Entry points of the filter from Python: short compiled functions that take an arm with its filter."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core._box import Box, view
from soro_core._jit import entry, kernel
from soro_core.estimation.kernel import motion, spread, update
from soro_core.estimation.kernel.parts import FilterArm, NoRoom, Settings, make_scratch
from soro_core.model.chambers import add_pressure_force
from soro_core.model.derivative.work import derivative_workspace
from soro_core.model.dynamics import GOOD
from soro_core.model.linear import assign, clear
from soro_core.model.method import kinematics, make_work
from soro_core.model.tables import Site, Tables

Array: TypeAlias = NDArray[np.float64]


@kernel
def make_exact(t: Tables, s: Settings, n_wrench: int) -> Box:
    """Return an arm that has derivatives, with its filter."""
    return Box(FilterArm(t, make_work(t), derivative_workspace(t), s, make_scratch(t, s, n_wrench)))


@kernel
def make_differenced(t: Tables, s: Settings, n_wrench: int) -> Box:
    """Return an arm without derivatives: differences replace them."""
    return Box(FilterArm(t, make_work(t), NoRoom(np.zeros(1)), s, make_scratch(t, s, n_wrench)))  # type: ignore[arg-type]


@entry
def predict(
    box: Box,
    theta: Array,
    share: float,
    mean: Array,
    internal: Array,
    covariance: Array,
    pressure: Array,
    dt: float,
    mean1: Array,
    internal1: Array,
    covariance1: Array,
) -> int:
    """mean1, internal1, covariance1 <- belief after dt with `share` of the learned model theta.

    Gives a code; where it is not GOOD the arm is held at rest, and the covariance grows.
    """
    arm = view(box)
    s = arm.settings
    n = s.limit.shape[0]
    motion.load(arm, theta, share)
    code = motion.step_mean(arm, mean, internal, pressure, dt, mean1, internal1)
    if code == GOOD:
        code = spread.step_covariance(arm, covariance, share, dt, covariance1)
    if code != GOOD:
        for i in range(n):
            mean1[i], mean1[n + i] = mean[i], 0.0
        assign(internal, internal1)
        spread.hold_covariance(arm, covariance, dt, covariance1)
    if s.n_d > 0:
        fade = np.exp(-dt / s.time)
        for i in range(n):
            d, e = mean[2 * n + i], mean[3 * n + i]
            mean1[2 * n + i], mean1[3 * n + i] = fade * (d + dt * e), fade * e
    motion.limit(arm, mean1[:n])
    return code


@entry
def fuse(
    box: Box,
    site: Site,
    kind: int,
    first: Array,
    second: Array,
    quaternion: Array,
    gated: bool,
    mean: Array,
    covariance: Array,
    mean1: Array,
    covariance1: Array,
    reported: Array,
) -> int:
    """`update.fuse`."""
    return update.fuse(
        view(box),
        site,
        kind,
        first,
        second,
        quaternion,
        gated,
        mean,
        covariance,
        mean1,
        covariance1,
        reported,
    )


@entry
def tip(
    box: Box, mean: Array, covariance: Array, pressure: Array, pose: Array, of_tip: Array, force: Array
) -> None:
    """pose, of_tip <- pose of the tip (4, 4) and its covariance (6, 6) in the world; force <- H p."""
    arm = view(box)
    t, s, w = arm.tables, arm.settings, arm.scratch
    n, R = s.limit.shape[0], w.rotation
    q = mean[:n]
    kinematics(t, arm.work, s.tip, q, R, w.position, w.columns)
    for r in range(3):
        for c in range(3):
            pose[r, c] = R[r, c]
        pose[r, 3], pose[3, r] = w.position[r], 0.0
        for i in range(n):
            J = w.columns[i]
            w.rows[r, i] = R[r, 0] * J[3] + R[r, 1] * J[4] + R[r, 2] * J[5]
            w.rows[3 + r, i] = R[r, 0] * J[0] + R[r, 1] * J[1] + R[r, 2] * J[2]
    pose[3, 3] = 1.0
    for r in range(6):
        for i in range(n):
            x = 0.0
            for j in range(n):
                x += covariance[i, j] * w.rows[r, j]
            w.added[i] = x
        for e in range(r + 1):
            x = s.kinematic_variance[r] if e == r else 0.0
            for i in range(n):
                x += w.rows[e, i] * w.added[i]
            of_tip[r, e] = of_tip[e, r] = x
    clear(force)
    add_pressure_force(t, q, pressure, force)
