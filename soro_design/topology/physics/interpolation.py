"""How stiff and how solid an element of some density is, docs/design.md (T7)."""

from __future__ import annotations

from soro_core.arrays import Array
from soro_design.topology.physics.filter import projection

# Where an element begins to count as solid, and how suddenly.
SOLID_FROM, SOLID_SHARPNESS = 0.01, 500.0


def interpolation(density: Array, penalty: float, void_stiffness: float) -> tuple[Array, Array, Array, Array]:
    """Return kappa, gamma and their derivatives by density.

    Parameters
    ----------
    density : ndarray, (e,)
        Densities of the elements.
    penalty : float
        Exponent of the stiffness.
    void_stiffness : float
        Stiffness of void over that of solid.
    """
    power = density**penalty
    slope = penalty * density ** (penalty - 1.0)
    gamma, by_power = projection(power, SOLID_SHARPNESS, SOLID_FROM)
    rest = 1.0 - void_stiffness
    return void_stiffness + rest * power, gamma, rest * slope, by_power * slope
