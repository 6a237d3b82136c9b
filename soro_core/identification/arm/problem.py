"""The search for numbers: residuals of all cases, their derivatives, and what is known before any data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.errors import SoroError
from soro_core.identification.arm.cases import Case, Path
from soro_core.identification.arm.numbers import Number, is_of_robot, with_numbers
from soro_core.identification.arm.predict import difference
from soro_core.identification.arm.starts import is_of_run
from soro_core.identification.search import LOSSES, Search, Settings
from soro_core.model import SoftArm
from soro_core.model.discretised import discretised
from soro_core.robot import Discretisation, Robot

Array: TypeAlias = NDArray[np.float64]

# Step of the derivatives, in deviations of the prior: above the round-off of a simulation.
_STEP = 1e-4


def modelled(robot: Robot, is_constant: bool) -> SoftArm:
    """Return the arm that is simulated.

    A link of constant curvature swings as if it were stiffer by half than one that bends as it likes (first
    bending of a cantilever: 20 against 12.4 E I / m L^3), so what its frequency tells about its stiffness is
    wrong by as much. A linear strain is right to 1 %; where hysteresis forbids it, three pieces serve.
    """
    if is_constant:
        return SoftArm(robot)
    by_pieces = any(link.hysteresis for link in robot.links)
    shape = Discretisation(links=3) if by_pieces else Discretisation(basis="legendre", order=1)
    return discretised(robot, shape)


@dataclass(frozen=True)
class Problem:
    """Measured cases, and the numbers that are searched.

    Attributes
    ----------
    robot : Robot
        Holds what is not searched.
    cases : tuple of Case
    numbers : tuple of Number
        Searched; `value` is the most likely value before any data, `doubt` the deviation from it. Names that
        begin with ``frame/`` belong to the measurement, those with ``run/`` to one run, others to the robot.
    expected : mapping of str to array
        Expected error of each column of a shape's difference, by its name: a row counts less beyond it.
    fixed : mapping of str to float
        Numbers of the robot that are not searched and differ from it.
    is_constant : bool
        Whether strains are simulated as constant along a link.
    """

    robot: Robot
    cases: tuple[Case, ...]
    numbers: tuple[Number, ...]
    expected: Mapping[str, Array]
    fixed: Mapping[str, float] = field(default_factory=dict)
    is_constant: bool = True

    def value(self, x: Array) -> dict[str, float]:
        """Return the numbers at `x` (n,), in deviations of the prior from its middle."""
        return {
            n.name: n.value * float(np.exp(v * n.doubt))
            if n.kind == "factor"
            else n.value + float(v) * n.doubt
            for n, v in zip(self.numbers, x, strict=True)
        }

    def position(self, values: Mapping[str, float]) -> Array:
        """Return `x` of values; the middle of the prior for a number that is not given."""
        return np.array(
            [
                (np.log(values[n.name] / n.value) if n.kind == "factor" else values[n.name] - n.value)
                / n.doubt
                if n.name in values
                else 0.0
                for n in self.numbers
            ]
        )

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Bounds of `x`."""
        low = self.position({n.name: n.lower for n in self.numbers})
        return low, self.position({n.name: n.upper for n in self.numbers})

    def arm(self, values: Mapping[str, float]) -> SoftArm:
        """Return the arm with the robot's share of the numbers."""
        return modelled(self.robot_of(values), self.is_constant)

    def robot_of(self, values: Mapping[str, float]) -> Robot:
        """Return the robot with its share of the numbers, and those that are fixed."""
        own = {name: v for name, v in values.items() if is_of_robot(name)}
        return with_numbers(self.robot, {**self.fixed, **own})

    def paths(self, arm: SoftArm, values: Mapping[str, float]) -> list[Path]:
        """Return the motion of an arm in each case."""
        return [case.simulated(arm, values) for case in self.cases]

    def differences(
        self, arm: SoftArm, paths: Sequence[Path], values: Mapping[str, float]
    ) -> list[list[Array]]:
        """Return measured minus predicted of each shape of each case.

        Parameters
        ----------
        arm : SoftArm
        paths : sequence of Path
            Its motion in each case.
        values : mapping of str to float
            Numbers, those of the frames among them.
        """
        return [
            [
                difference(shape, arm, q, values)
                for q, shape in zip(case.coordinates(path, values), case.shapes, strict=True)
            ]
            for path, case in zip(paths, self.cases, strict=True)
        ]

    def predicted(self, values: Mapping[str, float]) -> list[list[Array]]:
        """Return measured minus predicted of each shape of each case, for given numbers."""
        arm = self.arm(values)
        return self.differences(arm, self.paths(arm, values), values)

    def rows(self, arm: SoftArm, paths: Sequence[Path], values: Mapping[str, float]) -> Array:
        """Return all differences in expected errors, one long row.

        Parameters
        ----------
        arm : SoftArm
        paths : sequence of Path
            Its motion in each case.
        values : mapping of str to float
            Numbers, those of the frames among them.
        """
        parts = [
            (d / self.expected[shape.name]).ravel()
            for case, own in zip(self.cases, self.differences(arm, paths, values), strict=True)
            for shape, d in zip(case.shapes, own, strict=True)
        ]
        return np.concatenate(parts)

    def cost(self, values: Mapping[str, float]) -> float:
        """Return half the sum of the soft losses and of the squares of the prior; inf where no arm is so."""
        try:
            arm = self.arm(values)
            rows = self.rows(arm, self.paths(arm, values), values)
        except SoroError:
            return np.inf
        x, loss = self.position(values), LOSSES[Settings().loss][0]
        return 0.5 * float(loss(rows**2).sum() + x @ x) if np.isfinite(rows).all() else np.inf


