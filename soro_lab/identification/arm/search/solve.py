"""Searches for the numbers of a problem; what a number does not change is not computed anew."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import SoroError
from soro_core.jobs import given_or_threads
from soro_core.model import SoftArm
from soro_lab.identification.arm.cases.case import ArmMotion, clock
from soro_lab.identification.arm.cases.initial_conditions import is_of_run
from soro_lab.identification.arm.cases.parameters import is_of_robot
from soro_lab.identification.arm.search.problem import Problem, Shown, seen_in
from soro_lab.identification.search import Search, SearchSettings

# Step of the derivatives, in deviations of the prior: above the round-off of a simulation.
_STEP = 1e-4


@dataclass(frozen=True)
class FitSolution:
    """Outcome of `solve`.

    Attributes
    ----------
    values : dict
        Each number.
    x : (n,)
        The same in deviations of the prior.
    rows, jacobian : (m,), (m, n)
        Residuals of the data there, and their derivatives by `x`.
    cost : float
        Half the sum of the soft losses and of the squares of `x`.
    converged : bool
        Whether the search ended by itself.
    interrupted : bool
        Whether Ctrl-C ended it: then these are the best numbers until there.
    """

    values: dict[str, float]
    x: Array
    rows: Array
    jacobian: Array
    cost: float
    converged: bool
    interrupted: bool = False


def solve(
    problem: Problem,
    start: Mapping[str, float] | None = None,
    most: int = 30,
    tolerance: float = 1e-5,
    progress: Callable[[float], None] = lambda cost: None,
    secant: bool = False,
) -> FitSolution:
    """Find the most likely numbers: soft least squares over all rows, and the prior.

    Parameters
    ----------
    problem : Problem
    start : mapping, optional
        Values to start from; default the middle of the prior.
    most : int
        Largest number of steps.
    tolerance : float
        Relative change of the cost, or of the numbers, at which the search ends.
    progress : callable
        Called with the least cost so far after each simulation of all cases.
    secant : bool
        Take derivatives once (`SearchSettings.secant`).

    Raises
    ------
    SoroError
        If the start cannot be simulated.
    """
    low, high = problem.bounds
    x0 = np.clip(problem.position(start or {}), low + 1e-9, high - 1e-9)
    settings = SearchSettings(most=most, tolerance=tolerance, secant=secant)
    return _searched(problem, x0, settings, progress)


def evaluated(problem: Problem, values: Mapping[str, float]) -> FitSolution:
    """Return the solution that given numbers are, without a search."""
    return _searched(problem, np.clip(problem.position(values), *problem.bounds), None)


def _searched(
    problem: Problem,
    x0: Array,
    settings: SearchSettings | None,
    progress: Callable[[float], None] = lambda cost: None,
) -> FitSolution:
    rows = _Rows(problem)
    with given_or_threads(problem.executor) as used:
        chosen = replace(settings or SearchSettings(), step=_STEP, squares=len(x0), scale=1.0, executor=used)
        search = Search(rows.at, x0, rows.first(x0), problem.bounds, chosen, progress, rows.beside)
        found = search.run() if settings else search.here()
    own = slice(0, len(found.residuals) - len(x0))
    return FitSolution(
        problem.value(found.x),
        found.x,
        found.residuals[own],
        found.jacobian[own],
        found.cost,
        found.converged,
        found.interrupted,
    )


@dataclass(frozen=True)
class _Motion:
    """What an arm does in each case, with the numbers that it follows from.

    Attributes
    ----------
    robot : bytes
        Those of the robot.
    arm : SoftArm
    runs, clocks : tuple of bytes
        Of each case, those of its run, and of when its samples were taken.
    paths : tuple of ArmMotion
    does : list of lists of arrays
        Of `Problem.predict`.
    """

    robot: bytes
    arm: SoftArm
    runs: tuple[bytes, ...]
    clocks: tuple[bytes, ...]
    paths: tuple[ArmMotion, ...]
    does: Shown


class _Rows:
    """Rows of candidates, with those of the prior. What a number does not change is not computed anew."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        names, cases = [n.name for n in problem.numbers], problem.cases
        self._robot = np.array([is_of_robot(name) for name in names], bool)
        self._runs = [np.array([is_of_run(name, case.name) for name in names]) for case in cases]
        self._clocks = [np.array([name == clock(case.name) for name in names]) for case in cases]
        self._last: _Motion | None = None

    def first(self, x: Array) -> Array:
        """Return the rows at the start; raises where they do not exist."""
        self._last = self._motion(x)
        return self._of(x, self._last)

    def at(self, x: Array) -> Array | None:
        """Return the rows at `x`; None where no arm has those numbers, or it cannot be simulated."""
        return self._tried(x, keep=True)

    def beside(self, x: Array) -> Array | None:
        """Return the same, and keep the motion of the latest candidate."""
        return self._tried(x, keep=False)

    def _tried(self, x: Array, keep: bool) -> Array | None:
        try:
            motion = self._motion(x)
            rows = self._of(x, motion)
        except SoroError:
            return None
        if keep:
            self._last = motion
        return rows if np.isfinite(rows).all() else None

    def _motion(self, x: Array) -> _Motion:
        values = self._problem.value(x)
        robot = x[self._robot].tobytes()
        runs, clocks = (tuple(x[own].tobytes() for own in each) for each in (self._runs, self._clocks))
        last = self._last if self._last is not None and self._last.robot == robot else None
        arm = self._problem.arm(values) if last is None else last.arm
        paths, does = [], []
        for k, case in enumerate(self._problem.cases):
            kept = last if last is not None and last.runs[k] == runs[k] else None
            paths.append(case.simulated(arm, values) if kept is None else kept.paths[k])
            if kept is not None and kept.clocks[k] == clocks[k]:
                does.append(kept.does[k])
            else:
                does.append(seen_in(case, self._problem.robot, arm, paths[k], values))
        return _Motion(robot, arm, runs, clocks, tuple(paths), does)

    def _of(self, x: Array, motion: _Motion) -> Array:
        return np.concatenate([self._problem.rows(motion.does, self._problem.value(x)), x])
