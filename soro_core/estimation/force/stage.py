"""Stages of a contact: nothing, an outside force that may be a load, a contact, which no load explains.

A load that comes pulls along gravity and moves with the tip. Of all loads the one that explains the force
best leaves a rest; where that is beyond its deviations for a while, it is a contact.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from soro_core.adaptation.external_force import Stage
from soro_core.arrays import Array

# Squares of the deviations (chi-square of 3 and of 2 components) of a force and of what no load explains,
# beyond which they are there, and below which they have gone.
_FORCE, _NO_FORCE = 14.2, 7.8
_NO_LOAD, _A_LOAD = 11.8, 4.6
# How long each must last [s]: a sample may be wrong, a new load swings, and the learner's low-pass remembers.
_FORCE_S, _GONE_S, _NO_LOAD_S, _A_LOAD_S = 0.015, 0.4, 0.25, 0.3


class StageState(NamedTuple):
    """The stage, and how long [s] what would change it has lasted.

    Attributes
    ----------
    stage : {"free", "outside force", "contact"}
    force_s, gone_s : float
        There is a force; there is none.
    no_load_s, load_s : float
        No load explains it; a load does.
    """

    stage: Stage = "free"
    force_s: float = 0.0
    gone_s: float = 0.0
    no_load_s: float = 0.0
    load_s: float = 0.0


def next_stage(
    state: StageState, fast: tuple[Array, Array], slow: tuple[Array, Array], gravity: Array, dt: float
) -> StageState:
    """Return the stage after an estimate.

    Parameters
    ----------
    state : StageState
    fast, slow : tuple of ndarray (3,), (3, 3)
        Force [N] and its covariance behind the fast and the slow low-pass.
    gravity : ndarray (3,)
        Its acceleration [m/s^2].
    dt : float
        Time since the last estimate [s].
    """
    size = _size(*fast)
    rest = _size(*slow, gravity)
    force_s = state.force_s + dt if size > _FORCE else 0.0
    gone_s = state.gone_s + dt if size < _FORCE and _size(*slow) < _NO_FORCE else 0.0
    no_load_s = state.no_load_s + dt if rest > _NO_LOAD else 0.0
    load_s = state.load_s + dt if rest < _A_LOAD else 0.0
    stage = state.stage
    if stage == "free" and force_s > _FORCE_S + 0.5 * dt:
        stage, no_load_s = "outside force", 0.0
    elif stage != "free" and gone_s > _GONE_S:
        stage = "free"
    elif stage == "outside force" and no_load_s > _NO_LOAD_S:
        stage = "contact"
    elif stage == "contact" and load_s > _A_LOAD_S:
        stage = "outside force"
    return StageState(stage, force_s, gone_s, no_load_s, load_s)


def _size(force: Array, covariance: Array, along: Array | None = None) -> float:
    """Return the square of a force in its deviations; of what is left once the best part `along` is taken."""
    weighed = np.linalg.solve(covariance, force)
    size = float(force @ weighed)
    if along is not None and along.any():
        of = np.linalg.solve(covariance, along)
        size -= float(force @ of) ** 2 / float(along @ of)
    return size
