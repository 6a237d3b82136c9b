"""The horizon: where the arm goes under planned pressures, and how that changes with them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.integrate import State, make_stepper
from soro_core.model import SoftArm


@dataclass(frozen=True)
class Course:
    """Where the arm goes under planned pressures, N steps on.

    Attributes
    ----------
    place, place_by_wish : ndarray (N, 3 + n_q), (N, 3 + n_q, N n_u)
        Position of the tip [m] and coordinates behind each step, and derivative by the wished pressures.
    pressure_pa, pressure_by_wish : ndarray (N, n_u), (N, N)
        Pressures at the begin of each step [Pa gauge]; the derivative is one for all chambers.
    """

    place: Array
    place_by_wish: Array
    pressure_pa: Array
    pressure_by_wish: Array


class Horizon:
    """Steps of a horizon on one arm.

    Chambers follow wished pressures with one time constant: what soro's inverse leaves of the lag of the
    regulators. A step of the implicit midpoint rule holds their mean, and a wrench at the tip in place of the
    force that the model lacks.

    Parameters
    ----------
    arm : SoftArm
        Model; one without derivatives raises ModelError.
    lag_s : float
        The time constant [s].
    """

    def __init__(self, arm: SoftArm, lag_s: float) -> None:
        self.arm, self.lag_s = arm, lag_s
        # Without guards a step is one step of its rule, which alone has derivatives.
        self.stepper = make_stepper("midpoint", arm, guarded=False)
        self.stepper.derivatives(self.stepper.initial_state(), np.zeros(arm.n_u), 1e-3)

    def course(
        self, state: State, pressure_pa: Array, wish_pa: Array, steps_s: Array, gain: Array, forces: Array
    ) -> Course:
        """Return the course under wished pressures.

        Parameters
        ----------
        state : State
        pressure_pa, wish_pa : ndarray (n_u,), (N, n_u)
            Pressures at the begin, and wished ones [Pa gauge].
        steps_s : ndarray (N,)
            Lengths of the steps [s].
        gain : ndarray (n_u,)
            Part of its pressure that acts in each chamber.
        forces : ndarray (N, n_q)
            Generalised forces that the model lacks.

        Raises
        ------
        ModelError
            If the model has no motion under these pressures.
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
            by = np.hstack([step.by_q, step.by_qd, step.by_internal]) @ by + np.kron(
                held_by, gain * step.by_p
            )
            pose, jacobian = arm.pose_and_jacobian(state.q, arm.length)
            place[k, :3], place_by[k, :3] = pose[:3, 3], pose[:3, :3] @ jacobian[3:] @ by[:n]
            place[k, 3:], place_by[k, 3:] = state.q, by[:n]
        return Course(place, place_by, pressure, pressure_by)

    def _wrench(self, jacobian: Array, force: Array) -> Array:
        """Return the wrench (6,) at the tip nearest to a generalised force (n_q,), and the least of these."""
        unit = np.repeat([self.arm.length, 1.0], 3)  # a moment is a force at the length
        scaled = unit[:, None] * jacobian
        square = scaled.T @ scaled
        square[np.diag_indices_from(square)] += 1e-9 * np.trace(square)
        return np.asarray(unit * (scaled @ np.linalg.solve(square, force)))
