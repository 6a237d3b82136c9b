"""The arm of the twin: finer than the controller's model, and different from its file where stated."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from soro_core.arrays import Array
from soro_core.integrate import OK, State, Status, make_stepper
from soro_core.integrate.base_motion import base_rows, moved
from soro_core.model.discretised import discretised
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.pneumatics import ValveCondition
from soro_core.robot import Robot, refuse_tendons
from soro_core.twin.config import TwinConfig, check_volumes, described_plant


def true_robot(robot: Robot, config: TwinConfig) -> Robot:
    """Return the true robot at the begin: refined, loaded, and different from its file as configured."""
    robot = described_plant(robot, config)
    real = robot.scaled(
        stiffness=config.stiffness_scale, damping=config.damping_scale, gain=config.gain_scale
    ).refine(config.refine)
    return real.replace(tip_mass=robot.tip_mass + config.payload_kg)


class ArmPlant:
    """An arm and its time stepper.

    Parameters
    ----------
    robot : Robot
        Robot of the robot file.
    config : TwinConfig
        Differences of the plant from that file, and how it is integrated.

    Raises
    ------
    ConfigError
        If air is a part of the state and a chamber has no volume, the plant has other chambers, or tendons.
    """

    def __init__(self, robot: Robot, config: TwinConfig) -> None:
        real = true_robot(robot, config)
        refuse_tendons(real, "twin")
        self.arm = discretised(real, config.model)
        self.has_air = config.air == "states"
        """Whether pressures are set points of valves, and the air behind them is a part of the state."""
        if self.has_air:
            check_volumes(real, where="parameters of twin", key="air")
        valves = config.valve if self.has_air else None
        self._base = config.base_shake if config.base_shake.moves else None
        self._stepper = make_stepper(config.integrator, self.arm, valves=valves, base=self._base)
        self._step_s = config.step_s

    def rest(self, pressure_pa: Array) -> State:
        """Equilibrium under constant pressures (n_u,) [Pa].

        Raises
        ------
        ModelError
            If none is found from the straight arm.
        """
        q = equilibrium(self.arm, pressure_pa)
        return self._stepper.initial_state(q, pressure0=pressure_pa if self.has_air else None)

    def pose(self, state: State, s: float, t: float) -> Array:
        """Return the pose (4, 4) of a place in the world.

        Parameters
        ----------
        state : State
        s : float
            Undeformed arc length from the base [m].
        t : float
            Time [s], on which the base may depend.
        """
        pose = self.arm.pose(state.q, s)
        if self._base is None:
            return pose
        seen: Array = moved(self.arm, base_rows(self._base, self.arm, np.array([t])), pose[None])[0]
        return seen

    def pressures(self, state: State) -> Array:
        """Gauge pressures (n_u,) [Pa] of the air in the chambers, where it is a part of the state."""
        return self._stepper.pressures(state)

    def at_pressures(self, state: State, pressure_pa: Array) -> State:
        """Return the state with other gauge pressures (n_u,) [Pa] of the air, where it is a part of it."""
        if not self.has_air:
            return state
        n = self.arm.n_internal
        filled = self._stepper.initial_state(state.q, state.qd, pressure_pa)
        return replace(state, internal=np.concatenate((state.internal[:n], filled.internal[n:])))

    def advance(
        self,
        state: State,
        start_pa: Array,
        end_pa: Array,
        dt: float,
        condition: ValveCondition | None = None,
        t: float = 0.0,
    ) -> tuple[State, Status]:
        """Advance by `dt` while the pressures change linearly.

        Parameters
        ----------
        state : State
            State at the start.
        start_pa, end_pa : ndarray (n_u,)
            Gauge pressures [Pa]; with air as a part of the state the set points of its valves.
        dt : float
            Time [s]; it is divided into equal steps of at most `step_s`.
        condition : ValveCondition, optional
            Condition of the valves, where air is a part of the state; default healthy.
        t : float
            Time at the start [s], on which the motion of the base depends.

        Returns
        -------
        state : State
            State at the end, or where a step failed.
        status : Status
            Status of the last step.
        """
        steps = max(1, math.ceil(dt / self._step_s - 1e-9))
        status = OK
        for k in range(steps):
            middle = start_pa + (end_pa - start_pa) * ((k + 0.5) / steps)
            at = t + k * dt / steps
            state, status = self._stepper.step(state, middle, dt / steps, condition=condition, t=at)
            if not status.ok:
                break
        return state, status
