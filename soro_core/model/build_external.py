"""Tables of what acts from outside, and of the masses that the arm carries."""

from __future__ import annotations

import numpy as np

from soro_core.arrays import Array
from soro_core.model.tables import CONTACT, HELD, External, NoExternal, Site
from soro_core.robot import Robot
from soro_core.robot.basis import radius_profile

# Places nearer than this, of a link's length, are one: round-off of added lengths.
SAME = 1e-9
PLANE = -1.0


def find(robot: Robot, s: float) -> tuple[int, float]:
    """Link at `s` metres along the arm and the place on it; a border belongs to the link before."""
    link, start = 0, 0.0
    while link < len(robot.links) - 1 and s > start + robot.links[link].length * (1.0 + SAME):
        start += robot.links[link].length
        link += 1
    length = robot.links[link].length
    return link, length if s - start > length * (1.0 - SAME) else max(s - start, 0.0)


def with_masses(robot: Robot, nodes: Array, weights: Array) -> tuple[Array, Array, Array]:
    """Add a quadrature node of weight 0 at each point mass; all links get the nodes of all.

    Parameters
    ----------
    robot : Robot
    nodes, weights : (n_nodes,)
        On 0 ... 1.

    Returns
    -------
    nodes, weights : (n_all,)
    masses : (n_links, n_all)
        Point mass at each node of each link [kg].
    """
    found = [(*find(robot, point.place), point.mass) for point in robot.point_masses]
    marks = [(link, place / robot.links[link].length, mass) for link, place, mass in found]
    places, shares = list(nodes), list(weights)
    for _, x, _ in marks:
        if not np.isclose(places, x, rtol=0.0, atol=SAME).any():
            places.append(x)
            shares.append(0.0)
    order = np.argsort(places)
    nodes, weights = np.array(places)[order], np.array(shares)[order]
    masses = np.zeros((len(robot.links), len(nodes)))
    for link, x, mass in marks:
        masses[link, np.abs(nodes - x).argmin()] += mass
    return nodes, weights, masses


def places_of(robot: Robot) -> list[tuple[int, float, int]]:
    """Link, place on it and kind of every place where something acts, outward along the arm."""
    found = [(*find(robot, s), 6 * (1 + k)) for k, s in enumerate(robot.wrench_places)]
    contacts = robot.contacts
    if contacts is not None and (contacts.planes or contacts.spheres):
        start = 0.0
        for first in range(0, len(robot.links), robot.refinement):
            group = robot.links[first : first + robot.refinement]
            length = sum(link.length for link in group)
            n = contacts.points_per_link
            found += [(*find(robot, start + length * (k + 1) / n), CONTACT) for k in range(n)]
            start += length
    if robot.tip_constraint is not None:
        found.append((len(robot.links) - 1, robot.links[-1].length, HELD))
    return sorted(found, key=lambda one: one[:2])


def external_table(robot: Robot, sites: list[tuple[int, Site]], n_q: int) -> External:
    """Table of the places where something acts from outside, and of what acts there.

    Parameters
    ----------
    robot : Robot
    sites : list of tuple of int, Site
        Kind and place of each, outward along the arm.
    n_q : int
        Number of coordinates.
    """
    places, n = [site for _, site in sites], len(sites)
    links = [robot.links[site.link] for site in places]
    at = [np.array([site.place / link.length]) for site, link in zip(places, links, strict=True)]
    radius = [radius_profile(link, x)[0] for link, x in zip(links, at, strict=True)]
    link = np.array([site.link for site in places], dtype=np.int64)
    kind = External if sites else NoExternal
    return kind(
        first=np.searchsorted(link, np.arange(len(robot.links) + 1)).astype(np.int64),
        place=np.array([site.place for site in places], dtype=np.float64),
        kind=np.array([kind for kind, _ in sites], dtype=np.int64),
        whole=np.array([site.whole for site in places], dtype=np.int64),
        step=np.array([site.step for site in places], dtype=np.float64),
        shape=np.array([site.shape for site in places], dtype=np.float64).reshape(n, n_q, 2),
        rest=np.array([site.rest for site in places], dtype=np.float64).reshape(n, 2, 6),
        radius=np.array(radius, dtype=np.float64),
        obstacles=_obstacles(robot),
        clock=np.zeros(2),
        held=_held(robot),
    )


def _obstacles(robot: Robot) -> Array:
    """Rows as in `soro_core.model.forces.contact`, (n, 14)."""
    rows, at_rest = [], (0.0, 0.0, 0.0)
    if robot.contacts is not None:
        for plane in robot.contacts.planes:
            normal = np.array(plane.normal) / np.linalg.norm(plane.normal)
            law = (plane.stiffness, plane.damping, plane.friction, plane.slip_velocity)
            rows.append([*plane.point, *normal, *law, PLANE, *at_rest])
        for ball in robot.contacts.spheres:
            law = (ball.stiffness, ball.damping, ball.friction, ball.slip_velocity)
            rows.append([*ball.centre, 0.0, 0.0, 0.0, *law, ball.radius, *at_rest])
    return np.array(rows, dtype=np.float64).reshape(len(rows), 14)


def _held(robot: Robot) -> Array:
    """Point, stiffness and damping by axis of the world, (9,)."""
    held = robot.tip_constraint
    if held is None:
        return np.zeros(9)
    on = np.array([axis in held.axes for axis in "xyz"], dtype=np.float64)
    return np.concatenate([held.point, held.stiffness * on, held.damping * on])
