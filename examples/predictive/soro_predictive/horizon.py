"""The horizon: where the arm goes under planned pressures, and how that changes with them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from soro_core.arrays import Array
from soro_core.integrate import State, make_stepper
from soro_core.model import SoftArm


class Course(NamedTuple):
    """Where the arm goes under planned pressures, N steps on."""

    place: Array
    """Position of the tip [m] and coordinates behind each step, (N, 3 + n_q)."""
    place_by_wish: Array
    """Derivative by the wished pressures, (N, 3 + n_q, N n_u)."""
    pressure_pa: Array
    """Pressures at the begin of each step [Pa gauge], (N, n_u)."""
    pressure_by_wish: Array
    """Derivative, one for all chambers, (N, N)."""


class Horizon:
    """Steps of a horizon on one arm.

    Chambers follow wished pressures with one time constant: what soro's inverse leaves of the lag of the
    regulators. A step of the implicit midpoint rule holds their mean, and a wrench at the tip in place of the
    force that the model lacks.
    An arm without derivatives raises ModelError. `lag_s` is the time constant [s].
    """

    def __init__(self, arm: SoftArm, lag_s: float) -> None:
        self.arm, self.lag_s = arm, lag_s
        self.unit = np.repeat([arm.length, 1.0], 3)  # a moment is a force at the length
        # Without guards a step is one step of its rule, which alone has derivatives.
        self.stepper = make_stepper("midpoint", arm, guarded=False)
        self.stepper.derivatives(self.stepper.initial_state(), np.zeros(arm.n_u), 1e-3)

    def course(
        self, state: State, pressure_pa: Array, wish_pa: Array, steps_s: Array, gain: Array, forces: Array
    ) -> Course:
        """Return the course under wished pressures.

        `pressure_pa` (n_u,) are those at the begin, `wish_pa` (N, n_u) the wished ones [Pa gauge], `steps_s`
        (N,) the lengths of the steps [s], `gain` (n_u,) the part of its pressure that acts in each chamber,
        `forces` (N, n_q) the generalised forces that the model lacks.
        ModelError: the model has no motion under these pressures.
        """
        arm, (N, n_u), n = self.arm, wish_pa.shape, self.arm.n_q
        by, here = np.zeros((2 * n + arm.n_internal, N * n_u)), np.zeros(N)
        place, place_by = np.empty((N, 3 + n)), np.empty((N, 3 + n, N * n_u))
        pressure, pressure_by = np.empty((N, n_u)), np.empty((N, N))
        jacobian = arm.jacobian(state.q, arm.length)
        for k, h in enumerate(steps_s.tolist()):
            pressure[k], pressure_by[k] = pressure_pa, here
            # What is left of a gap of pressure behind the step, and its mean until then.
            left = math.exp(-h / self.lag_s)
            mean = (1.0 - left) * self.lag_s / h
            held_by, here, gap = mean * here, left * here, pressure_pa - wish_pa[k]
            held_by[k], here[k] = 1.0 - mean, 1.0 - left
            step = self.stepper.derivatives(
                state, gain * (wish_pa[k] + mean * gap), h, self._wrench(jacobian, forces[k])
            )
            state, pressure_pa = step.state, wish_pa[k] + left * gap
            by = np.hstack([step.by_q, step.by_qd, step.by_internal]) @ by
            by += (held_by[:, None] * (gain * step.by_p)[:, None]).reshape(by.shape)
            pose, jacobian = arm.pose_and_jacobian(state.q, arm.length)
            place[k, :3], place_by[k, :3] = pose[:3, 3], pose[:3, :3] @ jacobian[3:] @ by[:n]
            place[k, 3:], place_by[k, 3:] = state.q, by[:n]
        return Course(place, place_by, pressure, pressure_by)

    def _wrench(self, jacobian: Array, force: Array) -> Array:
        """Return the wrench (6,) at the tip nearest to a generalised force (n_q,), and the least of these."""
        scaled = self.unit[:, None] * jacobian
        square = scaled.T @ scaled
        square.flat[:: len(force) + 1] += 1e-9 * square.trace()
        return np.asarray(self.unit * (scaled @ np.linalg.solve(square, force)))
