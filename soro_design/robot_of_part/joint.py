"""All states at once: the bounded refinement of a link, and how far its tip is from that of the part."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.model import SoftArm
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.robot import Robot
from soro_design.parts.sweeps import Backbone
from soro_design.robot_of_part.direct import Direct
from soro_design.robot_of_part.link import Template, completed, parameters, robot_of
from soro_design.robot_of_part.snapshots import Snapshots
from soro_lab.identification.fit import Fit, fit

# Error that a state may be expected to have, as a part of the length.
UNIT = 0.01


@dataclass(frozen=True, eq=False)
class TipError:
    """The tip of the link and that of the part in a state.

    Attributes
    ----------
    state : Backbone
        The state.
    q : ndarray, (n_q,)
        Coordinates of the link.
    places : ndarray, (s, 3)
        Backbone of the link, at the sections of the part [m].
    share : float
        Distance of the tips over the length.
    motion : float
        How far the load has moved the tip of the part, over the length.
    """

    state: Backbone
    q: Array
    places: Array
    share: float
    motion: float

    @property
    def of_motion(self) -> float:
        """Distance of the tips over how far the tip has moved."""
        return self.share / self.motion


def weightless(known: Template) -> Template:
    """Return the link in the frame of the part and without weight, as it is computed."""
    return replace(known, gravity=(0.0, 0.0, 0.0), base_quaternion=(0.0, 0.0, 0.0, 1.0))


def refine(data: Snapshots, known: Template, start: Direct, strains: Mapping[str, Any] | None = None) -> Fit:
    """Fit all numbers of a link to the tips under pressures and to the lengths under axial forces.

    The stiffness at rest stays within 10 % of what known forces give; no other state of the fit has a known
    force across the axis. A link of a single chamber is fitted to the tip under such a force instead of
    lengths, its stiffness within 40 %.

    Parameters
    ----------
    data : Snapshots
    known : Template
        What does not change.
    start : Direct
        What single loads give.
    strains : mapping, optional
        Key `strains` of the robot file, for a link with modes.
    """
    bare = weightless(known)
    states = data.fitted
    n = len(known.strains)
    begin = [data.coordinates(state, n) if strains is None else None for state in states]

    def residuals(found: Mapping[str, float]) -> Array:
        values = completed(known, start, found)
        arm = SoftArm(robot_of(bare, values, strains))
        tips = []
        for k, state in enumerate(states):
            q = equilibrium(arm, state.pressures_pa, begin[k], wrench=_held_force(arm, state.force_n))
            # The search for modes from the straight arm is long; the first candidate lies near all others.
            begin[k] = q if begin[k] is None else begin[k]
            tips.append(arm.pose(q, data.length)[:3, 3] - state.poses[-1][:3, 3])
        lengths = _lengths(data, values) if known.chambers > 1 else np.empty(0)
        return np.concatenate([np.ravel(tips), lengths]) / (UNIT * data.length)

    found = fit(parameters(known, start), residuals, "linear", max_iterations=40)
    return replace(found, values=completed(known, start, found.values))


def tip_errors(data: Snapshots, robot: Robot, states: Sequence[Backbone]) -> list[TipError]:
    """Return the errors of a robot, without its weight and in the frame of the part.

    Parameters
    ----------
    data : Snapshots
        Places of the sections.
    robot : Robot
    states : sequence of Backbone
        What finite elements give.
    """
    arm = SoftArm(robot.replace(gravity=[0.0, 0.0, 0.0], base_quaternion=[0.0, 0.0, 0.0, 1.0]))
    found = []
    for state in states:
        start = None if robot.varies else data.coordinates(state, robot.n_q)
        q = equilibrium(arm, state.pressures_pa, start, wrench=_held_force(arm, state.force_n))
        places = np.array([arm.pose(q, s)[:3, 3] for s in data.z - data.z[0]])
        far = float(np.linalg.norm(places[-1] - state.poses[-1][:3, 3]))
        found.append(TipError(state, q, places, far / data.length, data.motion(state) / data.length))
    return found


def _held_force(arm: SoftArm, force_n: Array) -> Callable[[Array], Array] | None:
    """Return the wrench at the tip of a force whose direction is held in the world; None without one."""
    if not force_n.any():
        return None
    length = arm.robot.length

    def wrench(q: Array) -> Array:
        return np.concatenate([np.zeros(3), arm.pose(q, length)[:3, :3].T @ force_n])

    return wrench


def _lengths(data: Snapshots, values: Mapping[str, float]) -> Array:
    """Lengths of the straight link under axial forces less those of the part [m]."""
    level, rest, rate = (values[f"k_e_{name}"] for name in ("level", "rest", "rate"))
    low, high = -0.9 * data.length, 2.0 * data.length

    def missing(x: float, pull: float) -> float:
        return float((level + (level - rest) * (np.tanh(rate * x) ** 2 - 1.0)) * x - pull)

    found = []
    for state in data.axial:
        pull = float(state.force_n[2])
        if missing(low, pull) >= 0.0 or missing(high, pull) <= 0.0:
            raise ModelError("no length of the link balances the axial force", "k_e")
        found.append(brentq(missing, low, high, (pull,)) - data.length * data.mean(state)[0])
    return np.array(found)
