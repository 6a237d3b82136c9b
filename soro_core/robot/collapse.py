"""Pressures at which a link has no balance and collapses, docs/model.md (50), (51).

With `bend_angle: deformed` the stiffness against curvature falls as a link gets shorter: bending pulls it
short, which lets it bend more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from soro_core.robot.description import Robot
from soro_core.robot.link import Chamber, Link

# max of sqrt(-eps (1 + eps)^3), at eps = -1/4.
LARGEST = math.sqrt(27.0 / 256.0)


@dataclass(frozen=True)
class CollapsePressure:
    """Where a chamber alone collapses a link.

    Attributes
    ----------
    chamber : str
        Its name, ``link0/chamber0``.
    pressure_pa : float
        Pressure beyond which the link has no balance [Pa gauge]; below 0 for a vacuum.
    """

    chamber: str
    pressure_pa: float


def collapsing(robot: Robot) -> list[CollapsePressure]:
    """Return chambers that alone collapse a link within the robot's range of pressures.

    Links that stiffen towards a `least_elongation`, laws on the geometric angle and materials have no such
    limit. The stiffness is that at rest. That a chamber lengthens its link raises the limit, and is left out.
    """
    if robot.bend_angle != "deformed":
        return []
    low, high = robot.pressure_range_pa
    found = []
    u = -1
    for first, owner in enumerate(robot.links):
        group = robot.links[first : first + robot.refinement]
        whole = sum(link.length for link in group)
        for chamber in owner.chambers:
            u += 1
            for sign, end in ((1.0, high), (-1.0, -low)):
                limit = min(_limit(link, chamber, whole, sign) for link in group)
                if limit < end:
                    found.append(CollapsePressure(robot.chamber_names[u], sign * limit))
    return found


def _limit(link: Link, chamber: Chamber, whole: float, sign: float) -> float:
    """Size of the pressure of this sign [Pa] beyond which the link has no balance, inf without a limit."""
    if link.k_e is None or link.k_b is None or link.least_elongation is not None:
        return math.inf
    if "elongation" not in link.strains:
        return math.inf
    k_e, k_b = link.k_e[0] - link.k_e[1], link.k_b[0] - link.k_b[1]
    axial, bending = chamber.gains(link.length, whole)
    carried = [("bending_x", math.cos(chamber.angle_rad)), ("bending_y", math.sin(chamber.angle_rad))]
    bending *= math.hypot(*(part for name, part in carried if name in link.strains))
    # a P = LARGEST (1 - e P)^2, e only where the chamber shortens its link.
    a = bending / (link.length**2 * math.sqrt(k_e * k_b))
    e = axial / (link.length**2 * k_e) if sign < 0.0 else 0.0
    b = a + 2.0 * LARGEST * e
    return 2.0 * LARGEST / (b + math.sqrt(a * (b + 2.0 * LARGEST * e))) if b > 0.0 else math.inf
