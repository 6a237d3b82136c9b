"""Air behind valves as internal states of a run: mass and volume of each chamber, last among them.

With `Gas` the pressures of a stage follow from its volumes at the end, docs/model.md (30), and their slope
stiffens the arm, (31). With `NoAir` the pressures are given, and no code for air is compiled.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np

from soro_core._by_type import select_by_type
from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.integrate.step_work import Stepping
from soro_core.model import SoftArm
from soro_core.model.checks import listed
from soro_core.model.forces.chambers import add_gradient, volumes
from soro_core.model.links.linear import assign, clear
from soro_core.model.tables import AIR, Tables
from soro_core.model.work import Work
from soro_core.pneumatics.chamber import Gas, chamber_pressures, make_gas, masses_at
from soro_core.pneumatics.valve_model import ValveModel


class NoAir(NamedTuple):
    """Pressures are given."""

    nothing: float = 0.0


NO_AIR = NoAir()
Air: TypeAlias = Gas | NoAir


@inner
def _follow_command(air: NoAir, run: Stepping, q: Array, z0: Array, span: float, z: Array) -> bool:
    assign(run.work.command, run.work.stage_pressure)
    return True


@inner
def _follow_volumes(air: Gas, run: Stepping, q: Array, z0: Array, span: float, z: Array) -> bool:
    command, pressure, slope = run.work.command, run.work.stage_pressure, run.work.pressure_slope
    n_u, n_z = command.shape[0], z.shape[0]
    mass, volume = n_z - 2 * n_u, n_z - n_u
    end = z[volume:]
    volumes(run.tables, q, end)
    for u in range(n_u):
        end[u] += air.volume[u]
    return chamber_pressures(
        air, z0[mass:volume], z0[volume:], end, command, span, z[mass:volume], pressure, slope
    )


@inner
def _no_stiffness(air: NoAir, t: Tables, w: Work, q: Array, slope: Array, factor: float) -> None:
    return


@inner
def _add_stiffness(air: Gas, t: Tables, w: Work, q: Array, slope: Array, factor: float) -> None:
    gradient, K = w.gradient, w.block
    for u in range(slope.shape[0]):
        clear(gradient)
        along = 0.0
        for i in range(t.length.shape[0]):
            along += 1.0 if t.chamber_samples[i, u] > 0 else 0.0
        for i in range(t.length.shape[0]):
            if t.chamber_samples[i, u] == 0:
                continue
            # The air couples all links of its chamber; kept to their blocks, the sum over the links is
            # bounded by their number times the blocks, so that Newton's iteration still converges.
            add_gradient(t, i, u, q, 1.0, gradient)
            scaled = -factor * along * slope[u]
            for c in range(t.offset[i], t.offset[i + 1]):
                for d in range(t.offset[i], t.offset[i + 1]):
                    K[c, d - t.offset[i]] += scaled * gradient[c] * gradient[d]


breathe = select_by_type(Gas, _follow_volumes, _follow_command)
"""breathe(air, run, q, z0, span, z): work.stage_pressure and .pressure_slope <- pressures at the end of the
span, commanded by work.command, and their derivatives by the volumes, z <- masses and volumes at the end of
the span; False if a volume or a mass is not positive."""
add_air_stiffness = select_by_type(Gas, _add_stiffness, _no_stiffness)
"""add_air_stiffness(air, t, w, q, slope, factor): w.block += factor * H (-dp/dV) H', the block of each link;
w.gradient is scratch."""


def with_air(t: Tables, n_u: int) -> Tables:
    """Return tables with two more internal states for each chamber, without force on the arm."""
    n = 2 * n_u
    return t._replace(
        internal_kind=np.concatenate((t.internal_kind, np.full(n, AIR))),
        internal_coordinate=np.concatenate((t.internal_coordinate, np.zeros(n, dtype=np.int64))),
        internal_stiffness=np.concatenate((t.internal_stiffness, np.zeros(n))),
        internal_scale=np.concatenate((t.internal_scale, np.ones(n))),
    )


def air_behind(arm: SoftArm, valves: ValveModel | None) -> Air:
    """Return the air behind the valves of an arm; `NO_AIR` without valves.

    Raises
    ------
    ModelError
        If a chamber has no volume, a dead band, or an area that swells.
    """
    if valves is None:
        return NO_AIR
    if arm.robot.tendons:
        raise ModelError(f"{arm.robot.name}: valves with tendons: allowed is an arm without", "valves")
    laws = {"dead_band_pa": arm.tables.dead_band, "swell_per_pa": arm.tables.swell}
    for key, values in laws.items():
        for name, value in zip(arm.robot.chamber_names, values, strict=True):
            if value > 0.0:
                raise ModelError(
                    f"{arm.robot.name}: {key} = {value:g} of {name}: allowed with valves is 0", name
                )
    return make_gas(valves, chamber_volumes(arm))


def chamber_volumes(arm: SoftArm) -> Array:
    """Return the volumes (n_u,) of the chambers at q = 0 [m^3]: volume_m3, or else area times length.

    Of a muscle the area is that of its section.

    Raises
    ------
    ModelError
        If a volume is not positive.
    """
    chambers = [chamber for link in arm.robot.links for chamber in link.chambers]
    given = [chamber.volume_m3 for chamber in chambers]
    derived = arm.tables.axial_gain.sum(axis=0)
    derived *= [1.0 if one.muscle is None else one.muscle.section_m2 / one.muscle.area_m2 for one in chambers]
    volume = np.array([one if one is not None else own for one, own in zip(given, derived, strict=True)])
    for name, one in zip(arm.robot.chamber_names, volume, strict=True):
        if not one > 0.0:
            raise ModelError(
                f"{arm.robot.name}: {name} has no volume: allowed with valves is a volume_m3 above 0", name
            )
    return volume


def initial_air(air: Air, arm: SoftArm, q: Array, pressure: Array | None) -> Array:
    """Return masses [kg] and volumes [m^3] of the chambers at the start, (2 n_u,); (0,) without air.

    Parameters
    ----------
    air : Gas or NoAir
        Valves and chambers, or given pressures.
    arm : SoftArm
        Model.
    q : (n_q,)
        Coordinates at the start.
    pressure : (n_u,) or None
        Gauge pressures at the start [Pa]; None: 0.

    Raises
    ------
    ModelError
        If a pressure is not above vacuum, a volume is not positive, or there is a pressure without air.
    """
    if not isinstance(air, Gas):
        if pressure is not None:
            text = "pressure0 without valves: allowed is none, the pressures are given"
            raise ModelError(text, "pressure0")
        return np.empty(0)
    pressure = np.zeros(arm.n_u) if pressure is None else pressure
    volume = air.volume + arm.displaced_volume(q)
    if not (volume > 0.0).all():
        raise ModelError(
            f"a chamber is closed to nothing at q0: volumes {listed(volume)} m^3, allowed are more than 0",
            "q0",
        )
    if not (pressure > -air.ambient).all():
        text = f"pressure0 = {listed(pressure)} Pa: allowed is above {-air.ambient:g} Pa, a vacuum"
        raise ModelError(text, "pressure0")
    mass = np.empty_like(volume)
    masses_at(air, pressure, volume, mass)
    return np.concatenate((mass, volume))


def air_pressures(air: Gas, states: Array) -> Array:
    """Return gauge pressures (n_t, n_u) [Pa] of rows of masses and volumes (n_t, 2 n_u)."""
    n_u = states.shape[1] // 2
    density = states[:, :n_u] / states[:, n_u:]
    pressures: Array = air.ambient * ((density / air.density) ** air.exponent - 1.0)
    return pressures
