"""One link without weight that one chamber bends until it collapses, and where it must do so."""

from typing import Any

from soro_core import SoftArm, robot_from_dict

LENGTH, K_E, K_B, ALPHA_KAPPA = 0.1, 400.0, 0.05, 1e-7
# docs/model.md (51): 0.325 L^2 sqrt(k_b k_e) / alpha_kappa.
LIMIT_PA = 27**0.5 / 16 * LENGTH**2 * (K_E * K_B) ** 0.5 / ALPHA_KAPPA


def bent_link(alpha_eps: float = 0.0, robot: dict[str, Any] | None = None, **keys: Any) -> dict[str, Any]:
    """Robot of one link; `keys` are its further ones."""
    chamber = {"angle_rad": 0.3, "alpha_eps": alpha_eps, "alpha_kappa": ALPHA_KAPPA}
    link = {"length": LENGTH, "radius": 0.02, "mass": 0.05, "k_e": [K_E, 0.0, 0.0], "k_b": [K_B, 0.0, 0.0]}
    link |= {"damping": [0.5, 5e-4, 5e-4], "chambers": [chamber], **keys}
    return {"links": [link], "gravity": [0.0, 0.0, 0.0], **(robot or {})}


def bent_arm(*args: Any, **keys: Any) -> SoftArm:
    """Arm of `bent_link`."""
    return SoftArm(robot_from_dict(bent_link(*args, **keys)))
