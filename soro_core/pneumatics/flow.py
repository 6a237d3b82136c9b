"""Mass flow through an orifice, after ISO 6358-1:2013, in both directions; docs/model.md (29).

q = C rho_0 p_1 psi(p_2 / p_1) at the reference temperature, with the sonic conductance C [m^3/(s Pa)] and
the critical pressure ratio b: psi = 1 below b (choked), a quarter of an ellipse above. The ellipse has a
vertical tangent at equal pressures, where the flow of a real orifice is laminar: from the ratio 0.999 on, psi
is a straight line to 0, as is common [Sanville 1971; Beater, Pneumatic Drives, 2007], so that every
derivative is finite.
"""

from __future__ import annotations

import math

from soro_core._jit import inner

# Density of the standard reference atmosphere (100 kPa, 20 degrees C, 65 % humidity) [kg/m^3].
REFERENCE_DENSITY = 1.185
# The flow is laminar from this ratio of pressures on.
LAMINAR = 0.999


@inner
def flow_function(ratio: float, critical: float) -> tuple[float, float]:
    """psi and its derivative at a ratio of pressures from 0 to 1."""
    if ratio <= critical:
        return 1.0, 0.0
    width = 1.0 - critical
    if ratio < LAMINAR:
        x = (ratio - critical) / width
        psi = math.sqrt(1.0 - x * x)
        return psi, -x / (psi * width)
    x = (LAMINAR - critical) / width
    slope = math.sqrt(1.0 - x * x) / (1.0 - LAMINAR)
    return slope * (1.0 - ratio), -slope


@inner
def mass_flow(
    conductance: float, critical: float, from_pa: float, to_pa: float
) -> tuple[float, float, float]:
    """Mass flow [kg/s] between two absolute pressures, negative when it runs back; and its derivatives.

    Gives (flow, d flow / d from_pa, d flow / d to_pa).
    """
    high, low = max(from_pa, to_pa), min(from_pa, to_pa)
    scale = REFERENCE_DENSITY * conductance
    if not high > 0.0:
        return 0.0, 0.0, 0.0
    ratio = low / high
    psi, slope = flow_function(ratio, critical)
    flow = scale * high * psi
    by_high, by_low = scale * (psi - ratio * slope), scale * slope
    if from_pa >= to_pa:
        return flow, by_high, by_low
    return -flow, -by_low, -by_high
