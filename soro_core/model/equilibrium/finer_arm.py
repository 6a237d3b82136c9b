"""The same arm in several pieces for each link, which a force bends non-uniformly."""

from __future__ import annotations

from typing import Any

import numpy as np

from soro_core.arrays import Array
from soro_core.model import SoftArm
from soro_core.robot.parts import fields


def finer_arm(arm: SoftArm, pieces: int) -> tuple[SoftArm, Array]:
    """Return a finer arm at rest, without losses, contact and held tip, and how strains spread over it.

    Parameters
    ----------
    arm : SoftArm
        Of uniform strain.
    pieces : int
        For each of its links.

    Returns
    -------
    arm : SoftArm
    spread : ndarray (n_fine, n_q)
        Its coordinates are spread q where the links are bent uniformly.
    """
    robot = arm.robot
    still: dict[str, Any] = {"damping": None, "creep": [], "hysteresis": []}
    links = [{**fields(link), **still} for link in robot.links]
    fine = SoftArm(robot.replace(links=links, contacts=None, tip_constraint=None).refine(pieces))
    spread, row, column = np.zeros((fine.n_q, arm.n_q)), 0, 0
    for link in robot.links:
        n, rows = link.n_q, pieces * link.n_q
        spread[row : row + rows, column : column + n] = np.tile(np.eye(n), (pieces, 1))
        row, column = row + rows, column + n
    return fine, spread
