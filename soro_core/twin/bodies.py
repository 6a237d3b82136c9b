"""The bodies of a scene beside its arms: one tick of all of them, with the pressures of the twins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np

from soro_core.arrays import Array
from soro_core.bodies import BodyWorld, RigidBody, WorldResult, WorldState, WorldStepper
from soro_core.bodies.body import HingeDrive
from soro_core.errors import ModelError
from soro_core.integrate.state import State
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
    efforts : mapping of str to float
        Torques of the drives of hinged bodies [N m], within the tick.
    """

    state: WorldState
    result: WorldResult | None
    names: tuple[str, ...]
    efforts: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def pushes(self) -> dict[tuple[str, str], tuple[Array, Array, float]]:
        """Force (3,) [N] on the first of two that touch, its torque (3,) about the origin, normal force.

        They are means over the tick: times its length they are the impulses, also those of a hit.
        """
        if self.result is None or not len(self.result.contacts.gap):
            return {}
        contacts, t = self.result.contacts, self.result.t
        share = np.diff(t, prepend=t[0]) / (t[-1] - t[0])
        force = share[contacts.step, None] * contacts.force
        torque, normal = np.cross(contacts.point, force), (force * contacts.normal).sum(axis=1)
        sides, pair = np.unique(contacts.side, axis=0, return_inverse=True)
        sums = np.zeros((len(sides), 7))
        np.add.at(sums, pair.ravel(), np.column_stack((force, torque, normal)))
        names = [*self.names, *reversed(list(self.result.world.arms))]  # that of an arm counts from the end
        return {
            (names[one], names[other]): (row[:3], row[3:6], float(row[6]))
            for (one, other), row in zip(sides.tolist(), sums, strict=True)
        }

    def wrench(self, name: str, point: Array) -> tuple[Array, Array]:
        """Contact forces (3,) [N] on a body or an arm in all, and their torque about a point [N m].

        An arm that touches itself gets none.
        """
        force, torque = np.zeros(3), np.zeros(3)
        for (one, other), (push, turn, _) in self.pushes.items():
            sign = float(name == one) - float(name == other)
            force, torque = force + sign * push, torque + sign * turn
        return force, torque - np.cross(point, force)


def _straight(arm: State) -> State:
    return State(*map(np.zeros_like, (arm.q, arm.qd, arm.internal)))


class TwinBodies:
    """Bodies, and the plants of twins that touch them.

    Parameters
    ----------
    bodies : mapping of str to RigidBody
    twins : mapping of str to Twin
        Of each arm by its name, with a `bodies_file`.
    states : sequence of TwinState
        Of the twins, each at rest.
    mounts : mapping of str to str
        Arms at the tip of another one, and the arm that carries each. Their twins see all from that tip.

    Raises
    ------
    ModelError
        If surfaces overlap at the start, an arm cannot be one of a world, or a drive is too stiff for a tick.
    """

    def __init__(
        self,
        bodies: Mapping[str, RigidBody],
        twins: Mapping[str, Twin],
        states: Sequence[TwinState],
        mounts: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        self._twins = twins
        holding = {body.attached.arm or next(iter(twins)) for body in bodies.values() if body.attached}
        holding |= {mounts[name] for name in holding if name in mounts}
        self.begins = tuple(
            replace(state, arm=_straight(state.arm)) if name in holding else state
            for name, state in zip(twins, states, strict=True)
        )
        """States of the twins at the start: an arm that holds a body is straight, as its file places it.

        So is one that carries such an arm.
        """
        world = BodyWorld(
            bodies,
            {name: twin.plant.arm for name, twin in twins.items()},
            {name: state.arm.q for name, state in zip(twins, self.begins, strict=True)},
            mounts,
        )
        step_s = min(STEP_S, *(twin.config.step_s for twin in twins.values()))
        self._stepper = WorldStepper(world, step_s)
        self._dt = min(twin.dt for twin in twins.values())
        self._driven: dict[str, tuple[int, Array, HingeDrive]] = {}
        for number, (name, body) in enumerate(bodies.items()):
            if body.hinge is not None and (drive := body.hinge.drive) is not None:
                axis, _, inertia = body.about_hinge()
                if inertia < (least := drive.least_inertia(self._dt)):
                    raise ModelError(
                        f"body {name}: its drive is too stiff for ticks of {1e3 * self._dt:g} ms; allowed "
                        f"are drives whose tick (damping + tick stiffness), here {least:.2g} kg m2, is at "
                        f"most the inertia about the hinge, {inertia:.2g} kg m2"
                    )
                self._driven[name] = number, axis, drive
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
        efforts = self._efforts(t)
        turned = {
            name: np.concatenate((torque * self._driven[name][1], np.zeros(3)))
            for name, torque in efforts.items()
        }
        result = self._stepper.step(replace(self.now.state, arms=arms), ways, self._dt, t, turned)
        self.now = BodyTick(WorldState.last_of(result), result, self.names, efforts)
        shapes = {name: state.q for name, state in self.now.state.arms.items()}
        return [
            replace(
                state,
                arm=self.now.state.arms[name],
                status=result.status,
                touched_n=self.now.wrench(name, np.zeros(3))[0] @ result.world.frame_of(name, shapes)[:3, :3],
            )
            for name, state in zip(self._twins, behind, strict=True)
        ]

    def _efforts(self, t: float) -> dict[str, float]:
        """Return the torques [N m] of the drives of hinged bodies, from a time [s] on for a tick."""
        efforts = {}
        for name, (number, _, drive) in self._driven.items():
            angle, rate = self.now.state.angle[number]
            efforts[name] = drive.torque(t, float(angle), float(rate))
        return efforts
