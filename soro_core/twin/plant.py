"""The arm of the twin: finer than the controller's model, and different from its file where stated."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from soro_core.arrays import Array
from soro_core.config import with_changes
from soro_core.integrate import OK, State, Status, make_stepper
from soro_core.integrate.base_motion import base_rows, forces_on_base, moved
from soro_core.model.discretised import discretised
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.model.soft_arm import SoftArm
from soro_core.model.tables import CONTACT
from soro_core.pneumatics import ValveCondition
from soro_core.robot import Contacts, Robot, refuse_tendons
from soro_core.twin.config import LEFT_BY_1000, TwinConfig, check_volumes, described_plant
from soro_core.twin.followed_base import BaseWay, FollowedBase

# Longest step times angular frequency of the free tip on a wall; from 1.8 on it bounces higher and higher.
BOUNCE = 1.2


def true_robot(robot: Robot, config: TwinConfig) -> Robot:
    """Return the true robot at the begin: refined, loaded, and different from its file as configured."""
    robot = described_plant(robot, config)
    stiffness = config.stiffness_scale * LEFT_BY_1000 ** (1e-3 * config.cycles)
    real = robot.scaled(stiffness=stiffness, damping=config.damping_scale, gain=config.gain_scale).refine(
        config.refine
    )
    return real.replace(tip_mass=robot.tip_mass + config.payload_kg)


def _bounce_step(arm: SoftArm, stiffness: float) -> float:
    """Longest step [s] that resolves how the tip bounces on a stiffness [N/m]: longer ones gain energy."""
    jacobian = arm.jacobian(np.zeros(arm.n_q), arm.length)[3:]
    mobility = jacobian @ np.linalg.solve(arm.inertia_matrix(np.zeros(arm.n_q)), jacobian.T)
    return float(BOUNCE / np.sqrt(stiffness * np.linalg.eigvalsh(mobility)[-1]))


def _with_pushes(robot: Robot, config: TwinConfig) -> Robot:
    """Return the robot with the wall behind its own planes, and places for wrenches, the tip as the last."""
    if config.wall.stiffness:
        contacts = robot.contacts or Contacts()
        planes = (*contacts.planes, config.wall.plane)
        robot = robot.replace(contacts=with_changes(contacts, planes=planes))
    inner = (config.wrench.location * robot.length,) if config.wrench.location < 1.0 else ()
    places = (*robot.wrench_places, *inner)
    return robot.replace(wrench_places=(*places, robot.length)) if places else robot


class Instant(NamedTuple):
    """Time of a state, and what pushes then beside the scene."""

    t: float = 0.0
    """Time [s], on which the motion of the base depends."""
    since: float = -math.inf
    """Time after the begin of control [s], -inf before it."""
    push: Array | None = None
    """Torque [N m] and force [N] at the tip in the world, (6,)."""


WAITING = Instant()


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
        real = _with_pushes(true_robot(robot, config), config)
        refuse_tendons(real, "twin")
        self.arm = discretised(real, config.model)
        self.has_air = config.air == "states"
        """Whether pressures are set points of valves, and the air behind them is a part of the state."""
        if self.has_air:
            check_volumes(real, where="parameters of twin", key="air")
        valves = config.valve if self.has_air else None
        self._push, self._wall = config.wrench, config.wall if config.wall.stiffness else None
        self._followed = FollowedBase() if config.base_by_topic else None
        self._base = config.base_shake if config.base_shake.moves else self._followed
        self._stepper = make_stepper(config.integrator, self.arm, valves=valves, base=self._base)
        stiffness = config.wall.stiffness
        self._step_s = min(config.step_s, _bounce_step(self.arm, stiffness) if stiffness else math.inf)

    def rest(self, pressure_pa: Array) -> State:
        """Equilibrium under constant pressures (n_u,) [Pa].

        Raises
        ------
        ModelError
            If none is found from the straight arm.
        """
        self.move_wall(-math.inf)
        q = equilibrium(self.arm, pressure_pa)
        return self._stepper.initial_state(q, pressure0=pressure_pa if self.has_air else None)

    def follow(self, way: BaseWay) -> None:
        """Let the base go this way from now on, where it follows poses."""
        if self._followed is not None:
            self._followed.way = way

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

    def wrench(self, state: State, t: float, since: float, push: Array | None) -> Array | None:
        """Return the wrenches on the arm as `Stepper.step` takes them, None without.

        Parameters
        ----------
        state : State
        t, since : float
            Time, and time after the begin of control [s].
        push : ndarray (6,), optional
            Torque [N m] and force [N] at the tip in the world, beside those of the scene.
        """
        own = self._push.at(since) if self._push.at_s else None
        if own is None and push is None:
            return None
        places = self.arm.robot.wrench_places or (self.arm.length,)
        rows = np.zeros((len(places), 6))
        for row, values in ((-1, push), (-2 if self._push.location < 1.0 else -1, own)):
            if values is not None and values.any():
                turn = self.pose(state, places[row], t)[:3, :3].T
                rows[row] += np.concatenate((turn @ values[:3], turn @ values[3:]))
        return rows if self.arm.robot.wrench_places else rows[0]

    def contact_force(self, state: State, t: float, since: float) -> Array:
        """Sum (3,) of the forces of contact on the arm, in the world [N].

        Parameters
        ----------
        state : State
        t, since : float
            As of `wrench`.
        """
        if self.arm.robot.contacts is None:
            return np.zeros(3)
        self.move_wall(since)
        if self._base is None:
            force = self.arm.external_forces(state.q, state.qd).force
        else:
            force = forces_on_base(self._base, self.arm, t, state.q, state.qd)
        return np.asarray(force[self.arm.tables.external.kind == CONTACT].sum(axis=0))

    def move_wall(self, since: float) -> None:
        """Put the wall where it is at a time after the begin of control [s], for what `arm` tells next."""
        contacts = self.arm.robot.contacts
        if self._wall is not None and contacts is not None:
            external = self.arm.tables.external
            row, external.clock[:] = external.obstacles[len(contacts.planes) - 1], 0.0
            row[:3], row[11:] = self._wall.at(since)

    def advance(
        self,
        state: State,
        start_pa: Array,
        end_pa: Array,
        dt: float,
        condition: ValveCondition | None = None,
        at: Instant = WAITING,
    ) -> tuple[State, Status]:
        """Advance by `dt` while the pressures change linearly.

        A push is held over each of the equal steps: its value in the middle, in the direction in the world
        that it has with the arm at the start.

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
        at : Instant
            The start of the step; default before control begins, without a push.

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
            t, since = at.t + k * dt / steps, at.since + k * dt / steps
            self.move_wall(since)
            wrench = self.wrench(state, t, since + 0.5 * dt / steps, at.push)
            state, status = self._stepper.step(state, middle, dt / steps, wrench, condition, t)
            if not status.ok:
                break
        return state, status
