"""How the probe presses each chamber: within the limits of motion, as long as the first mode needs."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from soro_core.arrays import Array
from soro_core.control.motion_config import EnableBounds
from soro_core.control.pressures.actuation import CompletePressures, pressure_bounds
from soro_core.errors import ConfigError, ModelError
from soro_core.model import SoftArm
from soro_core.model.equilibrium.statics import equilibrium, stable_equilibrium
from soro_core.robot.coordinates import StrainFields

# The ends of the links are to move by this part of the length.
MOVES_PART = 0.12
# Part of the limits of strain that the probe may take by the model under any load.
_STRAIN_PART = 0.8
# Loads, as parts of the heaviest, under which the model is asked.
_LOADS = (0.0, 0.1, 0.2, 0.4, 0.7, 1.0)
# Halvings of a pressure that bends the model too far; no chamber is probed with less than the last one [Pa].
_HALVINGS, _LEAST_PA = 6, 500.0
# A load makes the first mode slower than that of the empty arm; near buckling it never ends.
_SLOWEST, _SHORTEST_S, _LONGEST_S = 5.0, 0.2, 2.0
# Lags until a pressure counts as settled.
_LAGS = 3.0


class ProbedArm(NamedTuple):
    """What is known of the arm before the probe.

    Attributes
    ----------
    arm, fields : SoftArm, StrainFields
        Model and its strains.
    limit : ndarray (n_q,)
        Largest absolute strains: the limits of motion.
    pressures : CompletePressures
        Range, rates, lag and dead time.
    heaviest_kg : float
        Largest load that the arm may carry [kg].
    bounds : EnableBounds
        What counts as empty.
    """

    arm: SoftArm
    fields: StrainFields
    limit: Array
    pressures: CompletePressures
    heaviest_kg: float
    bounds: EnableBounds


@dataclass(frozen=True)
class ProbePlan:
    """What the probe does.

    Attributes
    ----------
    names : tuple of str
        Chambers, in the order in which they are pressed.
    ceiling_pa : ndarray (n_u,)
        Highest pressure of each chamber [Pa gauge].
    moves_m : float
        Displacement of the ends of the links that is aimed at [m].
    limit : ndarray (n_q,)
        Largest absolute strains.
    rise_s, settle_s, window_s : float
        Time of a rise, time to settle behind it, and time over which means are taken [s].
    rise_pa_s, fall_pa_s : float
        Fastest rates of set points [Pa/s].
    dead_time_s : float
        Declared time until a set point acts [s].
    play_pa : float
        Declared play between set point and pressure, its width [Pa].
    """

    names: tuple[str, ...]
    ceiling_pa: Array
    moves_m: float
    limit: Array
    rise_s: float
    settle_s: float
    window_s: float
    rise_pa_s: float
    fall_pa_s: float
    dead_time_s: float
    play_pa: float


def plan_probe(known: ProbedArm) -> ProbePlan:
    """Return the plan for an arm.

    Raises
    ------
    ConfigError
        If no pressure above 0 keeps the arm within the limits of motion under every load.
    """
    arm, pressures = known.arm, known.pressures
    loads = [part * known.heaviest_kg for part in _LOADS]
    rests = [(load, q) for load in loads if (q := _rest(known, load)) is not None]
    _, high = pressure_bounds(pressures, arm.robot)
    ceiling = np.array([_ceiling(known, k, high, rests) for k in range(arm.n_u)])
    mode_s = _first_mode_s(arm, rests)
    rise_s = 0.3 * mode_s + _LAGS * pressures.lag_s
    return ProbePlan(
        names=arm.robot.chamber_names,
        ceiling_pa=ceiling,
        moves_m=MOVES_PART * arm.length,
        limit=known.limit,
        rise_s=rise_s,
        settle_s=pressures.dead_time_s + _LAGS * pressures.lag_s + 0.4 * mode_s,
        window_s=0.5 * mode_s,
        rise_pa_s=pressures.rise_pa_s,
        fall_pa_s=pressures.fall_pa_s,
        dead_time_s=pressures.dead_time_s,
        play_pa=pressures.play_pa,
    )


def _rest(known: ProbedArm, load_kg: float) -> Array | None:
    """Return the rest under a load; None where there is none within the limits of motion."""
    with contextlib.suppress(ModelError):
        q = stable_equilibrium(known.arm, np.zeros(known.arm.n_u), None, load_kg)
        return q if _is_within(known, q) else None
    return None


def _is_within(known: ProbedArm, q: Array) -> bool:
    return bool((known.fields.peaks(q) <= _STRAIN_PART * known.limit).all())


def _ceiling(known: ProbedArm, chamber: int, high_pa: float, rests: list[tuple[float, Array]]) -> float:
    """Return the pressure that moves the straight arm by 1.5 `MOVES_PART`, and under no load too far."""
    arm = known.arm
    one = np.eye(arm.n_u)[chamber]
    pressure = high_pa
    for _ in range(3):  # towards the displacement that is wanted; the response is not quite linear
        with contextlib.suppress(ModelError):
            moved = end_displacement(arm, equilibrium(arm, pressure * one), np.zeros(arm.n_q))
            pressure = min(high_pa, pressure * min(1.5 * MOVES_PART * arm.length / max(moved, 1e-9), 1.0))
            continue
        pressure *= 0.5
    for _ in range(_HALVINGS):
        if rests and all(_stays(known, pressure * one, load, q) for load, q in rests):
            return pressure
        pressure *= 0.5
        if pressure < _LEAST_PA:
            break
    raise ConfigError(
        "controller",
        "probe_at_enable",
        f"{1e-3 * pressure:.1f} kPa in {arm.robot.chamber_names[chamber]} bends the arm beyond the limits",
        "off, or a wider reference.bend_limit_rad, or a smaller bound of the learned mass",
    )


def _stays(known: ProbedArm, pressure: Array, load_kg: float, rest: Array) -> bool:
    """Whether the model stays within the limits; where it has no balance, a smaller pressure has."""
    try:
        return _is_within(known, stable_equilibrium(known.arm, pressure, rest, load_kg))
    except ModelError:
        return False


def end_displacement(arm: SoftArm, q: Array, rest: Array) -> float:
    """Return the displacement [m] of the end of a link, of the one that has moved most.

    Parameters
    ----------
    arm : SoftArm
    q, rest : ndarray (n_q,)
        Coordinates now, and at rest.
    """
    ends = np.cumsum([link.length for link in arm.robot.links])
    return float(max(np.linalg.norm(arm.pose(q, s)[:3, 3] - arm.pose(rest, s)[:3, 3]) for s in ends))


def _first_mode_s(arm: SoftArm, rests: list[tuple[float, Array]]) -> float:
    """Return the longest period of the first mode under these loads [s]."""
    periods = [_period_s(arm, load, q) for load, q in rests]
    found = [one for one in periods if np.isfinite(one)]
    if not found:
        return _LONGEST_S
    return float(np.clip(min(max(found), _SLOWEST * found[0]), _SHORTEST_S, _LONGEST_S))


def _period_s(arm: SoftArm, load_kg: float, q: Array) -> float:
    """Return the period of the slowest mode about a rest [s]."""
    none, step = np.zeros(arm.n_q), 1e-6

    def force(at: Array) -> Array:
        return arm.elastic_force(at) + arm.gravity_force(at) + load_kg * arm.tip_mass_force(at, none, none)

    slope = np.column_stack(
        [(force(q + step * e) - force(q - step * e)) / (2 * step) for e in np.eye(arm.n_q)]
    )
    mass = arm.inertia_matrix(q) + load_kg * np.column_stack(
        [arm.tip_mass_force(q, none, e) - arm.tip_mass_force(q, none, none) for e in np.eye(arm.n_q)]
    )
    square = float(np.min(np.linalg.eigvals(np.linalg.solve(mass, slope)).real))
    return 2.0 * np.pi / np.sqrt(square) if square > 0.0 else np.inf
