"""Arms of the stepper tests: hanging rods of one material, and bellows with chambers."""

from typing import Any

import numpy as np

from soro_core import SoftArm, robot_from_dict
from soro_core.integrate import Result

IMPLICIT = (
    "trapezoidal",
    "midpoint_linear",
    "midpoint",
    "tr_bdf2",
    "tr_bdf2_linear",
)
EXPLICIT = ("rk4", "dopri5")
LENGTH = 0.2


def rod(n_links: int, youngs_modulus: float, viscosity: float, **keys: Any) -> SoftArm:
    """Silicone rod of 200 mm, hanging, in links of three strains each."""
    material = {
        "youngs_modulus": youngs_modulus,
        "shear_modulus": youngs_modulus / 3,
        "viscosity": viscosity,
    }
    link = {
        "length": LENGTH / n_links,
        "radius": 0.015,
        "density": 1100.0,
        "material": material,
        **keys,
    }
    return SoftArm(robot_from_dict({"links": [link] * n_links, "base_quaternion": [1.0, 0.0, 0.0, 0.0]}))


def bellows(**keys: Any) -> SoftArm:
    """One link with measured-law stiffness and three chambers."""
    chambers = [{"angle_rad": a, "area_m2": 2e-4, "offset_m": 0.012} for a in (0.0, 2.1, 4.2)]
    link = {
        "length": 0.06,
        "radius": 0.015,
        "mass": 0.02,
        "k_e": [400.0, 200.0, 30.0],
        "k_b": [0.02, 0.01, 0.5],
        "damping": [0.02, 1e-6, 1e-6],
        "chambers": chambers,
        **keys,
    }
    return SoftArm(robot_from_dict({"links": [link]}))


def helix(viscosity: float = 300.0, **keys: Any) -> SoftArm:
    """One link of linear strains that tapers, with chambers; a helix at rest that winds up to its tip."""
    link = {
        "length": LENGTH,
        "sections": [
            {"place": 0.0, "radius": 0.015, "stiffness": 1.0, "rest_curvature_per_m": [3.0, -1.0]},
            {"place": 0.08, "radius": 0.012, "stiffness": 1.5, "rest_curvature_per_m": [6.0, 2.0]},
            {"place": LENGTH, "radius": 0.007, "stiffness": 0.8, "rest_curvature_per_m": [12.0, 1.0]},
        ],
        "rest_torsion_per_m": 15.0,
        "density": 1100.0,
        "strains": {
            name: {"basis": "legendre", "order": 1} for name in ("elongation", "bending_x", "bending_y")
        },
        "material": {"youngs_modulus": 2e5, "shear_modulus": 7e4, "viscosity": viscosity},
        "chambers": [{"angle_rad": a, "area_m2": 3e-5, "offset_m": 0.004} for a in (0.0, 2.1, 4.2)],
        **keys,
    }
    return SoftArm(robot_from_dict({"links": [link], "base_quaternion": [1.0, 0.0, 0.0, 0.0]}))


def bent(arm: SoftArm, elongation: float = 0.0) -> np.ndarray:
    """Bent evenly, out of one plane: curvatures of 4 and 1.2 1/m."""
    return np.tile([elongation, 4.0, 1.2], arm.n_q // 3)


def energies(arm: SoftArm, result: Result, rows: int = 200) -> np.ndarray:
    """Total energy at about that many rows, the first included."""
    every = max(1, len(result.t) // rows)
    return np.array(
        [sum(arm.energy(q, qd)) for q, qd in zip(result.q[::every], result.qd[::every], strict=True)]
    )


def stored(arm: SoftArm, result: Result, pressure: Any) -> np.ndarray:
    """Energy of every row with that of creep, hysteresis, contact, held tip, and constant pressures' -p V."""
    stiffness = arm.tables.internal_stiffness
    return np.array(
        [
            sum(arm.energy(q, qd))
            + 0.5 * stiffness @ z**2
            + arm.external_forces(q).energy
            - np.dot(pressure, arm.displaced_volume(q))
            for q, qd, z in zip(result.q, result.qd, result.internal, strict=True)
        ]
    )


def growth(energies: np.ndarray) -> float:
    """Most that the energy grew from any row to any later one."""
    return float((energies - np.minimum.accumulate(energies)).max())


def scale(arm: SoftArm, result: Result) -> float:
    """Elastic energy and what gravity adds at the start: the energy that a run is about."""
    kinetic, gravity, elastic = arm.energy(result.q[0], result.qd[0])
    return kinetic + elastic + abs(gravity - arm.energy(0 * result.q[0], result.qd[0])[1])
