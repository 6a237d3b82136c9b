"""Links as a robot file has them, small enough for a test."""

from typing import Any

ROD: dict[str, Any] = {
    "length": 0.2,
    "radius": 0.015,
    "density": 1100.0,
    "material": {"youngs_modulus": 5e5, "shear_modulus": 5e5 / 3, "viscosity": 300.0},
}
"""Of silicone."""
PLAIN: dict[str, Any] = {"length": 0.1, "radius": 0.02, "mass": 0.05, "k_e": [300, 0, 0], "k_b": [0.02, 0, 0]}
"""Of constant stiffness."""
LAW: dict[str, Any] = {**PLAIN, "k_e": [300, 100, 20], "k_b": [0.02, 0.01, 0.5]}
"""Of a stiffness that rises."""
