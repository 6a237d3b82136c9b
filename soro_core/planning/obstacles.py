"""The obstacles that a robot file knows, and how near the arm is to them.

The arm is what a ball of its radius covers that moves along the backbone, as in
`soro_core.model.forces.contact`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.model import SoftArm
from soro_core.robot.basis import knots, radius_profile, taper_at
from soro_core.robot.surroundings import Contacts

# How much nearer an obstacle may come between samples [m].
ERROR_M = 5e-5
# How much longer a piece of the arm may be than at rest.
_STRETCHED = 1.5


@dataclass(frozen=True)
class Obstacles:
    """What the robot file of an arm knows around it, and where the arm is looked at.

    Attributes
    ----------
    arm : SoftArm
        Of the controller.
    places, radius : ndarray (m,)
        Places along it, from one radius on, because what is nearer to the base touches what it is mounted on;
        radius of the section there [m].
    planes : ndarray (n, 6)
        Point and unit normal of each [m].
    spheres : ndarray (k, 4)
        Centre and radius of each [m].
    step_m : float
        Largest motion of a place between two samples.
    """

    arm: SoftArm
    places: Array
    radius: Array
    planes: Array
    spheres: Array
    step_m: float

    def clearance(self, at: Array) -> Array:
        """Return the clearance (m, n + k) [m] of places at (m, 3) from each obstacle, below 0 inside."""
        heights = (at[:, None] - self.planes[:, :3]) * self.planes[:, 3:]
        distances = np.linalg.norm(at[:, None] - self.spheres[:, :3], axis=2) - self.spheres[:, 3]
        return np.hstack([heights.sum(axis=2), distances]) - self.radius[:, None]

    def away_from(self, index: int, at: Array) -> Array:
        """Return the unit vector (3,) in which a place at (3,) leaves an obstacle fastest."""
        if index < len(self.planes):
            return np.asarray(self.planes[index, 3:])
        out = at - self.spheres[index - len(self.planes), :3]
        return np.asarray(out / max(float(np.linalg.norm(out)), 1e-12))

    def place_name(self, place: int) -> str:
        """Return which link is at one of the places, and where."""
        s, ends = float(self.places[place]), np.cumsum([link.length for link in self.arm.robot.links])
        link = min(int(np.searchsorted(ends, s - 1e-9)), len(ends) - 1)
        return f"{1e3 * s:.0f} mm of its length (link{link})"

    def name(self, index: int) -> str:
        """Return the key of an obstacle in the robot file, and where it is."""
        if index < len(self.planes):
            return f"contacts.planes[{index}] (through {listed(self.planes[index, :3])} mm)"
        sphere = self.spheres[index - len(self.planes)]
        where = f"centre {listed(sphere[:3])} mm, radius {1e3 * sphere[3]:g} mm"
        return f"contacts.spheres[{index - len(self.planes)}] ({where})"


def obstacles_of(arm: SoftArm, contacts: Contacts | None, error_m: float = ERROR_M) -> Obstacles | None:
    """Return the obstacles that a robot file knows, and where an arm is looked at; None where it knows none.

    Parameters
    ----------
    arm : SoftArm
        That shall keep clear of them.
    contacts : Contacts or None
        What the file states.
    error_m : float
        How much nearer an obstacle may come between places and samples [m].
    """
    if contacts is None or not (contacts.planes or contacts.spheres):
        return None
    ends = np.cumsum([link.length for link in arm.robot.links])
    links = arm.robot.links
    radii = np.array([link.radius for link in links])
    planes = [[*one.point, *(np.array(one.normal) / np.linalg.norm(one.normal))] for one in contacts.planes]
    spheres = [[*one.centre, one.radius] for one in contacts.spheres]
    # Half a step beside the nearest point of a ball, the distance from its centre is longer by this error.
    thinnest = min(radius_profile(link, knots(link)).min() for link in links)
    least = thinnest + min((one.radius for one in contacts.spheres), default=thinnest)
    step = math.sqrt(8.0 * error_m * least)
    count = math.ceil((arm.length - radii[0]) * _STRETCHED / step)
    places = np.linspace(min(radii[0], arm.length), arm.length, max(count, 1) + 1)
    radius = radii[np.minimum(np.searchsorted(ends, places - 1e-9), len(radii) - 1)] * taper_at(links, places)
    return Obstacles(
        arm,
        places,
        radius,
        np.array(planes).reshape(-1, 6),
        np.array(spheres).reshape(-1, 4),
        step,
    )


def listed(position: Array) -> str:
    """Return a position in mm."""
    return "(" + ", ".join(f"{1e3 * x:.1f}" for x in position) + ")"
