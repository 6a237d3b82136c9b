"""A commanded stiffness of the tip: the reference moves with the force that pushes it.

With the law alone the tip moves by C_p F: its own compliance C, less what the feedback holds. For the
compliance C / factor the reference moves by

    (C / factor - C_p) F,

F the estimated force. (Admittance control: Hogan, Impedance control, 1985; Siciliano and Villani, Robot Force
Control, 1999.) Feedback of the force reaches both softer and stiffer ones, once no load explains it
(`contact`) and with the delay of the estimate: a quick push meets the arm's own stiffness.
"""

from __future__ import annotations

import numpy as np

from soro_core.arrays import Array
from soro_core.control.force.force_state import ForceLoopState
from soro_core.control.force.press import likely_force
from soro_core.control.force.pushed_tip import PushedTip, fade
from soro_core.frozen import replaced

# Time constant of the reference on its way [s]: slower than the first mode, faster than a hand holds still.
_YIELD_S = 0.3
# Displacement by the forces that may come, as a part of the length: their deviation in `likely_force`.
_LARGEST_PART = 0.2
# Part of the largest compliance that is no negative one.
_ROUNDING = 1e-6


def yielding(push: PushedTip, state: ForceLoopState, q: Array, dt: float) -> tuple[ForceLoopState, Array]:
    """Return the state, and the velocity (3,) [m/s] of the moved reference.

    Parameters
    ----------
    push : PushedTip
    state : ForceLoopState
    q : ndarray (n_q,)
        Coordinates of the reference in force, not moved.
    dt : float
        Time since the last tick [s].
    """
    factor, felt, goal = push.config.stiffness_factor, state.felt, np.zeros(3)
    if not factor or felt is None or felt.stage != "contact":  # what may be a load is held up
        state = replaced(state, yields=None)
    else:
        if state.yields is None:
            own, with_feedback = push.stiffness.compliances(q, push.k_p, state.pressure_pa)
            largest_n = _LARGEST_PART * push.stiffness.arm.length / float(np.linalg.norm(own, 2))
            softest = np.linalg.eigvalsh(own + own.T)
            # An arm that stands by its feedback alone would be moved against what pushes it.
            falls = softest[0] < -_ROUNDING * np.abs(softest).max()
            moves = np.zeros((3, 3)) if falls else own / factor - with_feedback
            state = replaced(state, yields=(moves, largest_n**2 * np.eye(3)))
        assert state.yields is not None
        moves, before = state.yields
        goal = moves @ likely_force(felt.force_n, felt.covariance, before)
    time_s = max(dt, _YIELD_S) if factor else dt
    return state, fade(state.moved - goal, push.config.follow_speed_m_s, time_s)
