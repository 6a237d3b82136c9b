"""Estimator and controller for one tick: the same object in tests, in the nodes' places and without ROS."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.control import Command, Controller, ControllerState, Reference
from soro_core.estimation import Estimate, Estimator, EstimatorState, ImuSample, PoseSample

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class LoopState:
    """State of both halves."""

    estimator: EstimatorState
    controller: ControllerState


@dataclass(frozen=True)
class Loop:
    """An estimator and the controller that believes it.

    The command passes the limiter of `soro_core.safety` on the regulator's side, not here.
    """

    estimator: Estimator
    controller: Controller

    def initial_state(self, t_s: float = 0.0, pressure_pa: Array | None = None) -> LoopState:
        """Return the state before the first tick."""
        return LoopState(
            self.estimator.initial_state(t_s, pressure_pa=pressure_pa),
            self.controller.initial_state(pressure_pa),
        )

    def step(
        self,
        state: LoopState,
        pressure_pa: Array,
        poses: Sequence[PoseSample],
        imus: Sequence[ImuSample],
        dt: float,
        reference: Reference | None = None,
    ) -> tuple[LoopState, Estimate, Command]:
        """Advance by `dt`: pressures measured now and samples that came in, command out.

        Parameters
        ----------
        pressure_pa : ndarray (n_u,)
            Measured gauge pressures [Pa].
        poses, imus : sequence
            Samples since the last tick.
        dt : float
            Time since the last tick [s].
        reference : Reference or None
            None for the configured one.
        """
        estimator, estimate = self.estimator.step(state.estimator, pressure_pa, poses, imus, dt)
        controller, command = self.controller.step(
            state.controller, estimate.q, estimate.qd, estimator.t_s, dt, pressure_pa, reference
        )
        return LoopState(estimator, controller), estimate, command
