"""The push of a tip in contact, and the reference that goes with the tip; the equations: `force_loop`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from soro_core.arrays import Array
from soro_core.control.force.force_state import PUSH_S, ForceLoopState
from soro_core.control.force.tip_stiffness import StiffnessAtTip
from soro_core.control.motion_config import ForceControlConfig
from soro_core.frozen import replaced

# Time constant of the answer of arm and estimate [s].
_ANSWER_S = 0.2
# Rate at which a pressure beyond its range moves the tip so that it is not [1/s].
_RELIEF_PER_S = 3.0
# Largest part of the goal that the integral adds.
_MOST_ADDED = 0.5


class PushedTip(NamedTuple):
    """Pushes the tip of one arm.

    Attributes
    ----------
    stiffness : StiffnessAtTip
    config : ForceControlConfig
    k_p : ndarray (n_q, n_q)
        Feedback of the law.
    """

    stiffness: StiffnessAtTip
    config: ForceControlConfig
    k_p: Array

    def touched(self, state: ForceLoopState, q: Array, toward: Array, force: float) -> ForceLoopState:
        """Return the state at the begin of a contact, with the force of now.

        Parameters
        ----------
        state : ForceLoopState
        q : ndarray (n_q,)
            Coordinates of the reference.
        toward : ndarray (3,)
            Direction of the push.
        force : float
            Along it [N].
        """
        return replaced(
            state,
            phase="contact",
            wanted_n=force,
            answer_n=force,
            added_n=0.0,
            toward=toward,
            tracked=None if state.tracked is None else state.tracked.stopped(),  # the wall rests
            scale=self.stiffness.nonuniformity(q, toward),
            by_common=self.stiffness.by_common_pressure(q),
        )

    def pushed(
        self,
        state: ForceLoopState,
        told: tuple[float, float],
        at: tuple[Array, Array],
        back: Array,
        dt: float,
    ) -> ForceLoopState:
        """Return the state with the reference along `toward` at the tip; the push goes to `goal`.

        Parameters
        ----------
        state : ForceLoopState
        told : pair of float
            Wanted and estimated force along `toward` [N].
        at : pair of ndarray (3,)
            Position and velocity of the tip of the reference, not moved [m, m/s].
        back : ndarray (3,)
            Velocity of the moved reference across `toward` [m/s].
        dt : float
            Time since the last tick [s].
        """
        assert state.tracked is not None
        toward, (goal, force), (tip, speed) = state.toward, told, at
        own = float(toward @ speed)
        wanted = goal + (state.wanted_n - goal) * float(np.exp(-dt / PUSH_S))
        answer = wanted + (state.answer_n - wanted) * float(np.exp(-dt / _ANSWER_S))
        added = state.added_n + dt * self.config.rate_per_s * (answer - force)
        most = _MOST_ADDED * goal
        step = float(toward @ (state.tracked.tip - tip - state.moved))
        most_step = (self.config.follow_speed_m_s + abs(own)) * dt
        return replaced(
            state,
            wanted_n=wanted,
            answer_n=answer,
            added_n=min(max(added, -most), most),
            moved=state.moved + dt * back + min(max(step, -most_step), most_step) * toward,
            rate=back + (float(toward @ state.tracked.speed) - own) * toward,
        )

    def relieved(self, state: ForceLoopState, missing_pa: Array, dt: float) -> ForceLoopState:
        """Return the state with the tip moved where a push needs pressures beyond one end of their range.

        A link whose chambers all get more, or less, pressure becomes longer or shorter, and pushes as before:
        force has priority over the position across it.

        Parameters
        ----------
        state : ForceLoopState
        missing_pa : ndarray (n_u,)
            Pressure beyond its bound that the desired force needs of each chamber, negative below [Pa].
        dt : float
            Time since the last tick [s].
        """
        common = np.zeros(state.by_common.shape[1])
        for link, of_link in enumerate(self.stiffness.chambers):
            low, high = float(np.min(missing_pa[of_link])), float(np.max(missing_pa[of_link]))
            common[link] = -low if high <= 0.0 else -high if low >= 0.0 else 0.0
        rate = _RELIEF_PER_S * (state.by_common @ common)
        rate = rate * min(1.0, self.config.follow_speed_m_s / max(float(np.linalg.norm(rate)), 1e-9))
        return replaced(state, moved=state.moved + dt * rate)


def across(vector: Array, direction: Array) -> Array:
    """Return the part of a vector (3,) across a unit vector (3,)."""
    return np.asarray(vector - (direction @ vector) * direction)


def fade(moved: Array, speed: float, dt: float) -> Array:
    """Return the velocity (3,) [m/s] that takes a displacement back.

    Parameters
    ----------
    moved : ndarray (3,)
        Displacement [m].
    speed : float
        Largest [m/s].
    dt : float
        Time in which it may be back at the earliest [s].
    """
    length = float(np.linalg.norm(moved))
    return np.zeros(3) if length == 0.0 else -moved * min(1.0 / dt, speed / length)
