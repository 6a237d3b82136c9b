"""The closed loop: estimator and controller, stepped together, and run on a plant in lockstep.

`soro_lab.scene.loop` builds estimator and controller from the keys of nodes and of scenes. The nodes step
theirs over topics; `soro trade`, the tests and the benchmarks close the loop with `Loop.run`.
"""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ConfigError, ModelError
from soro_core.model.checks import require

if TYPE_CHECKING:  # a node needs one half only, and not the modules of the other
    from soro_core.adaptation import Learned
    from soro_core.control import Command, Controller, ControllerState, Reference
    from soro_core.control.laws import Certainty
    from soro_core.control.probing.stamps import StampedPosition
    from soro_core.estimation import Estimate, Estimator, EstimatorState, ImuSample, PoseSample
    from soro_core.integrate import Status

AT_LIMIT_PART = 0.2
"""Largest part of the set points at a bound, and of their changes at a limit of rate, of a good run."""
# Distance of the tip from a configured reference that is named, part of the arm's length; that of `soro run`.
_REACH = 0.1


class PlantObservation(Protocol):
    """What a plant lets the loop see at one tick; `soro_core.twin.Observation` is one."""

    @property
    def reading_pa(self) -> Array:
        """Measured gauge pressures (n_u,) [Pa]."""

    @property
    def poses(self) -> Sequence[PoseSample]:
        """Pose samples that arrive at this tick."""

    @property
    def imus(self) -> Sequence[ImuSample]:
        """IMU samples that arrive at this tick."""


class PlantState(Protocol):
    """State of a plant, with the status of its last step."""

    @property
    def status(self) -> Status:
        """Status of the last step."""


S = TypeVar("S", bound=PlantState)
O = TypeVar("O", bound=PlantObservation, covariant=True)  # noqa: E741 -- the observation


class Plant(Protocol[S, O]):
    """What the loop acts on; `soro_core.twin.Twin` is one."""

    def initial(self) -> S:
        """Return the state at the first tick."""

    def observe(self, state: S) -> tuple[S, O]:
        """Sample the sensors; called once a tick."""

    def step_setpoints(self, state: S, setpoint_pa: Array) -> S:
        """Advance by one tick with set points (n_u,) [Pa gauge]."""


@dataclass(frozen=True)
class LoopState:
    """State of both halves, and the learned model that the estimator uses at the next tick."""

    estimator: EstimatorState
    controller: ControllerState
    learned: Learned | None = None


@dataclass(frozen=True, repr=False)
class Tick(Generic[S, O]):
    """One tick of the closed loop.

    Attributes
    ----------
    t_s : float
        Time since the first tick [s].
    plant : object
        State of the plant at this tick.
    seen : object
        What its sensors gave.
    estimate : Estimate
    command : Command
        The answer; it is held back where its status is not ok.
    cpu_us : float
        CPU time of estimator and controller [us].
    at_bound_part : float
        Part of all set points until now at a bound, by `Command.saturated`.
    """

    t_s: float
    plant: S
    seen: O
    estimate: Estimate
    command: Command
    cpu_us: float
    at_bound_part: float

    def __repr__(self) -> str:
        pressures = ", ".join(f"{1e-3 * p:.1f}" for p in self.command.setpoint_pa)
        note = self.command.status.note or self.command.status.message
        until_now = f"{self.at_bound_part:.0%} of them at a bound until now"
        return f"Tick({self.t_s:.3f} s: set points {pressures} kPa, {until_now}{note and f'; {note}'})"


