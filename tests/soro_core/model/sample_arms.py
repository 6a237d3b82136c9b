"""Random robots and states for the property tests; every one comes from a seed."""

from typing import Any

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st

from soro_core.robot import Robot, robot_from_dict

# Deterministic: the same examples in every run; compiling in the first example is no reason to fail.
SETTINGS = settings(max_examples=25)

SIX = ("torsion", "bending_x", "bending_y", "elongation", "shear_x", "shear_y")
SETS = (
    ("elongation", "bending_x", "bending_y"),
    ("bending_y", "bending_x"),
    ("bending_x", "elongation"),
    SIX,
    ("shear_y", "torsion", "bending_x"),
    ("elongation", "bending_y", "torsion", "bending_x"),
)
seeds = st.integers(min_value=0, max_value=10**6)


def law_link(rng: np.random.Generator, **keys: Any) -> dict[str, Any]:
    """Link with the two laws of the bellow robot's size."""
    a1, a4 = rng.uniform(200, 900), rng.uniform(0.01, 0.05)
    return {
        "length": rng.uniform(0.05, 0.12),
        "radius": rng.uniform(0.01, 0.03),
        "mass": rng.uniform(0.01, 0.1),
        "k_e": [a1, a1 * rng.uniform(0.1, 0.8), rng.uniform(10, 60)],
        "k_b": [a4, a4 * rng.uniform(0.1, 0.8), rng.uniform(0.2, 1.5)],
        **keys,
    }


def material_link(rng: np.random.Generator, strains: tuple[str, ...], **keys: Any) -> dict[str, Any]:
    """Link of silicone with any strains."""
    return {
        "length": rng.uniform(0.05, 0.12),
        "radius": rng.uniform(0.01, 0.03),
        "density": rng.uniform(900, 1300),
        "strains": {name: {"basis": "constant"} for name in strains},
        "material": {
            "youngs_modulus": rng.uniform(1e5, 1e6),
            "shear_modulus": rng.uniform(1e5, 4e5),
            "viscosity": rng.uniform(0, 500),
        },
        **keys,
    }


def chambers(rng: np.random.Generator, **keys: Any) -> list[dict[str, Any]]:
    """Three chambers around the backbone."""
    angles = rng.uniform(0, 2 * np.pi) + 2 * np.pi / 3 * np.arange(3)
    return [{"angle_rad": float(a) % 6.28, "area_m2": 3e-5, "offset_m": 0.01, **keys} for a in angles]


def random_robot(seed: int, n_links: int | None = None) -> Robot:
    """Chain of links with laws or material, any base, any gravity; some are bent and twisted at rest."""
    rng, at_rest = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    links = []
    for _ in range(n_links or int(rng.integers(1, 5))):
        if rng.random() < 0.5:
            links.append(law_link(rng, chambers=chambers(rng)))
        else:
            links.append(material_link(rng, SETS[int(rng.integers(len(SETS)))]))
        if at_rest.random() < 0.3:
            bend, torsion = at_rest.normal(size=2) * 5.0, float(at_rest.normal()) * 5.0
            links[-1] |= {"rest_curvature_per_m": list(bend), "rest_torsion_per_m": torsion}
    quaternion = rng.normal(size=4)
    return robot_from_dict(
        {
            "links": links,
            "tip_mass": float(rng.choice([0.0, 0.05])),
            "gravity": list(rng.normal(size=3) * 9.81),
            "base_quaternion": list(quaternion / np.linalg.norm(quaternion)),
            "base_position": list(rng.normal(size=3)),
            "bend_angle": str(rng.choice(["deformed", "geometric"])),
        }
    )


def random_state(robot: Robot, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """State with visible strains, curvature up to about 10 1/m."""
    rng = np.random.default_rng(seed + 1)
    scale = np.array(
        [
            5.0 if name.split("/")[1] in ("torsion", "bending_x", "bending_y") else 0.1
            for name in robot.coordinate_names
        ]
    )
    return np.clip(rng.normal(size=robot.n_q), -2, 2) * scale, rng.normal(size=robot.n_q) * 5 * scale
