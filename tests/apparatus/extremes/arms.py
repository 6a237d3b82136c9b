"""Arms of the table of extremes: chains of equal links, by the numbers that are driven to extremes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from soro_core import Robot, SoftArm, robot_from_dict
from soro_core.arrays import Array
from soro_core.robot.basis import shape_values, strain_rows

DENSITY = 1100.0
FULL_SCALE_PA = 90e3
STRAINS = ("elongation", "bending_x", "bending_y")


@dataclass(frozen=True)
class Arm:
    """A hanging chain of equal links, incompressible silicone with three chambers a link."""

    links: int = 1
    youngs_modulus: float = 1e6
    ratio: float = 0.1
    """Radius over length of a link."""
    length: float = 0.05
    """Of a link [m]."""
    loss_s: float = 0.0
    """Viscosity over Young's modulus."""
    tip_mass: float = 0.0
    """In masses of the arm."""
    basis: str = "constant"
    order: int = 0
    upright: bool = False
    area_slope: float = 0.0

    def robot(self) -> Robot:
        """Build the description."""
        radius = self.ratio * self.length
        field: dict[str, Any] = {"basis": self.basis}
        if self.basis != "constant":
            field["order"] = self.order
        link = {
            "length": self.length,
            "radius": radius,
            "density": DENSITY,
            "strains": dict.fromkeys(STRAINS, field),
            "material": {
                "youngs_modulus": self.youngs_modulus,
                "shear_modulus": self.youngs_modulus / 3.0,
                "viscosity": self.loss_s * self.youngs_modulus,
                "shear_correction": False,  # it costs more to find than the runs
            },
            "chambers": [
                {
                    "angle_rad": 2.0 * math.pi / 3.0 * k,
                    "area_m2": 0.1 * math.pi * radius**2,
                    "offset_m": 0.5 * radius,
                    "area_slope": self.area_slope,
                }
                for k in range(3)
            ],
        }
        mass = DENSITY * math.pi * radius**2 * self.length * self.links
        return robot_from_dict(
            {
                "links": [link] * self.links,
                "tip_mass": self.tip_mass * mass,
                "base_quaternion": [0.0, 0.0, 0.0, 1.0] if self.upright else [1.0, 0.0, 0.0, 0.0],
            }
        )

    def coordinates(self, robot: Robot, curvature: float = 0.0, elongation: float = 0.0) -> Array:
        """Return q of a uniform curvature [1/m], in a plane between the two axes, and elongation."""
        q = np.zeros(robot.n_q)
        uniform = q.reshape(self.links, len(STRAINS), -1)[:, :, 0]
        uniform[:] = elongation, 0.8 * curvature, 0.6 * curvature
        return q


def least_stretch(arm: SoftArm, q: Array) -> float:
    """Least 1 + elongation anywhere along the arm, of one state or of rows of states."""
    q = np.atleast_2d(q)
    least, first = math.inf, 0
    for link in arm.robot.links:
        rows = [c for c, name in enumerate(strain_rows(link)) if name == "elongation"]
        shapes = shape_values(link, np.linspace(0.0, link.length, 41))[rows]
        least = min(least, float(np.min(1.0 + q[:, [first + c for c in rows]] @ shapes)))
        first += link.n_q
    return least
