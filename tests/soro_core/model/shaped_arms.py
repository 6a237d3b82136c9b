"""Links whose section and rest strain change along them."""

from typing import Any

import numpy as np

from soro_core import SoftArm, robot_from_dict

MATERIAL = {"youngs_modulus": 5e5, "shear_modulus": 1.7e5, "viscosity": 300.0}
LAWS = {"k_e": [400.0, 200.0, 30.0], "k_b": [0.02, 0.01, 0.6], "mass": 0.04}
SIX = ("elongation", "bending_x", "bending_y", "torsion", "shear_x", "shear_y")
LENGTH = 0.2
# Radius, mass and stiffness by place, with a bend of each inside the link; a helix that winds up to the tip.
SECTIONS = [
    {"place": 0.0, "radius": 0.015, "stiffness": 1.0, "rest_curvature_per_m": [3.0, -1.0]},
    {"place": 0.08, "radius": 0.011, "stiffness": 1.5, "rest_curvature_per_m": [6.0, 2.0]},
    {"place": 0.2, "radius": 0.006, "stiffness": 0.8, "rest_curvature_per_m": [12.0, 1.0]},
]
FIELDS = {name: {"basis": "legendre", "order": 1} for name in ("elongation", "bending_x", "bending_y")}


def link_of(**keys: Any) -> dict[str, Any]:
    """Link of silicone with all of it; a key of None is left out."""
    link = {
        "length": LENGTH,
        "sections": SECTIONS,
        "rest_torsion_per_m": 15.0,
        "density": 1100.0,
        "strains": FIELDS,
        "material": MATERIAL,
        **keys,
    }
    return {key: value for key, value in link.items() if value is not None}


def uniform_helix(**keys: Any) -> dict[str, Any]:
    """Link that tapers, of uniform rest strain and constant strain: closed forms along it."""
    rows = [{"place": 0.0, "radius": 0.015}, {"place": LENGTH, "radius": 0.007}]
    rest = {"rest_curvature_per_m": [9.0, -4.0], "rest_torsion_per_m": 12.0}
    return link_of(**{"sections": rows, "strains": None, **rest, **keys})


def shaped_arm(**keys: Any) -> SoftArm:
    """Helix of two links: one by place with varying strain, one with the laws of a bellow."""
    laws = link_of(material=None, density=None, **LAWS)
    links = [link_of(), laws, uniform_helix()]
    return SoftArm(robot_from_dict({"links": links, "base_quaternion": [0.1, 0.7, 0.1, 0.7], **keys}))


def state_of(arm: SoftArm, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    angular = [name.split("/")[1].startswith(("bending", "torsion")) for name in arm.robot.coordinate_names]
    scale = np.where(angular, 3.0, 0.03)
    return rng.normal(size=arm.n_q) * scale, 5.0 * rng.normal(size=arm.n_q) * scale
