"""Our forward dynamics in a compiled loop."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from soro_core import SoftArm
from soro_core._box import Box, view
from soro_core._jit import kernel
from soro_core.model import dynamics
from soro_core.model.checks import flat_wrench

Array = NDArray[np.float64]


@kernel
def loop(box: Box, q: Array, qd: Array, z: Array, p: Array, w: Array, qdd: Array, n: int) -> int:
    """Call n times, at one state after the other; each call depends on the result of the one before."""
    n_q = qdd.shape[0]
    x, v = np.empty(n_q), np.empty(n_q)
    arm = view(box)
    bad = 0
    for i in range(n):
        for b in range(n_q):
            x[b] = q[i % q.shape[0], b] + 1e-30 * qdd[b]
            v[b] = qd[i % q.shape[0], b]
        # The one call of a kernel of the model in the benchmarks.
        bad += dynamics.forward_dynamics(arm.tables, arm.work, x, v, z, p, w, qdd)
    return bad


def in_a_loop(
    arm: SoftArm, q: Array, qd: Array, pressure: float = 0.0, internal: float = 0.0, force: float = 0.0
) -> Callable[[int], None]:
    """Run of n calls at the states (count, n_q), with all pressures, internal states and tip forces alike."""
    z, p = np.full(arm.n_internal, internal), np.full(arm.n_u, pressure)
    w = np.full_like(flat_wrench(arm.robot, None), force)
    qdd = np.zeros(arm.n_q)

    def run(n: int) -> None:
        if loop(arm._box, q, qd, z, p, w, qdd, n) != 0:
            raise RuntimeError("forward dynamics failed")

    return run


def from_python(arm: SoftArm, q: Array, qd: Array) -> Callable[[int], None]:
    """Run of n calls of the method that users call."""
    p = np.zeros(arm.n_u)
    rows = [(q[i], qd[i]) for i in range(len(q))]

    def run(n: int) -> None:
        for i in range(n):
            arm.forward_dynamics(*rows[i % len(rows)], p)

    return run
