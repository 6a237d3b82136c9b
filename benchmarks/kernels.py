"""Our forward dynamics, and their derivatives, in a compiled loop."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from soro_core import SoftArm
from soro_core._box import Box, view
from soro_core._jit import kernel
from soro_core.arrays import Array
from soro_core.model import dynamics
from soro_core.model.checks import flat_wrench
from soro_core.model.derivative import entries
from soro_core.model.records import ArmState


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
        bad += dynamics.forward_dynamics(arm.tables, arm.work, ArmState(x, v, z), p, w, qdd)
    return bad


@kernel
def derivative_loop(
    box: Box, room: Box, q: Array, qd: Array, p: Array, w: Array, qdd: Array, by: Array, by_p: Array, n: int
) -> int:
    """Derive n times, as `loop`; `qdd` is that of one state, since its value does not change the time."""
    n_q = qdd.shape[0]
    x, v = np.empty(n_q), np.empty(n_q)
    bad = 0
    for i in range(n):
        for b in range(n_q):
            x[b] = q[i % q.shape[0], b] + 1e-30 * by[0, b, b]
            v[b] = qd[i % q.shape[0], b]
        bad += entries.acceleration_derivatives(box, room, (x, v, qdd), p, w, (by[0], by[1], by_p))
    return bad


def derivatives_in_a_loop(arm: SoftArm, q: Array, qd: Array) -> Callable[[int], None]:
    """Run of n calls of what `SoftArm.derivatives` does after the forward dynamics, without pressures."""
    n = arm.n_q
    p, w = np.zeros(arm.n_u), flat_wrench(arm.robot, None)
    qdd, by, by_p = arm.forward_dynamics(q[0], qd[0], p), np.zeros((2, n, n)), np.zeros((n, arm.n_u))

    def run(n: int) -> None:
        if derivative_loop(arm._box, arm._room, q, qd, p, w, qdd, by, by_p, n) != 0:
            raise RuntimeError("derivatives failed")

    return run


def in_a_loop(
    arm: SoftArm,
    q: Array,
    qd: Array,
    pressure: float | Array = 0.0,
    internal: float = 0.0,
    force: float = 0.0,
) -> Callable[[int], None]:
    """Run of n calls at the states (count, n_q), with pressures; internal states and tip forces alike."""
    z, p = np.full(arm.n_internal, internal), np.full(arm.n_u, pressure)
    w = np.full_like(flat_wrench(arm.robot, None), force)
    qdd = np.zeros(arm.n_q)

    def run(n: int) -> None:
        if loop(arm._box, q, qd, z, p, w, qdd, n) != 0:
            raise RuntimeError("forward dynamics failed")

    return run


def from_python(
    arm: SoftArm, q: Array, qd: Array, method: Callable[..., object] | None = None
) -> Callable[[int], None]:
    """Run of n calls of a method that users call, by default the forward dynamics."""
    p = np.zeros(arm.n_u)
    rows = [(q[i], qd[i]) for i in range(len(q))]
    called = method or arm.forward_dynamics

    def run(n: int) -> None:
        for i in range(n):
            called(*rows[i % len(rows)], p)

    return run
