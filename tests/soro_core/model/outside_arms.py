"""Arms that meet something: of all six strains, or nearly free of the base."""

from typing import Any

import numpy as np

from soro_core import SoftArm, robot_from_dict

SIX = ("torsion", "bending_x", "bending_y", "elongation", "shear_x", "shear_y")
# Links and basis: closed forms and Magnus steps.
CASES = [(1, "constant"), (2, "legendre"), (3, "constant"), (4, "legendre")]
PLANE = {"point": [0.0, 0.0, 0.06], "normal": [0.3, 0.1, -2.0], "stiffness": 500.0}
SPHERE = {"centre": [0.02, 0.01, 0.05], "radius": 0.02, "stiffness": 800.0}


def field(basis: str) -> dict[str, Any]:
    return {"basis": basis} if basis == "constant" else {"basis": basis, "order": 1}


def arm_of(n_links: int, basis: str, **keys: Any) -> SoftArm:
    link = {
        "length": 0.1,
        "radius": 0.01,
        "density": 1100.0,
        "strains": {name: field(basis) for name in SIX},
        "material": {"youngs_modulus": 2e5, "shear_modulus": 7e4, "viscosity": 300.0},
    }
    robot = {"links": [link] * n_links, "base_quaternion": [0.1, 0.1, 0.1, np.sqrt(0.97)], **keys}
    return SoftArm(robot_from_dict(robot))


def state_of(arm: SoftArm, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    angular = [name.split("/")[1].startswith(("bending", "torsion")) for name in arm.robot.coordinate_names]
    scale = np.where(angular, 3.0, 0.05)
    return rng.normal(size=arm.n_q) * scale, rng.normal(size=arm.n_q) * scale


def gradient(f: Any, q: np.ndarray, h: float = 1e-6) -> np.ndarray:
    """Central differences, one row for each coordinate."""
    return np.array([(f(q + step) - f(q - step)) / (2 * h) for step in h * np.eye(len(q))])


def loose_arm(height: float, slope: float = 0.0, **surface: Any) -> SoftArm:
    """Rod along the world's x, 10 cm of 10 mm radius, on a floor z = 0 in a world tilted by `slope`.

    It hangs on a thin carrier of next to no stiffness that lets it move freely, without turning.
    """
    carrier = {
        "length": 0.05,
        "radius": 1e-3,
        "density": 1.0,
        "strains": {name: {} for name in ("shear_x", "shear_y", "elongation")},
        "material": {"youngs_modulus": 1e-3, "shear_modulus": 1e-3, "shear_correction": False},
    }
    rod = {
        "length": 0.1,
        "radius": 0.01,
        "density": 1100.0,
        "strains": {name: {} for name in ("bending_x", "bending_y", "elongation")},
        "material": {"youngs_modulus": 1e6, "shear_modulus": 3e5, "viscosity": 50.0},
    }
    half = np.sqrt(0.5)
    floor = {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0], "stiffness": 200.0, **surface}
    robot = {
        "links": [carrier, rod],
        "base_quaternion": [0.0, half, 0.0, half],
        "base_position": [0.0, 0.0, height],
        "gravity": [9.81 * np.sin(slope), 0.0, -9.81 * np.cos(slope)],
        "contacts": {"planes": [floor]},
    }
    return SoftArm(robot_from_dict(robot))