@dataclass(frozen=True)
class Loop:
    """An estimator and the controller that acts on its estimate.

    The command passes the limiter of `soro_core.safety` on the regulator's side, not here.
    """

    estimator: Estimator
    """Gives the estimate at each tick."""
    controller: Controller
    """Gives the command from it."""

    def __post_init__(self) -> None:
        from soro_core.control import Controller
        from soro_core.estimation import Estimator

        require(self.estimator, Estimator, "estimator", "an Estimator; Loop takes it first")
        require(self.controller, Controller, "controller", "a Controller; Loop takes it second")

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
        """Advance by `dt`: from pressures and samples to the command.

        Parameters
        ----------
        state : LoopState
            After the last tick.
        pressure_pa : ndarray (n_u,)
            Measured gauge pressures [Pa].
        poses, imus : sequence
            Samples since the last tick.
        dt : float
            Time since the last tick [s].
        reference : Reference or None
            None for the configured one.

        Returns
        -------
        state : LoopState
        estimate : Estimate
        command : Command
        """
        estimator, estimate = self.estimator.step(
            state.estimator, pressure_pa, poses, imus, dt, state.learned
        )
        seen = [] if state.controller.probe is None else _positions(poses)
        controller, command = self.controller.step(
            state.controller,
            estimate.q,
            estimate.qd,
            estimator.t_s,
            dt,
            pressure_pa,
            reference,
            certainty_of(estimate),
            seen=seen,
        )
        return LoopState(estimator, controller, command.learned), estimate, command

    def run(
        self,
        plant: Plant[S, O],
        ticks: int,
        dt: float,
        delay: int = 1,
        reference: Callable[[float, LoopState], Reference | None] | None = None,
        before_s: float = 0.0,
    ) -> Iterator[Tick[S, O]]:
        """Close the loop with a plant and give one tick after the other.

        Parameters
        ----------
        plant : Plant
            Arm, regulators and sensors.
        ticks : int
            Number of ticks.
        dt : float
            Period [s].
        delay : int
            Ticks from a command to its effect. 1 as over topics in lockstep: the command that answers a tick
            acts from the next one on. 0: it acts at once.
        reference : callable, optional
            Gives the reference from the time [s] and the state before the tick; None for the configured one.
        before_s : float
            Time one period before the first tick, by the stamps of the plant's samples [s]; `-dt` for a
            plant whose first tick is at 0, as that of the twin. A tick too late, and the estimate is a tick
            ahead of the arm.

        The log names a configured reference that the pressures cannot hold and, at the end, a part of the set
        points at a bound that is too large for a good run.

        Raises
        ------
        ModelError
            If the plant fails.
        """
        if reference is None:
            _name_out_of_reach(self.controller)
        state, inner = plant.initial(), self.initial_state(before_s)
        setpoint: Array = np.zeros(self.controller.arm.n_u)
        under_way, at_bound, part = deque([setpoint] * delay), 0, 0.0
        for k in range(ticks):
            if k > 0:
                state = plant.step_setpoints(state, under_way.popleft())
                if not state.status.ok:
                    raise ModelError(f"the plant stopped at {(k - 1) * dt:.3f} s: {state.status}")
            state, seen = plant.observe(state)
            wanted = None if reference is None else reference(k * dt, inner)
            start_ns = time.thread_time_ns()
            inner, estimate, command = self.step(inner, seen.reading_pa, seen.poses, seen.imus, dt, wanted)
            spent = 1e-3 * (time.thread_time_ns() - start_ns)
            if command.status.ok:
                setpoint = command.setpoint_pa
            under_way.append(setpoint)
            at_bound += int(np.count_nonzero(command.saturated))
            part = at_bound / ((k + 1) * len(setpoint))
            yield Tick(k * dt, state, seen, estimate, command, spent, part)
        if part > AT_LIMIT_PART:
            text = (
                "the loop has run with %.0f%% of the set points at a bound: lower the reference or the load"
            )
            logging.getLogger("soro_core").warning(text, 100.0 * part)


def _name_out_of_reach(controller: Controller) -> None:
    from soro_core.control.reference_feasibility import check_reach

    try:
        check_reach(controller, _REACH)
    except ConfigError as error:
        logging.getLogger("soro_core").warning("%s", error)


def _positions(poses: Sequence[PoseSample]) -> list[StampedPosition]:
    """Return what the probe judges of poses."""
    from soro_core.control.probing.stamps import StampedPosition

    return [StampedPosition(one.sensor, one.stamp_s, one.position) for one in poses]


def certainty_of(estimate: Estimate) -> Certainty | None:
    """Return what a law may learn from: nothing of a filter that has lost the arm."""
    from soro_core.control.laws.protocol import Certainty  # once a tick: not by the package's lazy name

    if not estimate.status.ok:
        return None
    covariance, n = estimate.covariance.copy(), len(estimate.q)
    covariance[:n, :n] += estimate.unseen
    return Certainty(covariance, estimate.positions, estimate.external)
