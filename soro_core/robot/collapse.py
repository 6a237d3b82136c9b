"""Pressures at which a link has no balance and collapses, docs/model.md (50), (51).

With `bend_angle: deformed` the stiffness against curvature falls as a link gets shorter: bending pulls it
short, which lets it bend more.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from soro_core.robot.chamber import Chamber
from soro_core.robot.description import Robot
from soro_core.robot.link import Link

# max of sqrt(-eps (1 + eps)^3), at eps = -1/4.
LARGEST = math.sqrt(27.0 / 256.0)


@dataclass(frozen=True)
class CollapsePressure:
    """Where chambers collapse a link.

    Attributes
    ----------
    chambers : tuple of str
        Their names, ``link0/chamber0``: one, or those of the link that bend it most together.
    pressure_pa : float
        Pressure in each beyond which the link has no balance [Pa gauge]; below 0 for a vacuum.
    """

    chambers: tuple[str, ...]
    pressure_pa: float


def collapsing(robot: Robot) -> list[CollapsePressure]:
    """Return chambers that collapse a link within the robot's range of pressures.

    Those that do it alone or, of a link where none does, those that do it together at equal pressures.
    Links that stiffen towards a `least_elongation`, laws on the geometric angle and materials have no such
    limit. The stiffness is that at rest. That a single chamber lengthens its link is left out: it raises the
    limit.
    """
    if robot.bend_angle != "deformed":
        return []
    names = iter(robot.chamber_names)
    found = []
    for first in range(0, len(robot.links), robot.refinement):
        parts = robot.links[first : first + robot.refinement]
        named = [(next(names), chamber) for chamber in parts[0].chambers]
        alone = [one for name in named for one in _within(robot, parts, [name])]
        together = (one for chambers in _sides(named) for one in _within(robot, parts, chambers))
        found += alone or sorted(together, key=lambda one: abs(one.pressure_pa))[:1]
    return found


def _sides(named: Sequence[tuple[str, Chamber]]) -> Iterator[list[tuple[str, Chamber]]]:
    """Chambers on one side of a link, for every line through it that passes closely beside a chamber."""
    for _, chamber in named:
        for turn in (
            0.5 * math.pi - 1e-6,
            0.5 * math.pi + 1e-6,
            -0.5 * math.pi - 1e-6,
            -0.5 * math.pi + 1e-6,
        ):
            towards = chamber.angle_rad + turn
            side = [(name, one) for name, one in named if math.cos(one.angle_rad - towards) > 0.0]
            if len(side) > 1:
                yield side


def _within(
    robot: Robot, parts: Sequence[Link], named: Sequence[tuple[str, Chamber]]
) -> Iterator[CollapsePressure]:
    """Limits of chambers at one pressure that lie in the robot's range, above and below 0."""
    low, high = robot.pressure_range_pa
    whole = sum(link.length for link in parts)
    for sign, end in ((1.0, high), (-1.0, -low)):
        limit = min(_limit(link, [chamber for _, chamber in named], whole, sign) for link in parts)
        if limit < end:
            yield CollapsePressure(tuple(name for name, _ in named), sign * limit)


def _limit(link: Link, chambers: Sequence[Chamber], whole: float, sign: float) -> float:
    """Size of the pressure of this sign [Pa] beyond which the link has no balance, inf without a limit."""
    if link.k_e is None or link.k_b is None or link.least_elongation is not None:
        return math.inf
    if "elongation" not in link.strains:
        return math.inf
    k_e, k_b = link.k_e[0] - link.k_e[1], link.k_b[0] - link.k_b[1]
    gains = [chamber.gains(link.length, whole) for chamber in chambers]
    moments = [
        sum(bending * turn(chamber.angle_rad) for (_, bending), chamber in zip(gains, chambers, strict=True))
        for name, turn in (("bending_x", math.cos), ("bending_y", math.sin))
        if name in link.strains
    ]
    # a P = LARGEST (1 + e P)^2.
    a = math.hypot(*moments) / (link.length**2 * math.sqrt(k_e * k_b))
    e = sign * sum(axial for axial, _ in gains) / (link.length**2 * k_e)
    if len(chambers) == 1:
        e = min(e, 0.0)
    left = a - 4.0 * LARGEST * e
    if left < 0.0 or a == e == 0.0:
        return math.inf
    return 2.0 * LARGEST / (a - 2.0 * LARGEST * e + math.sqrt(a * left))
