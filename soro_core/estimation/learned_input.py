"""Feed the learned force to the filter; fade it out when updates stop."""

from __future__ import annotations

from typing import NamedTuple

from soro_core.adaptation.learned import Learned

# A learned force that is not renewed for this time [s] fades out; each way takes `FADE_S`.
RENEWED_S, FADE_S = 0.1, 0.5
# Times that differ by less [s] are equal.
_SAME_S = 1e-9


class LearnedInput(NamedTuple):
    """The learned model in force.

    Attributes
    ----------
    learned : Learned or None
        The last one that was finite; None before the first and after it has faded out.
    age_s : float
        Time since it came [s].
    share : float
        Part of its force that the filter uses, 0 to 1.
    held : Learned or None
        The same with the force from outside that holds the arm, in place of it; None while the arm is free.
    """

    learned: Learned | None = None
    age_s: float = 0.0
    share: float = 0.0
    held: Learned | None = None

    @property
    def note(self) -> str:
        """What the user must know, or an empty string."""
        if self.learned is None or self.age_s <= RENEWED_S + _SAME_S:
            return ""
        return f"no learned force for {self.age_s:.2f} s: it fades out ({self.share:.0%} left)"


def update_learned_input(
    state: LearnedInput, learned: Learned | None, dt: float, placed: bool = True, has_shape: bool = False
) -> LearnedInput:
    """Return what is in force after a tick.

    Parameters
    ----------
    state : LearnedInput
        After the last tick.
    learned : Learned or None
        What came since then, finite; None for nothing.
    dt : float
        Time since the last tick [s].
    placed : bool
        False where the filter has orientations alone.
    has_shape : bool
        Whether the filter knows what non-uniform strain does to orientations. If not, a mass that these have
        taught would confirm itself in what they do not see, and its force is not used.
    """
    kept, age_s = (state.learned, state.age_s + dt) if learned is None else (learned, 0.0)
    if kept is None:
        return LearnedInput()
    change = dt / FADE_S if (placed or has_shape) and age_s <= RENEWED_S + _SAME_S else -dt / FADE_S
    share = min(max(state.share + change, 0.0), 1.0)
    return LearnedInput(kept, age_s, share) if share > 0.0 or age_s == 0.0 else LearnedInput()
