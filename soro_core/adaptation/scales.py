"""Units of what is learned, from the model alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ConfigError
from soro_core.robot.coordinates import strain_fields

if TYPE_CHECKING:
    from soro_core.model import SoftArm


# A tenth of the length as elongation, and a bend of 0.64 rad (37 degrees) of a link, are one unit of q.
STRETCH, BEND_RAD = 0.1, 0.64
# Part of the elastic force of one unit of q that is one unit of force.
FORCE_PART = 0.1


@dataclass(frozen=True)
class Scales:
    """Units in the coordinates of one arm.

    Attributes
    ----------
    q : ndarray (n_q,)
        q_scale.
    force : ndarray (n_q,)
        Diagonal of U.
    stiffness : ndarray (n_q,)
        K / U: change of a force, in its unit, by q.
    """

    q: Array
    force: Array
    stiffness: Array


def q_scale_of(arm: SoftArm, pieces: int = 1) -> Array:
    """Return the unit (n_q,) of each coordinate of an arm of which each link is divided into `pieces`."""
    fields = strain_fields(arm.robot)
    return np.where(fields.stretch, STRETCH, BEND_RAD / (pieces * fields.length))


def scales_of(arm: SoftArm, pieces: int = 1) -> Scales:
    """Return the units for an arm of which each link is divided into `pieces`.

    Raises
    ------
    ConfigError
        If a coordinate has no stiffness: there is no unit for its force.
    """
    q = q_scale_of(arm, pieces)
    stiffness = np.diag(arm.stiffness_matrix(np.zeros(arm.n_q)))
    if not (stiffness > 0.0).all():
        name = arm.robot.coordinate_names[int(np.argmin(stiffness))]
        raise ConfigError(
            "learner", "robot", f"no stiffness of {name}", "an arm with stiffness in each strain"
        )
    force = FORCE_PART * stiffness * q
    return Scales(q, force, stiffness / force)
