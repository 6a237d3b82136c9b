"""Pressures and set points that a motion needs, with the load that the law has learned."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from soro_core.arrays import Array
from soro_core.control.laws.protocol import Law
from soro_core.control.motions.motion_parts import MotionSegment
from soro_core.control.pressures.allocation import Allocation, balanced_weight
from soro_core.control.pressures.setpoints import SetpointMaker
from soro_core.model import SoftArm
from soro_core.planning.motion_error import MotionError
from soro_core.planning.steps import Planning
from soro_core.robot.coordinates import StrainFields

# A force counts as made if less is missing, each strain's force expressed as a pressure [Pa].
_MADE_PA = 200.0
# Samples of the pressures along a part.
_SAMPLE_S, _FEWEST, _MOST = 0.02, 40, 400
# Set points that are found in one step of a plan, and most of a part: more would not fit into the memory.
_TICKS_IN_A_STEP, _MOST_TICKS = 100, 10_000_000
# Steps of a search for the nearest point that is held, and of its arm to rest; part of the limits, and of the
# length, that ends them; part of the range that its pressures leave, as it is rounded; damping of a step.
_HELD_STEPS, _REST_STEPS, _AT_REST, _EDGE, _DAMPING = 20, 20, 1e-6, 0.015, 1e-3
# Increment of strain for the difference quotient of the stiffness.
_STEP = 1e-6


@dataclass(frozen=True)
class PressureSupply:
    """What the law asks of the chambers, and what they give.

    Attributes
    ----------
    arm : SoftArm
        Model.
    fields : StrainFields
        Strains of its robot.
    force : callable
        Force (n_q,) that the law applies at coordinates, rates and accelerations (n_q,) each, without
        feedback: the model's with the load that is learned, without creep.
    actuation : callable
        H (n_q, n_u) as the law believes it, at coordinates (n_q,).
    internal : ndarray
        Creep and hysteresis states now.
    setpoints : SetpointMaker
        Allocation, and range, rates and lag of the set points.
    """

    arm: SoftArm
    fields: StrainFields
    force: Callable[[Array, Array, Array], Array]
    actuation: Callable[[Array], Array]
    internal: Array
    setpoints: SetpointMaker


@dataclass(frozen=True)
class PressureDeficit:
    """Pressure deficit at a point of a motion.

    Attributes
    ----------
    chamber : int
        Chamber with the largest deficit; -1 if no pressures at all make the force.
    pressure_pa : float
        Pressure that it would need [Pa gauge].
    distance_m : float
        How far the best pressures leave the tip away [m], to first order.
    """

    chamber: int
    pressure_pa: float
    distance_m: float


@dataclass(frozen=True)
class Rates:
    """Set points along a part, as multiples of what is allowed.

    Attributes
    ----------
    rate : float
        Fastest change of a set point over the allowed one.
    chamber : int
        The chamber with this rate.
    t_s : float
        Its time after the begin of the part [s].
    beyond_pa : float
        How far a set point leaves its range [Pa].
    short : bool
        Whether there is a pressure deficit on the way.
    """

    rate: float
    chamber: int
    t_s: float
    beyond_pa: float
    short: bool

    @property
    def fits(self) -> bool:
        """Whether the part can be made as it is."""
        return self.rate <= 1.0 and self.beyond_pa <= 0.0 and not self.short


def pressure_supply(
    law: Law[Any], law_state: object, internal: Array, setpoints: SetpointMaker
) -> PressureSupply:
    """Return what a law asks for with its estimates of now, and what the chambers give.

    Parameters
    ----------
    law : Law
    law_state : object
        Its state, which holds the learned load.
    internal : ndarray
        Creep and hysteresis states now.
    setpoints : SetpointMaker
    """
    arm = law.setting.arm
    return PressureSupply(
        arm,
        law.setting.fields,
        partial(law.reference_force, law_state),
        lambda q: law.actuation(law_state, arm.actuation_matrix(q), q),
        internal,
        setpoints,
    )


def holding_pressure(supply: PressureSupply, q: Array) -> Array:
    """Return the pressures (n_u,) [Pa gauge] that hold the arm at rest in `q` (n_q,) best."""
    zero = np.zeros_like(q)
    return _made(supply, q, supply.force(q, zero, zero))[0].pressure_pa


def pressure_deficit(supply: PressureSupply, q: Array) -> PressureDeficit | None:
    """Return the pressure deficit of holding the arm at rest in `q` (n_q,); None if nothing."""
    zero = np.zeros_like(q)
    force = supply.force(q, zero, zero)
    found, missing = _made(supply, q, force)
    if missing <= _MADE_PA:
        return None
    wide, still_missing = _made(supply, q, force, wide=True)
    beyond = np.maximum(
        wide.pressure_pa - supply.setpoints.maximum_pa, supply.setpoints.minimum_pa - wide.pressure_pa
    )
    worst = int(np.argmax(beyond))
    at_bounds = missing > still_missing + _MADE_PA
    return PressureDeficit(
        worst if at_bounds else -1, float(wide.pressure_pa[worst]), _left_away(supply, q, force - found.force)
    )


def rates(supply: PressureSupply, part: MotionSegment, dt: float, share: float) -> Planning[Rates]:
    """Find the set points along a part, in steps of one sample each.

    Parameters
    ----------
    supply : Supply
        What the law asks for, and what the chambers give.
    part : MotionSegment
        The motion.
    dt : float
        Period of the set points [s].
    share : float
        Part of the allowed rates that the motion may take; the feedback has the rest.

    Returns
    -------
    Rates

    Raises
    ------
    MotionError
        If it lasts too long.
    """
    from scipy.interpolate import CubicSpline  # imported here: most references are no motions

    if not part.duration_s <= _MOST_TICKS * dt:
        got = f"{part.duration_s:.3g} s for the allowed rates of strain and of set points"
        raise MotionError("rate", "rate", got, f"at most {_MOST_TICKS * dt:g} s")
    n = min(max(round(part.duration_s / _SAMPLE_S), _FEWEST), _MOST)
    times, step = np.linspace(0.0, part.duration_s, n + 1, retstep=True)
    internal, rows, short = supply.internal, [], False
    for t in times:
        at = part.at(float(t))
        force = supply.force(at.q, at.qd, at.qdd) + supply.arm.internal_force(at.q, internal)
        found, missing = _made(supply, at.q, np.asarray(force))
        if missing > _MADE_PA and bool(found.saturated.any()):
            short = True
        rows.append(found.pressure_pa)
        internal = supply.arm.internal_midpoint(at.q, at.qd, internal, float(step))
        yield
    ticks = np.arange(0.0, part.duration_s + 0.5 * dt, dt)
    wish = CubicSpline(times, np.array(rows))(np.minimum(ticks, times[-1]))
    commands = yield from _commands(supply, wish, dt)
    change = np.diff(commands, axis=0, prepend=commands[:1]) / (share * dt)
    part_of = np.maximum(
        change / supply.setpoints.pressures.rise_pa_s, -change / supply.setpoints.pressures.fall_pa_s
    )
    k, chamber = np.unravel_index(int(np.argmax(part_of)), part_of.shape)
    beyond = supply.setpoints.beyond_pa(commands)
    return Rates(float(part_of[k, chamber]), int(chamber), float(ticks[k]), float(np.max(beyond)), short)


def _commands(supply: PressureSupply, wish_pa: Array, dt: float) -> Planning[Array]:
    """Find the set points (n, n_u) that make the pressures follow `wish_pa` through the lag."""
    pressures = supply.setpoints.pressures
    if pressures.lag_s <= 0.0:
        return wish_pa
    lead, kept = max(pressures.lag_s / pressures.lag_filter_s, 1.0), float(np.exp(-dt / pressures.lag_s))
    # The wanted pressures are assumed to change before the first sample as they do at it: the pressures lag
    # behind them by the time of the filter.
    model = wish_pa[0] - min(pressures.lag_s, pressures.lag_filter_s) / dt * (wish_pa[1] - wish_pa[0])
    commands = np.empty_like(wish_pa)
    for k, wish in enumerate(wish_pa):
        commands[k] = model + lead * (wish - model)
        model = commands[k] + kept * (model - commands[k])
        if k % _TICKS_IN_A_STEP == 0:
            yield
    return commands


def _made(supply: PressureSupply, q: Array, force: Array, wide: bool = False) -> tuple[Allocation, float]:
    """Return the pressures for a force, and how much of it is missing, as a pressure [Pa]."""
    actuation, setpoints = supply.actuation(q), supply.setpoints
    found = setpoints.allocate(actuation, force, setpoints.preferred_pa, wide)
    weight = balanced_weight(actuation, supply.fields)
    return found, float(np.max(np.abs(weight @ (force - found.force)), initial=0.0))


def _left_away(supply: PressureSupply, q: Array, residual: Array) -> float:
    """Return how far a missing force moves the tip [m], by the stiffness at `q`."""
    pressure = holding_pressure(supply, q)
    moved = np.linalg.lstsq(_stiffness(supply, q, pressure), residual, rcond=None)[0]
    _, jacobian = supply.arm.pose_and_jacobian(q, supply.arm.length)
    return float(np.linalg.norm(jacobian[3:] @ moved))


def _load(supply: PressureSupply, q: Array, pressure_pa: Array) -> Array:
    """Return the force (n_q,) that is missing at rest in `q` under pressures."""
    zero = np.zeros_like(q)
    acting = supply.arm.acting_pressure(pressure_pa)
    return np.asarray(supply.force(q, zero, zero) - supply.actuation(q) @ acting)


def _stiffness(supply: PressureSupply, q: Array, pressure_pa: Array) -> Array:
    """Return the slope (n_q, n_q) of that force by the coordinates."""
    scale = np.where(supply.fields.stretch, 1.0, 1.0 / supply.fields.length) * _STEP
    rows = [
        (_load(supply, q + e, pressure_pa) - _load(supply, q - e, pressure_pa)) / (2.0 * np.max(e))
        for e in np.diag(scale)
    ]
    return np.stack(rows, axis=1)


def nearest_held(supply: PressureSupply, limit: Array, q: Array, position: Array) -> Planning[Array | None]:
    """Find the coordinates that pressures hold at rest with the tip nearest to a position.

    Gauss-Newton on the pressures: at each step the arm rests under them.

    Parameters
    ----------
    supply : PressureSupply
    limit : ndarray (n_q,)
        Largest absolute coordinates.
    q : ndarray (n_q,)
        Start of the search.
    position : ndarray (3,)
        Of the tip in the world [m].

    Returns
    -------
    ndarray (n_q,) or None
        None where the search finds no rest.
    """
    from scipy.optimize import lsq_linear  # imported here: few motions are refused

    arm, setpoints = supply.arm, supply.setpoints
    edge = _EDGE * (setpoints.maximum_pa - setpoints.minimum_pa)
    low, high = setpoints.minimum_pa + edge, setpoints.maximum_pa - edge
    pressure = np.clip(holding_pressure(supply, q), low, high)
    best, best_q, best_pa, damping = np.inf, None, pressure, _DAMPING
    slope, away = np.zeros((3, pressure.size)), np.zeros(3)
    for _ in range(_HELD_STEPS):
        for _ in range(_REST_STEPS):
            step = -np.linalg.lstsq(_stiffness(supply, q, pressure), _load(supply, q, pressure), rcond=None)[
                0
            ]
            q = np.clip(q + step, -limit, limit)
            yield
            if np.all(np.abs(step) <= _AT_REST * limit):
                break
        pose, jacobian = arm.pose_and_jacobian(q, arm.length)
        missed = float(np.linalg.norm(position - pose[:3, 3]))
        if missed < best and pressure_deficit(supply, q) is None:
            best, best_q, best_pa, damping = missed, q, pressure, 0.3 * damping
            stiffness, away = _stiffness(supply, q, pressure), position - pose[:3, 3]
            by_pressure = np.linalg.lstsq(stiffness, supply.actuation(q), rcond=None)[0]
            slope = pose[:3, :3] @ jacobian[3:] @ by_pressure
        elif best_q is None:
            return None
        else:
            q, damping = best_q, 10.0 * damping
        stay = damping * float(np.linalg.norm(slope)) * np.eye(pressure.size)
        system = np.vstack((slope, stay)), np.append(away, np.zeros(pressure.size))
        change = lsq_linear(*system, bounds=(low - best_pa - 1.0, high - best_pa + 1.0)).x
        pressure = np.clip(best_pa + change, low, high)
        if np.all(np.abs(pressure - best_pa) <= _AT_REST * (high - low)):
            break
    return best_q
