"""Equilibrium of an arm under constant pressures."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from soro_core.arrays import Array
from soro_core.errors import ModelError, short
from soro_core.model.checks import (
    finite,
    flat_wrench,
    listed,
    note_range,
    number,
    refuse_push,
    require,
    shaped,
)
from soro_core.model.equilibrium.continuation import follow
from soro_core.model.equilibrium.rest_forces import RestForces
from soro_core.model.equilibrium.settle import settle
from soro_core.model.soft_arm import SoftArm
from soro_core.robot.coordinates import strain_fields

# A stiff hold makes a narrow, bent valley, in which a search from afar stalls: its force is raised in steps.
SHARES = tuple(np.geomspace(1e-6, 1.0, 13))
# What is done about an arm whose rest is unstable.
CURE = (
    "hang it (base_quaternion: [1, 0, 0, 0] turns it from up to down), stiffen it, or call"
    " stable_equilibrium, which finds where it falls to"
)


class NoBalanceError(ModelError):
    """The branch of equilibria that begins at rest ends before the pressures are reached.

    Parameters
    ----------
    text : str
        One line.
    reached_pa : tuple of float
        Largest pressures [Pa] on it, in the ratio of those wanted.
    """

    def __init__(self, text: str, reached_pa: tuple[float, ...]) -> None:
        self.reached_pa = reached_pa
        super().__init__(text, "equilibrium")


def equilibrium(
    arm: SoftArm,
    pressure: ArrayLike,
    start: ArrayLike | None = None,
    added_tip_mass: float = 0.0,
    *,
    tension: ArrayLike | None = None,
    wrench: ArrayLike | Callable[[Array], Array] | None = None,
) -> Array:
    """Coordinates at rest under constant pressures, creep and hysteresis relaxed; contact without friction.

    Where contact or a held tip lets the search fail, it follows the equilibrium while these forces grow from
    a millionth of theirs to all. Where the search from the straight arm fails or ends at an unstable
    equilibrium, it follows the branch from rest without pressure while pressures, tensions and wrenches grow.

    Parameters
    ----------
    arm : SoftArm
    pressure : array_like of shape (n_u,)
        Of the chambers [Pa gauge]; without `tension` the tensions of tendons stand behind them.
    start : array_like of shape (n_q,), optional
        Where the search starts, and which equilibrium it finds; default straight.
    added_tip_mass : float
        Mass at the tip beside that of the robot [kg].
    tension : array_like of shape (n_tendons,), optional
        Tensions of the tendons [N], 0 or more; `pressure` is then that of the chambers alone.
    wrench : (6,) or (n_wrenches, 6) or callable, optional
        Wrenches that turn with their sections, as in `SoftArm.forward_dynamics`; a function of q gives
        others, like a force that is held in the world. Default none.

    Returns
    -------
    Array of shape (n_q,)

    Raises
    ------
    ModelError
        If an argument is not allowed, or no equilibrium is found from there; as a `NoBalanceError` where the
        branch from rest ends before these inputs.

    Notes
    -----
    A line in the log of soro_core names pressures beyond the range of the robot, as in `simulate`, and an
    arm that would not stay where the search without a `start` has ended.
    """
    forces = _forces(arm, pressure, added_tip_mass, tension, wrench)
    q = _equilibrium(forces, start)
    if start is None and not forces.is_stable(q):
        _note_unstable(arm.robot.name)
    return q


@cache  # once a robot
def _note_unstable(name: str) -> None:
    text = "equilibrium: %s does not stay there, this rest is unstable: it buckles; %s"
    logging.getLogger("soro_core").warning(text, name, CURE)


def _equilibrium(forces: RestForces, start: ArrayLike | None) -> Array:
    arm, p = forces.arm, forces.pressure_pa
    cure = "start the search nearer to it (start), or lower the load"
    if start is not None:
        q, failure = _near(forces, finite(shaped(start, (arm.n_q,), "start", arm.robot.name), "start"))
    else:
        q, failure = _near(forces, np.zeros(arm.n_q))
        if (p.any() or forces.wrench is not None) and (failure or not forces.is_stable(q)):
            q, failure, is_unstable = _from_rest(forces, q, failure)
            if failure and is_unstable:
                failure += "; without pressure its rest is unstable, it buckles under its weight"
                cure = CURE
    if failure:
        where = f"pressures {listed(p)} Pa of {arm.robot.name}"
        raise ModelError(f"no equilibrium at {where}: {failure}; {cure}", "equilibrium")
    return q


def stable_equilibrium(
    arm: SoftArm, pressure: ArrayLike, near: ArrayLike | None = None, added_tip_mass: float = 0.0
) -> Array:
    """Coordinates of an equilibrium to which the arm returns.

    The search starts at `near`. Where it ends at none, or at an unstable one, it is that of `equilibrium`,
    which follows the branch from rest; where that one is unstable too, or rest is, it is the one that the arm
    falls to.

    Parameters
    ----------
    arm : SoftArm
    pressure : array_like of shape (n_u,)
        [Pa gauge].
    near : array_like of shape (n_q,), optional
        Equilibrium under other pressures.
    added_tip_mass : float
        Mass at the tip beside that of the robot [kg].

    Returns
    -------
    Array of shape (n_q,)

    Raises
    ------
    ModelError
        As `equilibrium`, and if the arm falls to no stable one.
    """
    forces = _forces(arm, pressure, added_tip_mass)
    if near is not None:
        try:
            q = _equilibrium(forces, near)
        except ModelError:
            pass
        else:
            if forces.is_stable(q):
                return q
    try:
        q = _equilibrium(forces, None)
    except NoBalanceError:
        raise
    except ModelError:  # there is no branch to follow from an unstable rest
        return settle(forces, np.zeros(arm.n_q))
    return q if forces.is_stable(q) else settle(forces, q)


def carried_share(arm: SoftArm, pressure: ArrayLike, wrench: ArrayLike | None = None) -> float:
    """Return how much of a load an arm carries: 1, or the share beyond which it has no equilibrium.

    It follows the branch from the arm that nothing loads while weight, pressures, wrenches and contact grow
    together. Where the branch is so long that its end is not found, or begins at a soft arm, it is 1.

    Parameters
    ----------
    arm : SoftArm
    pressure : array_like of shape (n_u,)
        [Pa gauge].
    wrench : (6,) or (n_wrenches, 6), optional
        As in `SoftArm.forward_dynamics`.
    """
    p = np.asarray(pressure, dtype=np.float64)
    is_outside = wrench is not None or RestForces(arm, p).outside

    def unbalanced(q: Array, share: float) -> Array:
        load = arm.gravity_force(q) - arm.pressure_force(q, p)
        if is_outside:
            load -= arm.external_forces(q, wrench=wrench).generalised
        return np.asarray(arm.elastic_force(q) + share * load)

    fields = strain_fields(arm.robot)
    weight = np.where(fields.stretch, 1.0, fields.length)
    stiffness = np.diag(arm.stiffness_matrix(np.zeros(arm.n_q)))
    if not (stiffness > 0.0).all():
        return 1.0
    with np.errstate(all="ignore"):  # of coordinates beyond all bounds
        branch = follow(unbalanced, np.zeros(arm.n_q), weight, stiffness)
    return branch.share if branch.is_whole else 1.0


def _forces(
    arm: SoftArm,
    pressure: ArrayLike,
    added_tip_mass: float,
    tension: ArrayLike | None = None,
    wrench: ArrayLike | Callable[[Array], Array] | None = None,
) -> RestForces:
    """Return what acts on an arm, of arguments that are allowed."""
    require(arm, SoftArm, "arm", "a SoftArm")
    name, n = arm.robot.name, 0 if tension is None else len(arm.robot.tendons)
    p = finite(shaped(pressure, (arm.n_u - n,), "pressure", name), "pressure")
    if tension is not None:
        p = np.concatenate((p, finite(shaped(tension, (n,), "tension", name), "tension")))
    refuse_push(arm.robot, p, "pressure" if tension is None else "tension")
    if wrench is not None and not callable(wrench):
        finite(flat_wrench(arm.robot, wrench), "wrench")
        wrench = np.array(wrench, dtype=np.float64)
    least = 0.0 - arm.robot.tip_mass  # what is there may be taken away
    if not least <= number(added_tip_mass) < math.inf:
        allowed = f"a mass [kg] of {least:g} or more"
        raise ModelError(
            f"added_tip_mass: got {short(added_tip_mass)}; allowed is {allowed}", "added_tip_mass"
        )
    note_range(arm.robot, p, "equilibrium")
    return RestForces(arm, p, number(added_tip_mass), wrench)


def _from_rest(forces: RestForces, found: Array, failure: str) -> tuple[Array, str, bool]:
    """Equilibrium on the branch from rest and why none; what was found before, and True, of unstable rest."""
    arm, p = forces.arm, forces.pressure_pa
    none = RestForces(arm, np.zeros(arm.n_u), forces.added_tip_mass)
    rest, unrest = _near(none, np.zeros(arm.n_q))
    if unrest or not none.is_stable(rest):
        return found, failure, not unrest
    fields = strain_fields(arm.robot)
    weight = np.where(fields.stretch, 1.0, fields.length)
    branch = follow(forces.unbalanced, rest, weight, _scale(none, 1.0))
    if not branch.is_whole:
        return branch.q, "the arm moves too far on the way there from no pressure", False
    if branch.share < 1.0:
        reached = p - (1.0 - branch.share) * arm.acting_pressure(p)
        share = "" if forces.wrench is None else f" with {100.0 * branch.share:.3g} % of the wrench"
        raise NoBalanceError(
            f"no equilibrium at pressures {listed(p)} Pa of {arm.robot.name}: no balance beyond"
            f" {listed(reached)} Pa{share}, on the way there from no pressure; lower the pressures or the"
            " load",
            tuple(float(one) for one in reached),
        )
    return *_search(forces, 1.0, branch.q), False


def _near(forces: RestForces, begin: Array) -> tuple[Array, str]:
    """Equilibrium near a start, and what prevented it."""
    q, failure = _search(forces, 1.0, begin)
    if failure and forces.outside:
        q = begin
        for share in SHARES:
            q, failure = _search(forces, share, q)
    return q, failure


def _scale(forces: RestForces, outside: float) -> Array:
    """Stiffness of each coordinate of the straight arm: forces on strains and curvatures differ by much."""
    straight = forces.stiffness(np.zeros(forces.arm.n_q), outside)
    return np.maximum(np.abs(np.diag(straight)), 1e-12)


def _search(forces: RestForces, share: float, begin: Array) -> tuple[Array, str]:
    """Equilibrium with this share of the forces from outside, and what prevented it."""
    from scipy.optimize import root  # loaded late: nodes do without it

    scale = _scale(forces, share)
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # of a search that leaves all bounds
            found = root(lambda q: forces.unbalanced(q, 1.0, share) / scale, begin, tol=1e-10)
    except ModelError as error:
        return begin, str(error).split(" (q = ")[0]
    q = np.asarray(found.x, float)
    if not np.isfinite(q).all():
        return begin, "the search left all bounds"
    good = np.abs(found.fun).max() <= 1e-6
    return q, "" if good else "the search stalled"
