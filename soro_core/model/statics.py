"""Equilibrium of an arm under constant pressures."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soro_core.errors import ModelError
from soro_core.model.checks import finite, listed, require, shaped
from soro_core.model.soft_arm import SoftArm

Array: TypeAlias = NDArray[np.float64]

# A stiff hold makes a narrow, bent valley, in which a search from afar stalls: its force is raised in steps.
SHARES = tuple(np.geomspace(1e-6, 1.0, 13))


def equilibrium(
    arm: SoftArm, pressure: ArrayLike, start: ArrayLike | None = None, added_tip_mass: float = 0.0
) -> Array:
    """Coordinates at rest under constant pressures, creep and hysteresis relaxed; contact without friction.

    Where contact or a held tip lets the search fail, it follows the equilibrium while these forces grow from
    a millionth of theirs to all.

    Parameters
    ----------
    arm : SoftArm
    pressure : array_like of shape (n_u,)
        [Pa gauge].
    start : array_like of shape (n_q,), optional
        Where the search starts; default straight.
    added_tip_mass : float
        Mass at the tip beside that of the robot [kg].

    Returns
    -------
    Array of shape (n_q,)

    Raises
    ------
    ModelError
        If an argument is not allowed, or no equilibrium is found from there.
    """
    require(arm, SoftArm, "arm", "a SoftArm")
    name = arm.robot.name
    p = finite(shaped(pressure, (arm.n_u,), "pressure", name), "pressure")
    begin = np.zeros(arm.n_q)
    if start is not None:
        begin = finite(shaped(start, (arm.n_q,), "start", name), "start")
    outside = arm.robot.contacts is not None or arm.robot.tip_constraint is not None
    q, trouble = _search(arm, p, 1.0 if outside else 0.0, begin, added_tip_mass)
    if trouble and outside:
        q = begin
        for share in SHARES:
            q, trouble = _search(arm, p, share, q, added_tip_mass)
    if trouble:
        cure = "start the search nearer to it (start), or lower the load"
        raise ModelError(
            f"no equilibrium at pressures {listed(p)} Pa of {name}: {trouble}; {cure}", "equilibrium"
        )
    return q


def _search(arm: SoftArm, p: Array, share: float, begin: Array, added: float) -> tuple[Array, str]:
    """Equilibrium with this share of the forces from outside, and what prevented it."""
    from scipy.optimize import root  # loaded late: nodes do without it

    rest = np.zeros(arm.n_q)

    def unbalanced(q: Array) -> Array:
        force = arm.gravity_force(q) + arm.elastic_force(q) - arm.actuation_matrix(q) @ p
        if added:
            force = force + added * arm.mass_regressor(q, rest, rest, rest)[:, 0]
        return np.asarray(force - share * arm.external_forces(q).generalised if share else force)

    # Forces on elongation and on curvature differ by orders of magnitude: weigh each by its stiffness.
    step = 1e-6
    stiffness = np.array([(unbalanced(e) - unbalanced(-e)) / (2 * step) for e in step * np.eye(arm.n_q)])
    scale = np.maximum(np.abs(np.diag(stiffness)), 1e-12)
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # of a search that leaves all bounds
            found = root(lambda q: unbalanced(q) / scale, begin, tol=1e-10)
    except ModelError as error:
        return begin, str(error).split(" (q = ")[0]
    q = np.asarray(found.x, float)
    if not np.isfinite(q).all():
        return begin, "the search left all bounds"
    good = np.abs(found.fun).max() <= 1e-6
    return q, "" if good else "the search stalled"
