"""Which laws an arm needs: found by runs that no fit has seen, the simplest that is as good as the best."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from soro_lab.identification.arm.laws import LawTerm

# Part of the error that the best of all laws must take away by a few steps, for a full search of the best
# ones; and how many these are.
_PROMISE, _FULL = 0.005, 2
# A law takes away at least so much of the error. Over many stretches one standard error is less than what
# the steps of a simulation or the shape of a bend leave, and any law that is free takes some of that.
_WORTH = 0.03


@dataclass(frozen=True)
class Trial:
    """One set of laws, fitted without the held-out sections and judged on them.

    Attributes
    ----------
    laws : tuple of LawTerm
    squares : tuple of float
        Mean square error of each held-out stretch, in ranges moved.
    values : dict
        The numbers that were found.
    interrupted : bool
        Whether Ctrl-C ended the fit.
    cost : float
        Of the fit.
    """

    laws: tuple[LawTerm, ...]
    squares: tuple[float, ...]
    values: dict[str, float]
    interrupted: bool = False
    cost: float = 0.0

    @property
    def error(self) -> float:
        """RMS error on the held-out sections, in ranges moved."""
        return float(np.sqrt(np.mean(self.squares)))

    @property
    def name(self) -> str:
        """Names of the laws."""
        return " + ".join(law.name for law in self.laws) or "linear"


@dataclass(frozen=True)
class LawChoice:
    """The laws that were chosen, all that were tried, in order, and whether Ctrl-C ended it."""

    chosen: Trial
    tried: tuple[Trial, ...]
    interrupted: bool = False


Laws: TypeAlias = tuple[LawTerm, ...]
Fit: TypeAlias = Callable[[Laws, Mapping[str, float], bool], Trial | None]
FitMany: TypeAlias = Callable[[Sequence[Laws], Mapping[str, float]], Iterator[Trial | None]]


def choose(laws: Sequence[LawTerm], fit: Fit, fit_many: FitMany | None = None) -> LawChoice:
    """Add laws as long as each takes away 3 % of the held-out error; then take the simplest set.

    Every law that is left is tried by a few steps of the search; those that promise most, by more.

    Parameters
    ----------
    laws : sequence of LawTerm
        Those that may be added.
    fit : callable
        Fits a set of laws from given values, in full or by a few steps; None where no such arm can be
        simulated.
    fit_many : callable, optional
        Fits several sets by a few steps, beside each other, and yields them in their order; default one after
        the other.

    Returns
    -------
    LawChoice
        `chosen` has the fewest laws of all sets whose held-out error is within one standard error of the
        best, or within 3 %; the standard error is that of the difference over the sections.
    """
    first = fit((), {}, True)
    if first is None:
        raise ValueError("the linear law cannot be fitted: it is the start of every other")
    tried, best = [first], first
    if fit_many is None:
        fit_many = lambda sets, start: (fit(one, start, False) for one in sets)  # noqa: E731
    while not first.interrupted:
        found: list[Trial] = []
        left = [(*best.laws, law) for law in laws if law not in best.laws]
        try:
            for trial in fit_many(left, best.values):
                found += [trial] if trial is not None else []
                if trial is not None and trial.interrupted:
                    raise KeyboardInterrupt
        except KeyboardInterrupt:
            return LawChoice(best, (*tried, *found), True)
        found.sort(key=lambda t: t.error)
        if found and found[0].error < (1.0 - _PROMISE) * best.error:
            for k, trial in enumerate(found[:_FULL]):
                longer = fit(trial.laws, trial.values, True)
                found[k] = trial if longer is None else longer
                if found[k].interrupted:
                    return LawChoice(best, (*tried, *found), True)
        tried += found
        before, best = best, min((best, *found), key=lambda t: t.error)
        if best.error >= (1.0 - _WORTH) * before.error:
            break
    near = [t for t in tried if _is_as_good(t, best)]
    chosen = min(near, key=lambda t: (len(t.laws), t.error))
    return LawChoice(chosen, tuple(tried), first.interrupted)


def _is_as_good(trial: Trial, best: Trial) -> bool:
    """Whether a set of laws predicts as the best one does."""
    within = np.mean(trial.squares) <= np.mean(best.squares) + _standard_error(trial, best)
    return bool(within) or (1.0 - _WORTH) * trial.error <= best.error


def _standard_error(trial: Trial, best: Trial) -> float:
    """Standard error of the mean difference of the squares over the stretches; 0 where there is one."""
    apart = np.subtract(trial.squares, best.squares)
    return float(apart.std(ddof=1) / np.sqrt(len(apart))) if len(apart) > 1 else 0.0
