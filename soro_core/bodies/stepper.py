"""A world a piece of time after the other, for whom the pressures of a piece follow from what was before."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from soro_core.arrays import Array
from soro_core.bodies.simulate import WorldResult, body_inputs, refuse_unknown, run_rows
from soro_core.bodies.world import BodyWorld, bases_of, build_world, first_rows
from soro_core.errors import ModelError, short
from soro_core.integrate.base_motion import WIDTH, base_rows
from soro_core.integrate.state import State
from soro_core.model.checks import number, refuse_push, shaped


@dataclass(frozen=True)
class WorldState:
    """State of a world.

    Attributes
    ----------
    arms : mapping of str to State
        Of each arm.
    place, rotation, twist : (n_b, 3), (n_b, 3, 3), (n_b, 6)
        Of the bodies in their order: centres [m], orientations, angular and linear velocities, in the world.
    angle : (n_b, 2)
        Angles and rates of hinged bodies; 0 of the others.
    """

    arms: Mapping[str, State]
    place: Array
    rotation: Array
    twist: Array
    angle: Array

    @classmethod
    def last_of(cls, result: WorldResult) -> WorldState:
        """Return the state at the end of a simulated piece."""
        arms = {
            name: State(q[-1], result.qd[name][-1], result.internal[name][-1]) for name, q in result.q.items()
        }
        names, none = list(result.world.bodies), np.zeros((1, 2))
        return cls(
            arms,
            np.array([result.place[name][-1] for name in names]),
            np.array([result.rotation[name][-1] for name in names]),
            np.array([result.twist[name][-1] for name in names]),
            np.array([result.angle.get(name, none)[-1] for name in names]),
        )


class WorldStepper:
    """The stepper of a world; the impulses of the last step are the first guess of the next one.

    Parameters
    ----------
    world : BodyWorld
    step_s : float
        Longest step [s].

    Raises
    ------
    ModelError
        If surfaces overlap at the start.
    """

    def __init__(self, world: BodyWorld, step_s: float = 1e-3) -> None:
        if not 0.0 < number(step_s) < math.inf:
            raise ModelError(f"step_s = {short(step_s)}: allowed is a number above 0", "step_s")
        self.world, self._step_s, self._goes_on = world, step_s, False
        bases = bases_of(world)
        self._built = build_world(world, bases)
        self._at_rest = {name: base_rows(base, world.arms[name], np.zeros(1)) for name, base in bases.items()}
        empty = {name: np.zeros((2, arm.n_u)) for name, arm in world.arms.items()}
        self.step(self.initial_state(), empty, step_s)  # refuses what overlaps
        self._goes_on = True

    def initial_state(self) -> WorldState:
        """Return the state at the start: arms as the world has them, with relaxed internal states."""
        rows = first_rows(self.world, 1)
        arms = {
            name: State(
                np.array(self.world.q0.get(name, np.zeros(arm.n_q)), dtype=np.float64),
                np.zeros(arm.n_q),
                np.zeros(arm.n_internal),
            )
            for name, arm in self.world.arms.items()
        }
        turned = np.array([one.rotation for one in self.world.bodies.values()]).reshape(-1, 3, 3)
        return WorldState(arms, rows.place[0], turned, rows.twist[0], rows.joint[0])

    def step(
        self,
        state: WorldState,
        pressures: Mapping[str, ArrayLike],
        dt: float,
        t: float = 0.0,
        wrenches: Mapping[str, ArrayLike] = MappingProxyType({}),
    ) -> WorldResult:
        """Return what happens within dt, divided into equal steps, while pressures change linearly.

        Parameters
        ----------
        state : WorldState
        pressures : mapping of str to (2, n_u)
            Of each arm at the start and at the end [Pa gauge].
        dt : float
            [s]
        t : float
            Time at the start [s], for bodies with a motion; these are where it says.
        wrenches : mapping of str to (6,)
            Torque [N m] and force [N] on bodies that are not fixed, in the world.

        Returns
        -------
        WorldResult
            Its first row is the state; it ends early with a status, as that of `simulate_world`.

        Raises
        ------
        ModelError
            If a shape or a name is wrong, or dt is not above 0.
        """
        if not 0.0 < number(dt) < math.inf:
            raise ModelError(f"dt = {short(dt)} s: allowed is a number above 0", "dt")
        refuse_unknown(self.world, {"wrenches": wrenches})
        world, built = self.world, self._built
        n = math.ceil(dt / self._step_s - 1e-9)
        times = t + dt * np.arange(n + 1) / n
        n_q, n_z = int(built.first_q[-1]), int(built.first_z[-1])
        q, v, z = np.zeros((n + 1, n_q)), np.zeros((n + 1, n_q)), np.zeros((n + 1, n_z))
        part = (np.arange(n + 1)[:, None] + np.array([0.0, 0.5, 1.0])) / n
        tables = [np.zeros((n + 1, 3, 0))]
        for i, (name, arm) in enumerate(world.arms.items()):
            start, end = shaped(pressures[name], (2, arm.n_u), f"pressures: {name}", name)
            table = start + part[..., None] * (end - start)
            refuse_push(arm.robot, table, f"pressures: {name}")
            tables.append(table)
            if name in self._at_rest:
                tables.append(np.broadcast_to(self._at_rest[name], (n + 1, 3, WIDTH)))
            own = state.arms[name]
            q[0, built.first_q[i] : built.first_q[i + 1]] = own.q
            v[0, built.first_q[i] : built.first_q[i + 1]] = own.qd
            z[0, built.first_z[i] : built.first_z[i + 1]] = own.internal
        rows = first_rows(world, n + 1)
        driven = {name: one for name, one in world.motions.items() if one.moves_within(t, t + dt)}
        inputs = body_inputs(world, times, wrenches, driven, rows)
        for b, (name, body) in enumerate(world.bodies.items()):
            if body.motion is not None and name not in driven:
                rows.place[0, b] += body.motion(t).displacement
            if not body.fixed:
                rows.place[0, b], rows.rotation[0, b] = state.place[b], state.rotation[b] @ body.axes
                rows.twist[0, b], rows.joint[0, b] = state.twist[b], state.angle[b]
        given = (times, np.ascontiguousarray(np.concatenate(tables, axis=2)), inputs, built.radius)
        return run_rows(world, built, given, (q, v, z), rows, self._goes_on)
