"""`gains: auto`: the feedback from the model of the arm and from the delay of the platform.

The arm keeps its own stiffness and damping (docs/adr/0005). Feedback of the gain K_p that comes late by T
takes K_p T of the damping away: K_p of a bending is a small part of the damping over T. Elongation is stiff,
fast and damped, and gets a part of its stiffness. The parts are those of the three-bellow arm, tuned
on the plant of tests/soro_core/loop; docs/gains.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soro_core.adaptation.modes import first_mode, losses
from soro_core.arrays import Array
from soro_core.control.config import Gains
from soro_core.control.passivity.adaptive import FeedbackGains
from soro_core.control.reference.coordinate_values import gain_matrix, per_coordinate
from soro_core.errors import ConfigError
from soro_core.robot.coordinates import StrainFields

if TYPE_CHECKING:
    from soro_core.model import SoftArm


# K_p of bending: part of the damping over the time until a set point acts, and at most of the stiffness.
DAMPING_PART, BEND_PART = 0.093, 0.15
# K_p of elongation: part of the stiffness; less where twice the damping of the first mode is below 1.
STRETCH_PART = 0.3
# K_d / K_p of bending and 1 / Lambda, in times until a set point acts.
RATE_TIMES, LAMBDA_TIMES = 3.5, 9.0
# Force of the feedback on a bending mode, at most, in that of the mode's own damping: more oscillates in the
# second mode of two links that hang. Modes that turn by more than pi in the delay are faster than the loop.
MODE_PART = 1.4
# Time until a set point acts where the regulators act at once [s].
LEAST_S = 0.01


def gains_of(
    arm: SoftArm,
    fields: StrainFields,
    gains: Gains,
    pieces: int,
    preview_s: float,
    factors: tuple[float, float] = (1.0, 1.0),
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
    factors : tuple of float
        Of the law, on automatic K_p and K_d of elongation and shear, and of bending and torsion.

    Raises
    ------
    ConfigError
        If the number of values does not fit, or gains are not stated and a strain has no stiffness.
    """
    delay = max(preview_s, LEAST_S)
    k_p = None if gains.k_p is None else gain_matrix(fields, gains.k_p, "gains.k_p") / pieces
    k_d = None if gains.k_d is None else gain_matrix(fields, gains.k_d, "gains.k_d") / pieces
    if k_p is None or k_d is None:
        found = np.where(fields.stretch, *factors)[:, None] * _proportional(arm, fields, delay)
        found = np.where(fields.stretch, 1.0, _mode_share(arm, fields, found, delay))[:, None] * found
        k_p = found if k_p is None else k_p
        k_d = np.where(fields.stretch, 0.0, RATE_TIMES * delay)[:, None] * found if k_d is None else k_d
    if gains.lambda_per_s is None:
        rate = np.full(arm.n_q, 1.0 / (LAMBDA_TIMES * delay))
    else:
        rate = per_coordinate(fields, gains.lambda_per_s, "gains.lambda_per_s")[0]
    return FeedbackGains(k_p, k_d, rate)


def _proportional(arm: SoftArm, fields: StrainFields, delay_s: float) -> Array:
    """Return the automatic K_p (n_q, n_q)."""
    try:
        bend, stretch = (first_mode(arm, stretch) for stretch in (False, True))
    except ConfigError as error:
        raise ConfigError("controller", "gains", "auto", f"stated gains: {error.got}") from None
    k_p = np.zeros(arm.n_q)
    stiffness = _of_uniform(fields, arm.stiffness_matrix(np.zeros(arm.n_q)))
    if bend is not None:
        damping = _of_uniform(fields, losses(arm, bend.rate_per_s))
        k_p = np.minimum(DAMPING_PART * damping / delay_s, BEND_PART * stiffness)
    if stretch is not None:
        part = STRETCH_PART * min(1.0, 2.0 * stretch.damping)
        k_p = np.where(fields.stretch, part * stiffness, k_p)
    return np.asarray(k_p[:, None] * fields.weight)


def _mode_share(arm: SoftArm, fields: StrainFields, k_p: Array, delay_s: float) -> float:
    """Return the part, at most 1, of automatic K_p (n_q, n_q) of bending that no bending mode forbids."""
    from scipy.linalg import eigh  # imported here: a scene reads the keys of a learner without it

    zero, bend = np.zeros(arm.n_q), ~fields.stretch
    stiffness, inertia = arm.stiffness_matrix(zero), arm.inertia_matrix(zero)
    square, shapes = eigh(stiffness[np.ix_(bend, bend)], inertia[np.ix_(bend, bend)])
    share = 1.0
    for rate, bent in zip(np.sqrt(square), shapes.T, strict=True):
        if rate * delay_s > np.pi:
            continue
        shape = np.zeros(arm.n_q)
        shape[bend] = bent
        # K_p e + K_d s at this rate, K_d and Lambda in times of the delay.
        lead = complex(1.0 + RATE_TIMES / LAMBDA_TIMES, RATE_TIMES * rate * delay_s)
        made = float(shape @ k_p @ shape) * abs(lead)
        if made > 0.0:
            share = min(share, MODE_PART * rate * float(shape @ losses(arm, rate) @ shape) / made)
    return share


def _of_uniform(fields: StrainFields, matrix: Array) -> Array:
    """Return what a matrix (n_q, n_q) is for a strain that is uniform along its link, by coordinate."""
    same = fields.index[:, None] == fields.index
    shared = fields.uniform[:, None] * matrix * fields.uniform * same
    return np.asarray(np.bincount(fields.index, shared.sum(axis=1))[fields.index])
