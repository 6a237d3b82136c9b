"""A squeeze from tick to tick: close, touch, squeeze, hold, squeeze harder where the object slips, open.

The bending that pressure alone does not explain is the force of contact, as in Herrera, Huh and Milutinovic,
arXiv 2410.01078, who keep a multiple of it; here a model turns it into newtons, and a loop on these sets the
pressures, as arXiv 1909.06756 has it with sensors of force. That force rises while the object slips is
Wong and Zhu, doi 10.3389/frobt.2026.1735467; they see the slip by tactile sensors.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from soro_core.arrays import Array, Flags
from soro_core.errors import ConfigError
from soro_core.frozen import replaced
from soro_core.grasping.finger import Finger
from soro_core.grasping.settings import SqueezeSettings

Phase: TypeAlias = Literal["open", "closing", "touching", "squeezing", "holding", "slipping", "opening"]
# Part of the goal at which a squeeze holds, and mean times of the filter for which it looks away after that.
_REACHED, _SETTLED = 0.97, 3.0
# Time constants of the filter in which a finger comes to the crush limit, and for which an object that has
# sunk still sinks.
_APPROACH, _SINKS = 10.0, 0.3


@dataclass(frozen=True)
class Felt:
    """What is measured at a tick.

    Attributes
    ----------
    pressure_pa : sequence of ndarray (n_u,)
        Of each finger [Pa gauge].
    q : sequence of (ndarray (n_q,) or None)
        Coordinates of each finger by its pose; None without a pose.
    height_m : float or None
        Height of the object, along `Finger.up`, where something tracks it [m].
    gravity : ndarray (3,) or None
        Seen from a palm that tilts [m/s^2]; None: that of the robot files.
    """

    pressure_pa: Sequence[Array]
    q: Sequence[Array | None]
    height_m: float | None = None
    gravity: Array | None = None


@dataclass(frozen=True)
class SqueezeState:
    """State between two ticks; that of the start is an open hand.

    Attributes
    ----------
    phase : str
        What the hand does.
    level_pa : ndarray (n,)
        Pressure of the chamber that closes each finger most [Pa].
    touches : ndarray (n,) of bool
        Which fingers have touched the object.
    force_n : ndarray (n,)
        Squeeze of each finger [N]; by its pressure where it has no pose.
    along_n : ndarray (n,)
        Force along each finger [N]; nan without a pose.
    goal_n : float
        Squeeze that is asked for [N].
    smooth : tuple of (ndarray or None)
        Low-passed coordinates and pressures of each finger in one.
    height_m : ndarray (2,)
        Low-passed height of the object in the world, and over the fingers' places of touch [m]; nan where it
        is not tracked.
    mark_m, begin_m : ndarray (2,)
        The same behind a play of `still_m`, which noise does not move; and when it last was held [m].
    bend_n : float
        Mean of what bends the fingers, which a load along them does not change where they stick [N].
    sunk_m : float
        How far it has come down since then, in the world and against the fingers: the less of both [m].
    slid_m : float
        Growth of it in this tick [m].
    still_s : float
        Time since it last slipped, where it is tracked [s].
    begun_m : float
        Height over the fingers' places at the touch [m].
    bound : str
        What has kept the hand from squeezing harder since then; empty where nothing has.
    held_n : float
        `bend_n` since the pressures hold [N].
    since_s : float
        Time in this phase [s].
    felt_s : float
        Time since the start [s].
    most_n : float
        Largest force that may be across a finger, with the doubt of its estimate [N].
    cause : str
        Why it opens; empty where it was asked to.
    """

    phase: Phase
    level_pa: Array
    touches: Flags
    force_n: Array
    along_n: Array
    goal_n: float
    smooth: tuple[Array | None, ...]
    height_m: Array
    mark_m: Array
    begin_m: Array
    bend_n: float = 0.0
    sunk_m: float = 0.0
    slid_m: float = 0.0
    still_s: float = np.inf
    begun_m: float = np.nan
    bound: str = ""
    held_n: float = 0.0
    since_s: float = 0.0
    felt_s: float = 0.0
    most_n: float = 0.0
    cause: str = ""


class Squeeze:
    """Squeezes an object between fingers; weight and friction are not told.

    Parameters
    ----------
    fingers : sequence of Finger
        Two or more.
    settings : SqueezeSettings

    Raises
    ------
    ConfigError
        With fewer than two fingers.
    """

    def __init__(self, fingers: Sequence[Finger], settings: SqueezeSettings) -> None:
        if len(fingers) < 2:
            raise ConfigError("hand", "fingers", len(fingers), "two or more")
        self.fingers, self.settings = tuple(fingers), settings
        self._steps: dict[Phase, Callable[[SqueezeState, float], SqueezeState]] = {
            "open": lambda state, dt: state,
            "closing": self._closing,
            "touching": self._closing,
            "squeezing": self._squeezing,
            "holding": self._holding,
            "slipping": self._slipping,
            "opening": self._opening,
        }

    def initial_state(self) -> SqueezeState:
        """Return the state of an open hand."""
        n, s = len(self.fingers), self.settings
        none, unseen = np.zeros(n), np.full(2, np.nan)
        return SqueezeState(
            "open",
            none,
            np.zeros(n, dtype=bool),
            none,
            none,
            s.force_n,
            (None,) * n,
            unseen,
            unseen,
            unseen,
        )

    def pressures(self, state: SqueezeState) -> list[Array]:
        """Return the pressures that are wanted of each finger, (n_u,) [Pa gauge]."""
        return [
            self.settings.pressures(one.closing, level)
            for one, level in zip(self.fingers, state.level_pa, strict=True)
        ]

    def step(self, state: SqueezeState, felt: Felt, closes: bool, dt: float) -> SqueezeState:
        """Return the state after a tick.

        Parameters
        ----------
        state : SqueezeState
        felt : Felt
        closes : bool
            Whether the hand is to hold, or to be open.
        dt : float
            Time since the last tick [s].

        Raises
        ------
        ConfigError
            If what is measured is not finite or not of these fingers.
        """
        state = self._feel(state, felt, dt)
        # A force that is no number is above no limit.
        if state.phase not in ("open", "opening") and not np.isfinite([state.most_n, *state.force_n]).all():
            state = _begin(state, "opening", cause="the model of a finger gives no finite force")
        if not closes:
            state = replaced(state, cause="")
            if state.phase not in ("open", "opening"):
                state = _begin(state, "opening")
        elif state.phase == "open" and not state.cause:
            state = _begin(state, "closing", goal_n=self.settings.force_n)
        elif state.phase == "opening" and not state.cause:
            state = _begin(state, "closing", touches=np.zeros_like(state.touches))
        return self._steps[state.phase](state, dt)

    def _feel(self, state: SqueezeState, felt: Felt, dt: float) -> SqueezeState:
        """Return the state with the forces that the fingers feel, and with how the object moves."""
        s, n = self.settings, len(self.fingers)
        if len(felt.q) != n or len(felt.pressure_pa) != n:
            raise ConfigError("felt", "q, pressure_pa", (len(felt.q), len(felt.pressure_pa)), f"{n} fingers")
        if felt.height_m is not None and not np.isfinite(felt.height_m):
            raise ConfigError("felt", "height_m", felt.height_m, "a finite number, or None")
        new = dt / (s.filter_s + dt)
        force, bend, across, along = np.zeros(n), np.zeros(n), np.zeros(n), np.full(n, np.nan)
        smooth, places, touches = list[Array | None](), list[float](), state.touches.copy()
        for i, (one, q, p, last) in enumerate(
            zip(self.fingers, felt.q, felt.pressure_pa, state.smooth, strict=True)
        ):
            if q is None:
                force[i] = bend[i] = across[i] = (state.level_pa[i] - s.touch_pa) / s.pa_per_n
                smooth.append(None)
                touches[i] |= state.level_pa[i] >= s.touch_pa
                continue
            row = np.concatenate([q, p])
            if not np.isfinite(row).all():
                raise ConfigError("felt", f"finger {i}", row.tolist(), "finite numbers")
            row = row if last is None else last + new * (row - last)
            smooth.append(row)
            feels = one.feel(row[: one.arm.n_q], row[one.arm.n_q :], felt.gravity)
            force[i], bend[i], along[i] = feels.squeeze_n, feels.bend_n, feels.along_n
            across[i] = feels.across_n + feels.doubt_n
            # A low-pass of white noise leaves this part of its deviation.
            noise = feels.noise_n * np.sqrt(new / (2.0 - new))
            touches[i] |= feels.bend_n > max(s.touch_n, s.noise_sigmas * noise)
            places.append(float(one.up @ feels.place_m))
        # Fingers that get longer take it down, and those that bend more do not lift it: it slips by the less.
        below = float(np.mean(places)) if places else 0.0
        seen = np.nan if felt.height_m is None else felt.height_m
        before = state.height_m[0] if np.isfinite(state.height_m[0]) else seen
        height = before + new * (seen - before) - np.array([0.0, below])
        mark, begin, sunk, slid = height, height, 0.0, 0.0
        is_as_before = [row is None for row in smooth] == [row is None for row in state.smooth]
        if is_as_before and np.isfinite([*height, *state.height_m]).all():
            mark, begin = np.clip(state.mark_m, height - s.still_m, height + s.still_m), state.begin_m
            sunk = max(state.sunk_m, float((begin - mark).min()))
            slid = sunk - state.sunk_m
        looks = state.phase in ("closing", "touching") and state.felt_s > _SETTLED * s.filter_s
        return replaced(
            state,
            smooth=tuple(smooth),
            force_n=force,
            along_n=along,
            touches=touches if looks else state.touches,
            bend_n=float(bend.mean()),
            height_m=height,
            mark_m=mark,
            begin_m=begin,
            sunk_m=sunk,
            slid_m=slid,
            still_s=0.0 if slid > 0.0 else state.still_s + dt,
            since_s=state.since_s + dt,
            felt_s=state.felt_s + dt,
            most_n=float(across.max()),
        )

    def _closing(self, state: SqueezeState, dt: float) -> SqueezeState:
        """Close each finger until it touches."""
        s = self.settings
        if state.touches.all():
            return _begin(state, "squeezing", begun_m=float(state.height_m[1]), bound="")
        if state.touches.any() and state.phase == "closing":
            state = _begin(state, "touching")
        waits = state.level_pa >= s.most_pa
        if (waits | state.touches).all():
            return _begin(state, "opening", cause="a finger has met nothing")
        level = np.where(state.touches, state.level_pa, state.level_pa + dt * s.close_pa_s)
        return self._limited(state, level, dt)

    def _squeezing(self, state: SqueezeState, dt: float) -> SqueezeState:
        """Raise all pressures together: fingers that each keep a force of their own push the object away."""
        s, mean = self.settings, float(state.force_n.mean())
        if self._bound(state) or mean >= _REACHED * state.goal_n:
            return _begin(state, "holding", held_n=state.bend_n)
        rate = np.clip((state.goal_n - mean) * s.pa_per_n / s.filter_s, -s.close_pa_s, s.close_pa_s)
        return self._limited(state, state.level_pa + dt * rate, dt)

    def _holding(self, state: SqueezeState, dt: float) -> SqueezeState:
        """Keep the pressures, and look for a slip; untracked, squeeze for what a lift takes away."""
        s, mean, keeps = self.settings, float(state.force_n.mean()), 1.0 - self.settings.slip_part
        if state.since_s <= _SETTLED * s.filter_s:
            seen = state.height_m
            state = replaced(
                state, held_n=state.bend_n, mark_m=seen, begin_m=seen, sunk_m=0.0, still_s=np.inf
            )
        elif self._slips(state):
            return _begin(state, "slipping", goal_n=min(max(mean, s.touch_n), s.limit_n))
        elif np.isnan(state.height_m[0]) and mean < keeps * state.goal_n and not self._bound(state):
            return _begin(state, "squeezing")
        return self._limited(state, state.level_pa, dt)

    def _slipping(self, state: SqueezeState, dt: float) -> SqueezeState:
        """Squeeze harder for as long as it slips: by a factor e for a length that it slips, or for a time."""
        s, mean = self.settings, float(state.force_n.mean())
        if state.since_s >= s.slip_s:
            # Fingers that meet each other feel a force, too.
            if state.force_n.max() < s.touch_n or state.height_m[1] < state.begun_m - s.gone_m:
                why = f", {state.bound} is too low to hold it" if state.bound else ""
                return _begin(state, "opening", cause=f"the object is gone{why}")
            if not self._slips(state):
                return _begin(state, "holding", held_n=state.bend_n)
        is_tracked = bool(np.isfinite(state.height_m[0]))
        rises = state.slid_m / s.slip_m if is_tracked else dt / s.blind_s
        goal = min(state.goal_n * np.exp(rises), s.limit_n)
        state = replaced(state, goal_n=goal, bound=self._bound(state) or state.bound)
        # The force is known late: one that holds the object is enough, whatever the goal has become.
        is_held = is_tracked and state.still_s > _SINKS * s.filter_s
        rate = np.clip((state.goal_n - mean) * s.pa_per_n / s.filter_s, 0.0, 0.0 if is_held else s.rise_pa_s)
        return self._limited(state, state.level_pa + dt * rate, dt)

    def _opening(self, state: SqueezeState, dt: float) -> SqueezeState:
        level = np.maximum(state.level_pa - dt * self.settings.close_pa_s, 0.0)
        state = replaced(state, level_pa=level)
        return state if level.any() else _begin(state, "open", touches=np.zeros_like(state.touches))

    def _slips(self, state: SqueezeState) -> bool:
        """Whether the object sinks, or, where nothing tracks it, fingers bend less under the same pressures.

        A load along the fingers changes their force, too, but no bend of fingers to which the object sticks.
        """
        s = self.settings
        if np.isfinite(state.height_m[0]):
            return state.still_s < s.slip_s
        return state.bend_n < (1.0 - s.slip_part) * state.held_n

    def _bound(self, state: SqueezeState) -> str:
        """What keeps the hand from squeezing harder; empty where nothing does."""
        if state.most_n >= self.settings.limit_n:
            return "the crush limit"
        return "the largest pressure" if state.level_pa.max() >= self.settings.most_pa else ""

    def _limited(self, state: SqueezeState, level: Array, dt: float) -> SqueezeState:
        """Return the state with these pressures; at the crush limit they only fall."""
        s = self.settings
        # The force is known late: towards the limit it rises slowly.
        room = (s.limit_n - state.most_n) * s.pa_per_n / (_APPROACH * s.filter_s)
        level = np.minimum(level, state.level_pa + dt * max(room, 0.0))
        if state.most_n >= s.limit_n:
            level = state.level_pa - (dt * s.close_pa_s if state.most_n > s.limit_n else 0.0)
        return replaced(state, level_pa=np.clip(level, 0.0, s.most_pa))


def _begin(state: SqueezeState, phase: Phase, **changes: object) -> SqueezeState:
    return replaced(state, phase=phase, since_s=0.0, **changes)
