"""Findings of the probe: what was seen, the causes that look alike, and the step to take."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from soro_core.arrays import Array
from soro_core.control.probing.wiring import HeldState, WiringFit, WiringModel

STOP: Literal["stop"] = "stop"
FAIL: Literal["fail"] = "fail"
WARN: Literal["warn"] = "warn"

# How much worse the wiring of the file must be than another one: by so much, and by this factor.
_WORSE, _BETTER = 25.0, 3.0
# Largest residual of the wiring of the file, as a part of the motions, where it is not within their errors.
_MOST_RESIDUAL = 0.4
# The same of the best wiring, from which on something else moves the arm in a run.
_HELD_RESIDUAL = 0.3
# Gains by their link's mean that are no longer that of the file: warning, failure; and deviations.
_GAIN_WARN, _GAIN_FAIL, _DEVIATIONS = 0.15, 0.25, 3.0
# Tilts [deg]: warning, failure.
_TILT_WARN, _TILT_FAIL = 3.5, 10.0
# Deviation of gains beside a tilt, by its size [1/rad]: three of it are the largest error seen.
_BY_TILT = 0.5


@dataclass(frozen=True)
class ProbeFinding:
    """One finding.

    Attributes
    ----------
    level : {"stop", "fail", "warn"}
        stop: the probe had to end before its end.
    found : str
        What was seen.
    step : str
        What to do.
    causes : tuple of str
        What looks alike.
    """

    level: Literal["stop", "fail", "warn"]
    found: str
    step: str
    causes: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """What was seen, and what looks alike."""
        return self.found + (f" ({', or '.join(self.causes)})" if self.causes else "")

    def __str__(self) -> str:
        return f"probe: {self.text}; {self.step}"


class RelativeGains(NamedTuple):
    """Gains (n_u,) relative to the mean of their link, 0 where all are alike, and deviations (n_u,)."""

    gain: Array
    deviation: Array


def judge_answers(
    model: WiringModel,
    names: Sequence[str],
    states: Sequence[HeldState],
    between: Callable[[], None] = lambda: None,
    whole_run: bool = False,
) -> tuple[list[ProbeFinding], RelativeGains | None]:
    """Return what the answers of the arm say, and the gains of its chambers; None where they cannot be told.

    Parameters
    ----------
    model : WiringModel
    names : sequence of str
        Chambers.
    states : sequence of HeldState
        At rest, and with each chamber alone.
    between : callable
        Called again and again.
    whole_run : bool
        Whether the states are those of a run under control: its load may change, something may hold the arm,
        and gains can be told beside a tilt.
    """
    fits = model.fits(states, between, same_load=whole_run)
    own = next(one for one in fits if one.wiring == tuple(range(len(names))) and not one.changed_kg)
    best = fits[0]
    if whole_run and best.residual_part > _HELD_RESIDUAL:
        return [], None
    if own.cost - best.cost > _WORSE and best.cost < own.cost / _BETTER:
        return [_changed(best) if best.changed_kg else _wiring(names, best)], None
    if own.cost > _WORSE and own.residual_part > _MOST_RESIDUAL:
        text = "the arm answers in directions that no wiring of the chambers explains"
        causes = ("a turned frame of the pose sensor or base_quaternion", "a robot file of another arm")
        return [ProbeFinding(FAIL, text, "compare frames and robot file with the arm", causes)], None
    if whole_run:
        # What looks like a small tilt may be creep.
        tilted = [one for one in _tilt(own) if one.level == FAIL]
        return sorted(_gains(model, names, own) + tilted, key=lambda one: one.level != FAIL), None
    # Beside a tilt no chamber is named.
    return _tilt(own) or _gains(model, names, own), _relative(model, own)


def _wiring(names: Sequence[str], fit: WiringFit) -> ProbeFinding:
    moved = [f"{names[k]} acts as {names[n]}" for k, n in enumerate(fit.wiring) if k != n]
    text = f"chambers are {'swapped' if len(moved) == 2 else 'rotated'}: {', '.join(moved)}"
    causes: tuple[str, ...] = ("tubes", "the order of valves in the platform file")
    if len(moved) > 2:
        causes = (*causes, "a frame of the pose sensor or a base_quaternion turned about the arm's axis")
    return ProbeFinding(FAIL, text, "swap the tubes, or correct the file", causes)


def _changed(fit: WiringFit) -> ProbeFinding:
    text = f"the load has changed by {1e3 * fit.changed_kg:+.0f} g while the probe ran"
    causes = ("a hand or an obstacle that held the arm",)
    return ProbeFinding(FAIL, text, "leave the load as it is until the law has begun", causes)


def _tilt(fit: WiringFit) -> list[ProbeFinding]:
    tilt_deg = math.degrees(float(np.linalg.norm(fit.tilt)))
    if tilt_deg < _TILT_WARN or tilt_deg < _DEVIATIONS * math.degrees(fit.tilt_std):
        return []
    level = FAIL if tilt_deg >= _TILT_FAIL else WARN
    x, y = np.degrees(fit.tilt)
    text = f"the arm stands as if its base were tilted by {tilt_deg:.0f} degrees"
    text += f" ({x:.0f} about its x axis, {y:.0f} about y)"
    causes = ("a natural bend", "a shifted or turned marker")
    return [ProbeFinding(level, text, "level the base, or state base_quaternion or the rest shape", causes)]


def _relative(model: WiringModel, fit: WiringFit) -> RelativeGains:
    """Return the gains relative to the mean of their link."""
    mean = np.zeros((fit.gain.size, fit.gain.size))
    for link in model.links:
        mean[np.ix_(link, link)] = 1.0 / len(link)
    of_link = mean @ fit.gain
    by_gain = np.diag(1.0 / of_link) - (fit.gain / of_link**2)[:, None] * mean
    variance = np.diag(by_gain @ fit.gain_covariance @ by_gain.T)
    by_tilt = _BY_TILT * np.linalg.norm(fit.tilt)
    return RelativeGains(fit.gain / of_link - 1.0, np.sqrt(np.maximum(variance, 0.0) + by_tilt**2))


def _gains(model: WiringModel, names: Sequence[str], fit: WiringFit) -> list[ProbeFinding]:
    """Return a finding for each chamber that differs from the others of its link."""
    found = []
    for link in model.links:
        if len(link) < 2:
            continue
        for k in link:
            others = [n for n in link if n != k]
            mean = float(np.mean(fit.gain[others]))
            row = np.zeros(len(names))
            row[k], row[others] = 1.0 / mean, -fit.gain[k] / mean**2 / len(others)
            std = float(np.sqrt(row @ fit.gain_covariance @ row))
            away = fit.gain[k] / mean - 1.0
            if abs(away) > max(_GAIN_WARN, _DEVIATIONS * std):
                found.append((abs(away), k, away))
    if not found:
        return []
    # One weak chamber makes the others of its link look strong.
    size, k, away = max(found)
    level = FAIL if size > _GAIN_FAIL else WARN
    text = (
        f"{names[k]} gives {1.0 + away:.2f} of the force that the others of its link give by the robot file"
    )
    causes = ("a leak or a kinked line", "another chamber than in the file") if away < 0.0 else ()
    return [ProbeFinding(level, text, "look at this chamber, or identify the arm again", causes)]
