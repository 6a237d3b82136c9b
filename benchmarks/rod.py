"""The rod that both codes are given: round, linear elastic and viscous, constant strains, three a link."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from soro_core import robot_from_dict
from soro_core.robot import Robot

# The bent release of the reference trajectories (reference/ref_hang_bent_kv).
LENGTH = 0.2
RADIUS = 0.015
DENSITY = 1100.0
YOUNG = 5e5
SHEAR = YOUNG / 3
VISCOSITY = 300.0
BEND = np.pi / 2

HANGING = (0.0, 0.0, 9.81)  # along the tangent of the base
ANY = (3.0, -4.0, 8.0)  # excites every direction


def robot(n_links: int, gravity: tuple[float, float, float] = HANGING) -> Robot:
    """Rod of n equal links. Without shear correction, which the peer does not have."""
    link = {
        "length": LENGTH / n_links,
        "radius": RADIUS,
        "density": DENSITY,
        "material": {
            "youngs_modulus": YOUNG,
            "shear_modulus": SHEAR,
            "viscosity": VISCOSITY,
            "shear_correction": False,
        },
    }
    return robot_from_dict({"links": [link] * n_links, "gravity": list(gravity)})


def bent(n_links: int) -> NDArray[np.float64]:
    """Uniformly bent by BEND over the length, (3 n,)."""
    return np.tile([0.0, BEND / LENGTH, 0.0], n_links)


def states(n_links: int, count: int = 64, seed: int = 0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Random coordinates and velocities, (count, 3 n): curvature of some 5 1/m, strain of some 5 %."""
    rng = np.random.default_rng(seed)
    scale = np.tile([0.05, 5.0, 5.0], n_links)
    q = np.clip(rng.normal(size=(count, 3 * n_links)), -3, 3) * scale
    return q, rng.normal(size=q.shape) * 5 * scale
