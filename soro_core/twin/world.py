"""The arms of a scene in one time: all of them make a tick together, when what each needs for it is there.

What acts between arms (bodies, contact, an arm at the tip of another) belongs here: `ArmWorld.move` has all
of them at the same instant, behind their inputs and before what they show of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:  # a world without bodies has none of their code
    from soro_core.twin.bodies import TwinBodies
    from soro_core.twin.twin import TwinState


class Simulated(Protocol):
    """One arm of a world, with its clock, air and sensors."""

    @property
    def is_started(self) -> bool:
        """Whether its time may begin."""

    @property
    def rests(self) -> bool:
        """Whether its time may end."""

    @property
    def state(self) -> TwinState:
        """Its state now."""

    def is_due(self) -> bool:
        """Take the input of the next tick, if it is there; return whether it is."""

    def step(self) -> None:
        """Move by a tick, if its input has been taken; beside bodies its air alone."""

    def arrive(self, state: TwinState) -> None:
        """Take over the state to which bodies have brought it."""

    def show(self) -> None:
        """Give the samples of the tick."""

    def join(self) -> None:
        """Take the present pressures, before time begins."""

    def end(self) -> None:
        """Note that time has ended."""


class ArmWorld:
    """Arms that share their time.

    Attributes
    ----------
    arms : list of Simulated
        The first one sets the clock of the nodes.
    bodies : TwinBodies or None
        What they touch.
    """

    def __init__(self) -> None:
        self.arms: list[Simulated] = []
        self.bodies: TwinBodies | None = None

    def begin(self) -> None:
        """Begin the time of all arms, once the last one is started; each has its air before any shows it."""
        if not all(arm.is_started for arm in self.arms):
            return
        for arm in self.arms:
            arm.join()
        for arm in self.arms:
            arm.show()

    def tick(self) -> bool:
        """Move all arms by a tick, if each has its input; return whether they have moved."""
        due = [arm.is_due() for arm in self.arms]  # each is asked: one takes its input only then
        if not all(due):
            return False
        self.move()
        for arm in self.arms:
            arm.show()
        return True

    def move(self) -> None:
        """Move arms and bodies by a tick, if the inputs have been taken."""
        if self.bodies is None:
            for arm in self.arms:
                arm.step()
            return
        before = [arm.state for arm in self.arms]
        for arm in self.arms:
            arm.step()
        behind = [arm.state for arm in self.arms]
        if behind[0].tick > before[0].tick:
            for arm, state in zip(self.arms, self.bodies.move(before, behind), strict=True):
                arm.arrive(state)

    def ends(self) -> bool:
        """End the time of all arms if every one of them rests; return whether it has ended."""
        if not all(arm.rests for arm in self.arms):
            return False
        for arm in self.arms:
            arm.end()
        return True
