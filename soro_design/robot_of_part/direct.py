"""First numbers of a link, one load at a time; docs/parts.md (5) to (8).

Pressures alone give only the ratio of stiffness to area. Forces are known, so they come first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_design.parts.sweeps import Backbone
from soro_design.robot_of_part.snapshots import Snapshots


@dataclass(frozen=True)
class Direct:
    """What single loads say of a link.

    Attributes
    ----------
    k_e_n_per_m : float
        Axial stiffness at rest, per change of length.
    k_b_nm : float
        Bending stiffness at rest, per angle: EI over the length, by the deflection that curvature makes.
    k_b_whole_nm : float
        The same by the whole deflection, in which shear has a part; it is no number of the link.
    area_m2, area_slope, offset_m : float
        Of a chamber, see `soro_core.robot.chamber.Chamber`.
    """

    k_e_n_per_m: float
    k_b_nm: float
    k_b_whole_nm: float
    area_m2: float
    area_slope: float
    offset_m: float


def direct(data: Snapshots, area_m2: float | None = None) -> Direct:
    """Return the numbers that the states of single loads give one after the other.

    Parameters
    ----------
    data : Snapshots
        The states.
    area_m2 : float, optional
        Of a single chamber, which gives the product of area and offset alone.
    """
    L = data.length
    ends = [_smallest(data.axial, sign) for sign in (1.0, -1.0)]
    k_e = float(np.mean([s.force_n[2] / (L * data.mean(s)[0]) for s in ends if s is not None]))

    side = min(data.lateral, key=lambda s: s.load)
    size = float(np.linalg.norm(side.force_n))
    towards = side.force_n[:2] / size
    curvature = data.strains(side)[:, 1:] @ towards
    arm = L - 0.5 * (data.z[1:] + data.z[:-1]) + data.z[0]
    by_curvature = float(np.diff(data.z) @ (arm * curvature))
    whole = float(side.poses[-1][:2, 3] @ towards)
    k_b, k_b_whole = (size * L**2 / (3.0 * w) for w in (by_curvature, whole))

    area, slope = _areas(data) if area_m2 is None else (area_m2, 0.0)
    first = min(data.uneven, key=lambda s: s.load)
    moment = _moment(first)
    kappa = float(np.linalg.norm(data.mean(first)[1:]))
    return Direct(k_e, k_b, k_b_whole, area, slope, k_b * kappa * L / (area * moment))


def _smallest(states: tuple[Backbone, ...], sign: float) -> Backbone | None:
    """State of the least force of a sign."""
    own = [s for s in states if sign * s.force_n[2] > 0.0]
    return min(own, key=lambda s: abs(s.force_n[2])) if own else None


def _areas(data: Snapshots) -> tuple[float, float]:
    """Area of a chamber [m2] and its slope, by equal pressures."""
    # n A exp(a eps) p = k_e x with the secant stiffness that an axial force has at the same length.
    x = np.array([data.length * data.mean(s)[0] for s in data.even])
    force = _axial_force(data, x)
    pressure = np.array([s.pressures_pa.sum() for s in data.even])
    growth = np.polyfit(x / data.length, np.log(force / pressure), min(1, len(x) - 1))
    return float(np.exp(growth[-1])), float(growth[0]) if len(growth) > 1 else 0.0


def _axial_force(data: Snapshots, x: Array) -> Array:
    """Force at changes of length, by the secant stiffness of the axial sweeps, straight lines between."""
    own = sorted((L_x, s.force_n[2] / L_x) for s in data.axial for L_x in [data.length * data.mean(s)[0]])
    at, secant = np.array(own).T
    return np.asarray(np.interp(x, at, secant) * x)


def _moment(state: Backbone) -> float:
    """Length of the sum of pressures as vectors towards their chambers [Pa]."""
    angle = 2.0 * np.pi * np.arange(len(state.pressures_pa)) / len(state.pressures_pa)
    return float(np.hypot(state.pressures_pa @ np.cos(angle), state.pressures_pa @ np.sin(angle)))
