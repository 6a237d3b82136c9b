"""The bodies of a scene beside its arms: one tick of all of them, with the pressures of the twins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from soro_core.arrays import Array
from soro_core.bodies import BodyWorld, RigidBody, WorldResult, WorldState, WorldStepper
from soro_core.twin.twin import Twin, TwinState

# Longest step of arms that touch bodies [s].
STEP_S = 1e-3
# Time before control begins [s]: bodies with a motion are where it begins.
_BEFORE_S = -1.0


@dataclass(frozen=True)
class BodyTick:
    """Bodies and contacts at one tick.

    Attributes
    ----------
    state : WorldState
        At the tick.
    result : WorldResult or None
        What has led to it; None at the start.
    names : tuple of str
        Of the bodies.
    """

    state: WorldState
    result: WorldResult | None
    names: tuple[str, ...]

    @cached_property
    def pushes(self) -> dict[tuple[str, str], tuple[Array, Array, float]]:
        """Force (3,) [N] on the first of two that touch, its torque (3,) about the origin, normal force.

        They are means over the tick: times its length they are the impulses, also those of a hit.
        """
        found: dict[tuple[str, str], tuple[Array, Array, float]] = {}
        if self.result is None:
            return found
        contacts, arms = self.result.contacts, list(self.result.world.arms)
        share = np.diff(self.result.t) / (self.result.t[-1] - self.result.t[0])
        for k, step in enumerate(contacts.step):
            one, other = (self.names[s] if s >= 0 else arms[-1 - s] for s in contacts.side[k])
            force = share[step - 1] * contacts.force[k]
            push = force, np.cross(contacts.point[k], force), float(force @ contacts.normal[k])
            before = found.get((one, other), (0.0, 0.0, 0.0))
            found[one, other] = before[0] + push[0], before[1] + push[1], before[2] + push[2]
        return found

    def wrench(self, name: str, point: Array) -> tuple[Array, Array]:
        """Contact forces (3,) [N] on a body or an arm in all, and their torque about a point [N m]."""
        force, torque = np.zeros(3), np.zeros(3)
        for pair, (push, turn, _) in self.pushes.items():
            if name in pair:
                sign = 1.0 if pair[0] == name else -1.0
                force, torque = force + sign * push, torque + sign * turn
        return force, torque - np.cross(point, force)


class TwinBodies:
    """Bodies, and the plants of twins that touch them.

    Parameters
    ----------
    bodies : mapping of str to RigidBody
    twins : mapping of str to Twin
        Of each arm by its name; their `held` is true.
    states : sequence of TwinState
        Of the twins at the start.

    Raises
    ------
    ModelError
        If surfaces overlap at the start, or an arm cannot be one of a world.
    """

    def __init__(
        self, bodies: Mapping[str, RigidBody], twins: Mapping[str, Twin], states: Sequence[TwinState]
    ) -> None:
        self._twins = twins
        world = BodyWorld(
            bodies,
            {name: twin.plant.arm for name, twin in twins.items()},
            {name: state.arm.q for name, state in zip(twins, states, strict=True)},
        )
        step_s = min(STEP_S, *(twin.config.step_s for twin in twins.values()))
        self._stepper = WorldStepper(world, step_s)
        self._dt = min(twin.dt for twin in twins.values())
        self.names = tuple(bodies)
        """Names of the bodies."""
        self.now = BodyTick(self._stepper.initial_state(), None, self.names)
        """Bodies and contacts at the present tick."""

    def move(self, before: Sequence[TwinState], behind: Sequence[TwinState]) -> list[TwinState]:
        """Move arms and bodies by a tick; return the states of the twins, with their arms there.

        Parameters
        ----------
        before, behind : sequence of TwinState
            Of each twin at the start of the tick, and at its end with its arm where it was: they differ in
            the air.
        """
        arms = {name: state.arm for name, state in zip(self._twins, before, strict=True)}
        ways = {
            name: np.stack((start.air.pressure_pa, end.air.pressure_pa))
            for name, start, end in zip(self._twins, before, behind, strict=True)
        }
        t = max(next(iter(self._twins.values())).since(before[0]), _BEFORE_S)
        result = self._stepper.step(replace(self.now.state, arms=arms), ways, self._dt, t)
        self.now = BodyTick(WorldState.last_of(result), result, self.names)
        return [
            replace(
                state,
                arm=self.now.state.arms[name],
                status=result.status,
                touched_n=self.now.wrench(name, np.zeros(3))[0],
            )
            for name, state in zip(self._twins, behind, strict=True)
        ]
