"""Air in chambers whose volume moves with the arm: mass as the state, a proportional valve on each.

The pressure follows from mass and volume, p = p_0 (m / (rho_0 V))^n, isothermal for n = 1 (p V = m R T).
V = V_0 + the volume that the arm displaces, whose gradient is the actuation matrix, so that the work of the
gas is the work on the arm. Each valve opens in proportion to what its chamber lacks of the set point, to the
supply or to the exhaust, fully beyond its band; the flow falls as the pressure rises, whatever the command.

One step takes a weighted mean of the flows at its start and end, theta at the end. With theta = 1/2 it is of
second order; where the flow is fast against the step, theta is raised so that the rate found at the start
decays as an exponential would [Liniger and Willoughby 1970]: the pressure then meets its goal, and never
passes it, for any step and volume.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core._jit import inner, kernel
from soro_core.pneumatics.flow import mass_flow
from soro_core.pneumatics.valve_condition import ValveCondition, healthy
from soro_core.pneumatics.valve_model import ValveModel

Array: TypeAlias = NDArray[np.float64]

AMBIENT_PA = 101325.0
GAS_CONSTANT = 287.05
"""Of dry air [J/(kg K)]."""
REFERENCE_TEMPERATURE = 293.15
"""At which sonic conductances hold [K]."""
OPEN_BAND_PA = 1.0
"""Band of a valve that has let go: it does not close as the pressure falls."""
MAX_ITERATIONS = 60
# Error left in the pressure, of the pressure.
TOLERANCE = 1e-14


class Gas(NamedTuple):
    """Valves and chambers as the kernels see them; pressures absolute [Pa], arrays (n_u,)."""

    volume: Array
    """Of each chamber at q = 0 [m^3]."""
    fill: Array
    vent: Array
    leak: Array
    loss: Array
    """Part of its gauge pressure that a chamber loses a second [1/s]."""
    supply: Array
    exhaust: Array
    band: Array
    critical: float
    exponent: float
    ambient: float
    density: float
    """Of the air outside [kg/m^3]."""


class Port(NamedTuple):
    """One valve and its chamber, as `Gas` has them."""

    fill: float
    vent: float
    leak: float
    loss: float
    supply: float
    exhaust: float
    band: float
    critical: float
    exponent: float
    ambient: float
    density: float


def make_gas(model: ValveModel, volume_m3: Array, condition: ValveCondition | None = None) -> Gas:
    """Return the numbers of valves on chambers of these volumes at q = 0, (n_u,); healthy by default."""
    volume = np.array(volume_m3, dtype=np.float64)
    now = healthy(volume.size) if condition is None else condition
    is_open = now.is_open != 0.0
    # Warmer air is thinner, but faster [ISO 6358].
    warm = math.sqrt(REFERENCE_TEMPERATURE / model.temperature_k)
    vent = warm * model.vent_m3_s_pa * now.vent
    supply = AMBIENT_PA + np.minimum(model.supply_pa, now.supply_pa)
    return Gas(
        volume=volume,
        # A valve that has let go connects its chamber with the air outside, by one way for in and out.
        fill=np.where(is_open, vent, warm * model.fill_m3_s_pa * now.fill),
        vent=vent,
        leak=np.full_like(volume, warm * model.leak_m3_s_pa),
        loss=np.array(now.loss_1_s, dtype=np.float64),
        supply=np.where(is_open, AMBIENT_PA, supply),
        exhaust=np.where(is_open, AMBIENT_PA, AMBIENT_PA + model.exhaust_pa),
        band=np.where(is_open, OPEN_BAND_PA, model.band_pa),
        critical=model.critical_ratio,
        exponent=model.polytropic,
        ambient=AMBIENT_PA,
        density=AMBIENT_PA / (GAS_CONSTANT * model.temperature_k),
    )


@inner
def port_of(g: Gas, u: int) -> Port:
    """Valve and chamber number u."""
    return Port(
        g.fill[u],
        g.vent[u],
        g.leak[u],
        g.loss[u],
        g.supply[u],
        g.exhaust[u],
        g.band[u],
        g.critical,
        g.exponent,
        g.ambient,
        g.density,
    )


@inner
def mass_of(g: Port, pressure: float, volume: float) -> float:
    """Mass [kg] of the air at an absolute pressure in a volume."""
    if g.exponent == 1.0:
        return g.density * volume * pressure / g.ambient
    mass: float = g.density * volume * (pressure / g.ambient) ** (1.0 / g.exponent)
    return mass


@inner
def pressure_of(g: Port, mass: float, volume: float) -> float:
    """Absolute pressure [Pa] of a mass in a volume."""
    ratio = mass / (g.density * volume)
    return g.ambient * (ratio if g.exponent == 1.0 else ratio**g.exponent)


@inner
def inflow(g: Port, pressure: float, volume: float, setpoint: float) -> tuple[float, float]:
    """Mass flow [kg/s] into a chamber at an absolute pressure, and its derivative, which is 0 or less."""
    opening = (min(max(setpoint, g.exhaust), g.supply) - pressure) / g.band
    by_p = -1.0 / g.band if abs(opening) < 1.0 else 0.0
    opening = min(max(opening, -1.0), 1.0)
    if opening >= 0.0:
        flow, _, slope = mass_flow(g.fill, g.critical, g.supply, pressure)
        total, rate = opening * flow, opening * slope + by_p * flow
    else:
        flow, slope, _ = mass_flow(g.vent, g.critical, pressure, g.exhaust)
        total, rate = opening * flow, opening * slope + by_p * flow
    if g.leak > 0.0:
        flow, slope, _ = mass_flow(g.leak, g.critical, pressure, g.ambient)
        total -= flow
        rate -= slope
    if g.loss > 0.0:
        held = mass_of(g, pressure, volume)
        total -= g.loss * (held - mass_of(g, g.ambient, volume))
        rate -= g.loss * held / (g.exponent * pressure)
    return total, rate


@inner
def implicitness(g: Port, mass: float, volume: float, flow: float, setpoint: float, dt: float) -> float:
    """Weight theta of the flow at the end: 1/2 for a slow one, near 1 where the step would pass the goal."""
    goal = mass_of(g, min(max(setpoint, g.exhaust), g.supply), volume)
    gap = goal - mass
    if not flow * gap > 0.0:
        return 1.0
    z = dt * flow / gap
    if z < 1e-3:
        return 0.5 + z / 12.0
    theta: float = 1.0 / -math.expm1(-z) - 1.0 / z
    return theta


@inner
def advance_chamber(
    g: Port, mass: float, volume: float, volume_end: float, setpoint: float, dt: float
) -> tuple[float, float, float]:
    """One chamber over `dt`: (mass, absolute pressure, d pressure / d volume) at the end.

    Solves m(p, V) = m_0 + dt ((1 - theta) f_0 + theta f(p)) for p: both sides are monotone, so that Newton's
    iteration within a bracket finds the one solution.
    """
    flow, _ = inflow(g, pressure_of(g, mass, volume), volume, setpoint)
    theta = implicitness(g, mass, volume, flow, setpoint, dt)
    known = mass + dt * (1.0 - theta) * flow
    closed = pressure_of(g, known, volume_end)
    low = min(closed, g.exhaust, g.ambient)
    high = max(closed, g.supply, g.ambient)
    p, weight, before = closed, dt * theta, math.inf
    for _ in range(MAX_ITERATIONS):
        flow, rate = inflow(g, p, volume_end, setpoint)
        held = mass_of(g, p, volume_end)
        excess = held - known - weight * flow
        if excess > 0.0:
            high = p
        else:
            low = p
        step = -excess / (held / (g.exponent * p) - weight * rate)
        if abs(step) <= TOLERANCE * p or high - low <= TOLERANCE * p:
            break
        # Between a choked and an open valve Newton's iteration alone can go to and fro for ever.
        good = low < p + step < high and abs(step) < 0.5 * before
        step = step if good else 0.5 * (low + high) - p
        before = abs(step)
        p += step
    flow, rate = inflow(g, p, volume_end, setpoint)
    held = mass_of(g, p, volume_end) if weight * flow != 0.0 else known
    # d m = weight f' dp and dp / p = n (dm / m - dV / V).
    by_volume = -g.exponent * p / volume_end / (1.0 - weight * rate * g.exponent * p / held)
    return held, p, by_volume


@kernel
def chamber_pressures(
    g: Gas,
    mass: Array,
    volume: Array,
    volume_end: Array,
    setpoint: Array,
    dt: float,
    mass_end: Array,
    pressure_end: Array,
    by_volume: Array,
) -> bool:
    """Advance all chambers over `dt`, given how their volumes end; False where one is closed to nothing.

    Parameters
    ----------
    g : Gas
    mass, volume, volume_end : (n_u,)
        Masses [kg] and volumes [m^3] at the start, volumes at the end.
    setpoint : (n_u,)
        Gauge pressures that the valves are set to, held over the step [Pa].
    dt : float
        [s], 0 or more.
    mass_end, pressure_end, by_volume : (n_u,)
        Written: masses [kg], gauge pressures [Pa], and their derivatives by the volume at the end [Pa/m^3].
    """
    for u in range(mass.shape[0]):
        if not (volume[u] > 0.0 and volume_end[u] > 0.0 and mass[u] > 0.0):
            return False
        port = port_of(g, u)
        held, p, slope = advance_chamber(port, mass[u], volume[u], volume_end[u], g.ambient + setpoint[u], dt)
        mass_end[u] = held
        pressure_end[u] = p - g.ambient
        by_volume[u] = slope
    return True


@kernel
def masses_at(g: Gas, pressure: Array, volume: Array, mass: Array) -> None:
    """mass <- air [kg] in chambers at gauge pressures [Pa], (n_u,)."""
    for u in range(mass.shape[0]):
        mass[u] = mass_of(port_of(g, u), g.ambient + pressure[u], volume[u])


@kernel
def inflows(g: Gas, pressure: Array, setpoint: Array, flow: Array) -> None:
    """flow <- mass flow into chambers [kg/s] at gauge pressures and set points [Pa], (n_u,)."""
    for u in range(flow.shape[0]):
        flow[u], _ = inflow(port_of(g, u), g.ambient + pressure[u], g.volume[u], g.ambient + setpoint[u])
