"""Where on an arm something is fixed."""

from __future__ import annotations

from dataclasses import dataclass

from soro_core.errors import ModelError
from soro_core.robot import Robot

# Part of the arm's length by which a place may miss the end of a link and still be meant as that end.
_END = 1e-6


@dataclass(frozen=True)
class Place:
    """A cross-section of a robot.

    Attributes
    ----------
    link : int
        Number of the link.
    s : float or None
        Undeformed length [m] from the beginning of the link; None: its end, wherever
        a fit of the length puts it.
    """

    link: int
    s: float | None = None

    @property
    def is_base(self) -> bool:
        """Whether it is the base of the arm, which does not move."""
        return self.link == 0 and self.s == 0.0

    def along(self, robot: Robot) -> float:
        """Return the undeformed length [m] from the base of the arm, as `SoftArm.pose` takes it.

        Raises
        ------
        ModelError
            If the robot has no such place.
        """
        if not 0 <= self.link < len(robot.links):
            raise ModelError(
                f"{robot.name}: no link {self.link}; allowed are 0 to {len(robot.links) - 1}", "link"
            )
        length = robot.links[self.link].length
        if self.s is not None and not 0.0 <= self.s <= length:
            raise ModelError(
                f"{robot.name}: link {self.link} has no place {self.s:g} m; allowed is 0 to {length:g} m", "s"
            )
        return sum(link.length for link in robot.links[: self.link]) + (length if self.s is None else self.s)

    def __str__(self) -> str:
        if self.is_base:
            return "the base"
        return (
            f"the end of link {self.link}" if self.s is None else f"link {self.link} at {1e3 * self.s:g} mm"
        )


def place_of_part(robot: Robot, part: float) -> Place:
    """Return the place at a part of the arm's length, 0 (base) to 1 (tip), as scenes state places."""
    left = part * robot.length
    for index, link in enumerate(robot.links):
        if abs(left - link.length) <= _END * robot.length:
            return Place(index)
        if left < link.length:
            return Place(index, left)
        left -= link.length
    return Place(len(robot.links) - 1)
