"""`gains: auto`: the feedback from the model of the arm and from the delay of the platform.

The arm keeps its own stiffness and damping (docs/adr/0005), and feedback that comes late takes damping away.
It is therefore a small part of the stiffness, smaller where the arm damps itself little, and its times are
multiples of the time until a set point acts. The parts are those of the three-bellow arm, which was tuned on
the plant of tests/loop; docs/control.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.adaptation.modes import first_mode
from soro_core.control.adaptive import FeedbackGains
from soro_core.control.config import Gains
from soro_core.control.spread import gain_matrix, per_coordinate
from soro_core.errors import ConfigError
from soro_core.robot.coordinates import StrainFields

if TYPE_CHECKING:
    from soro_core.model import SoftArm

Array: TypeAlias = NDArray[np.float64]

# K_p, part of the stiffness of a strain; less where twice the damping of the first mode is below 1.
STRETCH_PART, BEND_PART = 0.3, 0.08
# K_d / K_p of bending and 1 / Lambda, in times until a set point acts.
RATE_TIMES, LAMBDA_TIMES = 3.2, 8.0
# Time until a set point acts where the regulators act at once [s].
LEAST_S = 0.01


def gains_of(
    arm: SoftArm, fields: StrainFields, gains: Gains, pieces: int, preview_s: float
) -> FeedbackGains:
    """Return the feedback gains in the coordinates of the arm.

    Parameters
    ----------
    arm : SoftArm
        Discretised arm.
    fields : StrainFields
        Its strains.
    gains : Gains
        Gains of whole links; what is not stated is found here.
    pieces : int
        Number of pieces of each link; each piece gets its share of K_p and K_d.
    preview_s : float
        Time until a set point acts [s].

    Raises
    ------
    ConfigError
        If the number of values does not fit, or gains are not stated and a strain has no stiffness.
    """
    delay = max(preview_s, LEAST_S)
    k_p = None if gains.k_p is None else gain_matrix(fields, gains.k_p, "gains.k_p") / pieces
    k_d = None if gains.k_d is None else gain_matrix(fields, gains.k_d, "gains.k_d") / pieces
    if k_p is None or k_d is None:
        found = _proportional(arm, fields)
        k_p = found if k_p is None else k_p
        k_d = np.where(fields.stretch, 0.0, RATE_TIMES * delay)[:, None] * found if k_d is None else k_d
    if gains.lambda_per_s is None:
        rate = np.full(arm.n_q, 1.0 / (LAMBDA_TIMES * delay))
    else:
        rate = per_coordinate(fields, gains.lambda_per_s, "gains.lambda_per_s")[0]
    return FeedbackGains(k_p, k_d, rate)


def _proportional(arm: SoftArm, fields: StrainFields) -> Array:
    """Return the automatic K_p (n_q, n_q)."""
    try:
        modes = [first_mode(arm, stretch) for stretch in (False, True)]
    except ConfigError as error:
        raise ConfigError("controller", "gains", "auto", f"stated gains: {error.got}") from None
    bend, stretch = (
        0.0 if mode is None else part * min(1.0, 2.0 * mode.damping)
        for part, mode in zip((BEND_PART, STRETCH_PART), modes, strict=True)
    )
    part = np.where(fields.stretch, stretch, bend)
    return np.asarray((part * _uniform_stiffness(arm, fields))[:, None] * fields.weight)


def _uniform_stiffness(arm: SoftArm, fields: StrainFields) -> Array:
    """Return the stiffness (n_q,) of the strain of each coordinate, uniform along its link."""
    stiffness = arm.stiffness_matrix(np.zeros(arm.n_q))
    same = fields.index[:, None] == fields.index
    shared = fields.uniform[:, None] * stiffness * fields.uniform * same
    return np.asarray(np.bincount(fields.index, shared.sum(axis=1))[fields.index])
