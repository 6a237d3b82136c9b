"""Air in chambers whose volume changes with the arm, each behind a proportional valve; the state is its mass.

docs/model.md (27) to (31). The pressure follows from mass and volume, p = p_0 (m / (rho_0 V))^n, isothermal
for n = 1 (p V = m R T). V is V_0 plus the volume that the arm displaces, whose gradient is the actuation
matrix, so that the work of the gas is the work on the arm. Each valve opens in proportion to the difference
of set point and pressure, to the supply or to the exhaust, and fully beyond its band; the flow decreases with
rising pressure for every command.

One step uses a weighted mean of the flows at its start and end, with the weight theta at the end. With
theta = 1/2 it is of second order; if the flow is fast for the step, theta is larger, so that the rate at the
start decays as an exponential would [LW70]: the pressure then meets its target and never overshoots, for any
step and volume.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from soro_core._jit import inner, kernel
from soro_core.arrays import Array
from soro_core.pneumatics.flow import mass_flow
from soro_core.pneumatics.valve_condition import ValveCondition, healthy
from soro_core.pneumatics.valve_model import ValveModel

AMBIENT_PA = 101325.0
GAS_CONSTANT = 287.05
"""Gas constant of dry air [J/(kg K)]."""
REFERENCE_TEMPERATURE = 293.15
"""Temperature of the reference atmosphere of sonic conductances [K]."""
OPEN_BAND_PA = 1.0
"""Band of a valve that has failed open [Pa]: it does not close as the pressure decreases."""
MAX_ITERATIONS = 60
# Relative error of the pressure.
TOLERANCE = 1e-14


class Gas(NamedTuple):
    """Valves and chambers in the form of the kernels.

    Attributes
    ----------
    volume : ndarray (n_u,)
        Volume of each chamber at q = 0 [m^3].
    fill, vent, leak : ndarray (n_u,)
        Sonic conductances from the supply, to the exhaust, and of a leak to the outside [m^3/(s Pa)].
    loss : ndarray (n_u,)
        Rate at which a chamber loses its gauge pressure [1/s].
    supply, exhaust : ndarray (n_u,)
        Pressures of supply and exhaust [Pa absolute].
    band, vent_band : ndarray (n_u,)
        Deviation below and above the set point that opens a valve fully [Pa].
    critical : float
        Critical pressure ratio b.
    exponent : float
        Exponent n of the gas; 1 isothermal.
    ambient : float
        Pressure of the air outside [Pa absolute].
    density : float
        Density of the air outside [kg/m^3].
    """

    volume: Array
    fill: Array
    vent: Array
    leak: Array
    loss: Array
    supply: Array
    exhaust: Array
    band: Array
    vent_band: Array
    critical: float
    exponent: float
    ambient: float
    density: float


class ValveChamber(NamedTuple):
    """One valve and its chamber: the fields of `Gas` for one index."""

    fill: float
    vent: float
    leak: float
    loss: float
    supply: float
    exhaust: float
    band: float
    vent_band: float
    critical: float
    exponent: float
    ambient: float
    density: float


def make_gas(model: ValveModel, volume_m3: Array, condition: ValveCondition | None = None) -> Gas:
    """Return valves and chambers in the form of the kernels.

    Parameters
    ----------
    model : ValveModel
        Model of every valve.
    volume_m3 : ndarray (n_u,)
        Volume of each chamber at q = 0 [m^3].
    condition : ValveCondition, optional
        Faults of the valves; healthy by default.

    Returns
    -------
    Gas
    """
    volume = np.array(volume_m3, dtype=np.float64)
    now = healthy(volume.size) if condition is None else condition
    is_open = now.is_open != 0.0
    # Warmer air is thinner, but faster [ISO 6358-1].
    warm = math.sqrt(REFERENCE_TEMPERATURE / model.temperature_k)
    vent = warm * model.vent_m3_s_pa * now.vent
    supply = AMBIENT_PA + np.minimum(model.supply_pa, now.supply_pa)
    return Gas(
        volume=volume,
        # A valve that has failed open connects its chamber with the air outside, with one conductance both
        # ways.
        fill=np.where(is_open, vent, warm * model.fill_m3_s_pa * now.fill),
        vent=vent,
        leak=np.full_like(volume, warm * model.leak_m3_s_pa),
        loss=np.array(now.loss_1_s, dtype=np.float64),
        supply=np.where(is_open, AMBIENT_PA, supply),
        exhaust=np.where(is_open, AMBIENT_PA, AMBIENT_PA + model.exhaust_pa),
        band=np.where(is_open, OPEN_BAND_PA, model.band_pa),
        vent_band=np.where(is_open, OPEN_BAND_PA, model.vent_band_pa or model.band_pa),
        critical=model.critical_ratio,
        exponent=model.polytropic,
        ambient=AMBIENT_PA,
        density=AMBIENT_PA / (GAS_CONSTANT * model.temperature_k),
    )


@inner
def valve_chamber(g: Gas, u: int) -> ValveChamber:
    """Valve and chamber number u."""
    return ValveChamber(
        g.fill[u],
        g.vent[u],
        g.leak[u],
        g.loss[u],
        g.supply[u],
        g.exhaust[u],
        g.band[u],
        g.vent_band[u],
        g.critical,
        g.exponent,
        g.ambient,
        g.density,
    )


@inner
def mass_of(g: ValveChamber, pressure: float, volume: float) -> float:
    """Mass [kg] of the air at an absolute pressure in a volume."""
    if g.exponent == 1.0:
        return g.density * volume * pressure / g.ambient
    mass: float = g.density * volume * (pressure / g.ambient) ** (1.0 / g.exponent)
    return mass


@inner
def pressure_of(g: ValveChamber, mass: float, volume: float) -> float:
    """Absolute pressure [Pa] of a mass in a volume."""
    ratio = mass / (g.density * volume)
    return g.ambient * (ratio if g.exponent == 1.0 else ratio**g.exponent)


@inner
def inflow(g: ValveChamber, pressure: float, volume: float, setpoint: float) -> tuple[float, float]:
    """Mass flow [kg/s] into a chamber at an absolute pressure, and its derivative, which is 0 or less."""
    gap = min(max(setpoint, g.exhaust), g.supply) - pressure
    band = g.band if gap >= 0.0 else g.vent_band
    opening = gap / band
    by_p = -1.0 / band if abs(opening) < 1.0 else 0.0
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
def implicitness(
    g: ValveChamber, mass: float, volume: float, flow: float, setpoint: float, dt: float
) -> float:
    """Weight theta of the flow at the end: 1/2 for slow flow, near 1 if the step would overshoot."""
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
    g: ValveChamber, mass: float, volume: float, volume_end: float, setpoint: float, dt: float
) -> tuple[float, float, float]:
    """Return mass, absolute pressure and d pressure / d volume of a chamber after `dt`, docs/model.md (30).

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
    """Advance all chambers over `dt` to given volumes; False if a volume or a mass is not positive.

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
        one = valve_chamber(g, u)
        held, p, slope = advance_chamber(one, mass[u], volume[u], volume_end[u], g.ambient + setpoint[u], dt)
        mass_end[u] = held
        pressure_end[u] = p - g.ambient
        by_volume[u] = slope
    return True


@kernel
def masses_at(g: Gas, pressure: Array, volume: Array, mass: Array) -> None:
    """mass <- air [kg] in chambers at gauge pressures [Pa], (n_u,)."""
    for u in range(mass.shape[0]):
        mass[u] = mass_of(valve_chamber(g, u), g.ambient + pressure[u], volume[u])


@kernel
def inflows(g: Gas, pressure: Array, setpoint: Array, flow: Array) -> None:
    """flow <- mass flow into chambers [kg/s] at gauge pressures and set points [Pa], (n_u,)."""
    for u in range(flow.shape[0]):
        flow[u], _ = inflow(
            valve_chamber(g, u), g.ambient + pressure[u], g.volume[u], g.ambient + setpoint[u]
        )