@dataclass(frozen=True)
class Solution:
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
) -> Solution:
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
        Called with the cost after each step that is tried.

    Raises
    ------
    SoroError
        If the start cannot be simulated.
    """
    low, high = problem.bounds
    x0 = np.clip(problem.position(start or {}), low + 1e-9, high - 1e-9)
    return _searched(problem, x0, Settings(most=most, tolerance=tolerance), progress)


def evaluated(problem: Problem, values: Mapping[str, float]) -> Solution:
    """Return the solution that given numbers are, without a search."""
    return _searched(problem, np.clip(problem.position(values), *problem.bounds), None)


def _searched(
    problem: Problem,
    x0: Array,
    settings: Settings | None,
    progress: Callable[[float], None] = lambda cost: None,
) -> Solution:
    rows = _Rows(problem)
    chosen = replace(settings or Settings(), step=_STEP, squares=len(x0), scale=1.0, workers=None)
    search = Search(rows.at, x0, rows.first(x0), problem.bounds, chosen, progress, rows.beside)
    found = search.run() if settings else search.here()
    own = slice(0, len(found.residuals) - len(x0))
    return Solution(
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
    """An arm and its motion in each case, with the numbers of robot and run that they belong to."""

    robot: bytes
    arm: SoftArm
    runs: tuple[bytes, ...]
    paths: tuple[Path, ...]


class _Rows:
    """Rows of candidates, with those of the prior. What a number does not change is not simulated anew."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        names = [n.name for n in problem.numbers]
        self._robot = np.array([is_of_robot(name) for name in names], bool)
        self._runs = [np.array([is_of_run(name, case.name) for name in names]) for case in problem.cases]
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
        robot, runs = x[self._robot].tobytes(), tuple(x[own].tobytes() for own in self._runs)
        last = self._last if self._last is not None and self._last.robot == robot else None
        arm = self._problem.arm(values) if last is None else last.arm
        paths = [
            case.simulated(arm, values) if last is None or last.runs[k] != runs[k] else last.paths[k]
            for k, case in enumerate(self._problem.cases)
        ]
        return _Motion(robot, arm, runs, tuple(paths))

    def _of(self, x: Array, motion: _Motion) -> Array:
        return np.concatenate([self._problem.rows(motion.arm, motion.paths, self._problem.value(x)), x])
