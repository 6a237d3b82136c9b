"""The leak of a closed chamber: when it begins, which law it follows, and the error on what no fit has seen.

A chamber keeps the pressure of its supply until it is closed: that part of a recording is no leak. The law is
chosen within the first half of the recording, by its error on the last third of that half; the second half
judges the law that was chosen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soro_core.arrays import Array
from soro_core.errors import ConfigError
from soro_core.pneumatics.chamber import AMBIENT_PA, GAS_CONSTANT
from soro_core.pneumatics.flow import REFERENCE_DENSITY
from soro_lab.identification.candidates import Values
from soro_lab.identification.fit import Fit, Parameter, fit
from soro_lab.identification.regulators.leak_laws import LAWS, LeakLaw, fall

# A chamber is closed when its pressure has left the level of its first second by this part of it, if all the
# fall that follows is larger by _LARGER; else it leaks from the first sample on.
_LEFT, _LARGER, _LEVEL_S = 0.01, 5.0, 1.0
# Part of a fit by which laws are compared, and how much less the error of a law with more parameters must be.
_INNER, _BETTER = 2.0 / 3.0, 0.9
# Fewest samples, and least gauge pressure at the start.
_SAMPLES, _LEAST_PA = 20, 1e3
# Temperature of the air outside [K], as in `ValveModel`.
_TEMPERATURE_K = 293.15


@dataclass(frozen=True)
class LeakRun:
    """A closed chamber.

    Attributes
    ----------
    run, line : str
        Names of the recording and of the chamber.
    t, pressure : arrays of shape (n,)
        Times [s], rising, and gauge pressures [Pa].
    """

    run: str
    line: str
    t: Array
    pressure: Array


@dataclass(frozen=True)
class FoundLeak:
    """The leak of one chamber.

    Attributes
    ----------
    run : LeakRun
        The recording.
    closed_s : float
        Time at which it was closed [s].
    law : LeakLaw
        The law that was chosen.
    fit : Fit
        Of all data: the parameters of the law, and `start_pa`.
    errors : dict
        RMS error of each law on the second half, fitted to the first, over the pressure at the start.
    hole : Fit
        Of the law of a hole, which a valve of a twin has.
    """

    run: LeakRun
    closed_s: float
    law: LeakLaw
    fit: Fit
    errors: dict[str, float]
    hole: Fit

    @property
    def error(self) -> float:
        """RMS error of the chosen law on the second half, over the pressure at the start."""
        return self.errors[self.law.name]

    @property
    def is_physical(self) -> bool:
        """Whether air leaves the chamber; a rate below 0 by more than its deviation creates air."""
        return self.fit.values["rate_1_s"] >= -self.fit.deviations["rate_1_s"]

    def conductance(self, volume_m3: float) -> tuple[float, float]:
        """Return value and deviation of the sonic conductance of the hole [m^3/(s Pa)] for a volume [m^3]."""
        # At 1 bar gauge the hole passes C 1.185 P psi, and the chamber has V p / (R T) of air.
        inside = 2.0 * AMBIENT_PA
        part = (0.5 - 0.35) / (1.0 - 0.35)
        per_rate = AMBIENT_PA * volume_m3 / (GAS_CONSTANT * _TEMPERATURE_K)
        unit = per_rate / (REFERENCE_DENSITY * inside * float(np.sqrt(1.0 - part * part)))
        return unit * self.hole.values["rate_1_s"], unit * self.hole.deviations["rate_1_s"]


def find_leak(run: LeakRun) -> FoundLeak:
    """Find the law of a leak.

    Raises
    ------
    ConfigError
        If there are too few samples, or the chamber is empty at the start.
    """
    begin = _closed(run)
    t, pressure = run.t[begin:], run.pressure[begin:]
    middle = 0.5 * (run.t[0] + run.t[-1])
    first = t < middle
    if first.sum() < _SAMPLES or (~first).sum() < _SAMPLES:
        got = f"{len(t)} readings of {run.line} after it was closed"
        raise ConfigError(run.run, run.line, got, f"{_SAMPLES} or more in each half of the recording")
    if not pressure[0] > _LEAST_PA:
        text = f"{pressure[0]:.0f} Pa when it is closed"
        raise ConfigError(run.run, run.line, text, f"a chamber filled to more than {_LEAST_PA:.0f} Pa")
    inner = t < t[0] + _INNER * (middle - t[0])
    judge = first & ~inner
    if inner.sum() < _SAMPLES or not judge.any():
        raise ConfigError(run.run, run.line, f"{int(first.sum())} readings", "a longer recording")
    own: dict[str, float] = {}
    errors: dict[str, float] = {}
    for law in LAWS:
        own[law.name] = _error(law, fit_leak(law, t[inner], pressure[inner]), t, pressure, judge)
        errors[law.name] = _error(law, fit_leak(law, t[first], pressure[first]), t, pressure, ~first)
    chosen = _choose(own)
    whole = fit_leak(chosen, t, pressure)
    hole = fit_leak(next(law for law in LAWS if law.name == "hole"), t, pressure)
    return FoundLeak(run, float(t[0]), chosen, whole, errors, hole)


def fit_leak(law: LeakLaw, t: Array, pressure: Array) -> Fit:
    """Fit the parameters of a law and the pressure at the start.

    Parameters
    ----------
    law : LeakLaw
    t, pressure : ndarray (n,)
        Times [s], the first one that of the start, and gauge pressures [Pa].
    """
    level = float(pressure[0])
    end = max(float(np.median(pressure[-10:])), 1e-3 * level)
    speed = max(np.log(level / end) / (t[-1] - t[0]), 1e-7)
    unknown = [
        Parameter("rate_1_s", speed, -100.0, 100.0),
        Parameter("start_pa", level, 0.5 * level, 2.0 * level),
    ]
    unknown += [Parameter(name, 0.3, 0.0, 100.0) for name in law.parameters[1:]]
    noise = max(float(np.median(np.abs(np.diff(pressure)))), 1e-4 * level)

    def residuals(values: Values) -> Array:
        return (_fall(law, values, t) - pressure) / noise

    return fit(unknown, residuals, max_iterations=100)


def _fall(law: LeakLaw, values: Values, t: Array) -> Array:
    return fall(law, tuple(values[name] for name in law.parameters), values["start_pa"], t)


def _error(law: LeakLaw, found: Fit, t: Array, pressure: Array, rows: NDArray[np.bool_]) -> float:
    left = (_fall(law, found.values, t) - pressure)[rows]
    return float(np.sqrt(np.mean(left**2)) / pressure[0])


def _choose(own: dict[str, float]) -> LeakLaw:
    """Return the law with the least error, unless one with fewer parameters comes close."""
    least = {n: min(own[law.name] for law in LAWS if len(law.parameters) == n) for n in (1, 2)}
    number = 2 if least[2] < _BETTER * least[1] else 1
    return min((law for law in LAWS if len(law.parameters) == number), key=lambda law: own[law.name])


def _closed(run: LeakRun) -> int:
    """Return the first row at which the chamber is closed."""
    level = float(np.median(run.pressure[run.t <= run.t[0] + _LEVEL_S]))
    left = np.flatnonzero(run.pressure < (1.0 - _LEFT) * level)
    whole = level - float(np.min(run.pressure))
    if not left.size or whole < _LARGER * _LEFT * level:
        return 0
    # A leak that has its full speed at the first sample leaves the level at once.
    first = int(left[0])
    later = np.searchsorted(run.t, 2.0 * run.t[first] - run.t[0])
    steady = level - float(run.pressure[min(int(later), len(run.t) - 1)]) < 3.0 * _LEFT * level
    return 0 if steady else first


def leak_text(found: Sequence[FoundLeak]) -> list[str]:
    """Return a line of each chamber: the law, its parameters, and errors of all laws."""
    lines = []
    for one in found:
        values = ", ".join(
            f"{name} {one.fit.values[name]:.4g} +- {one.fit.deviations[name]:.2g}"
            for name in one.law.parameters
        )
        errors = ", ".join(f"{name} {100 * error:.2f} %" for name, error in one.errors.items())
        lines.append(
            f"{one.run.run} {one.run.line}: closed at {one.closed_s:.2f} s; {one.law.name}: {values}"
        )
        lines.append(f"  second half, RMS error over the pressure at the start: {errors}")
    return lines
