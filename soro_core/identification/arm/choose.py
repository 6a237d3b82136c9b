"""Which laws an arm needs: found by runs that no fit has seen, the simplest within one standard error."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from soro_core.identification.arm.laws import Law


@dataclass(frozen=True)
class Trial:
    """One set of laws, fitted without the held-out sections and judged on them.

    Attributes
    ----------
    laws : tuple of Law
    squares : tuple of float
        Mean square error of each held-out stretch, in ranges moved.
    values : dict
        The numbers that were found.
    interrupted : bool
        Whether Ctrl-C ended the fit.
    """

    laws: tuple[Law, ...]
    squares: tuple[float, ...]
    values: dict[str, float]
    interrupted: bool = False

    @property
    def error(self) -> float:
        """RMS error on the held-out sections, in ranges moved."""
        return float(np.sqrt(np.mean(self.squares)))

    @property
    def name(self) -> str:
        """Names of the laws."""
        return " + ".join(law.name for law in self.laws) or "linear"


@dataclass(frozen=True)
class Choice:
    """The laws that were chosen, and all that were tried, in order."""

    chosen: Trial
    tried: tuple[Trial, ...]


def choose(
    laws: Sequence[Law], fit: Callable[[tuple[Law, ...], Mapping[str, float]], Trial | None]
) -> Choice:
    """Add one law after the other, as long as held-out sections gain; then take the simplest that is as good.

    Parameters
    ----------
    laws : sequence of Law
        Those that may be added.
    fit : callable
        Fits a set of laws from given values; None where no such arm can be simulated.

    Returns
    -------
    Choice
        `chosen` has the fewest laws of all sets whose held-out error is within one standard error of the
        best; the standard error is that of the difference over the sections.
    """
    first = fit((), {})
    if first is None:
        raise ValueError("the linear law cannot be fitted: it is the start of every other")
    tried, best = [first], first
    while not first.interrupted:
        found: list[Trial] = []
        for law in (law for law in laws if law not in best.laws):
            trial = fit((*best.laws, law), best.values)
            found += [trial] if trial is not None else []
            if trial is not None and trial.interrupted:
                return Choice(best, (*tried, *found))
        tried += found
        if not found or min(t.error for t in found) >= best.error:
            break
        best = min(found, key=lambda t: t.error)
    near = [t for t in tried if np.mean(t.squares) <= np.mean(best.squares) + _standard_error(t, best)]
    chosen = min(near, key=lambda t: (len(t.laws), t.error))
    return Choice(chosen, tuple(tried))


def _standard_error(trial: Trial, best: Trial) -> float:
    """Standard error of the mean difference of the squares over the stretches; 0 where there is one."""
    apart = np.subtract(trial.squares, best.squares)
    return float(apart.std(ddof=1) / np.sqrt(len(apart))) if len(apart) > 1 else 0.0
