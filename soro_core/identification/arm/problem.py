"""The search for numbers: residuals of all cases, their derivatives, and what is known before any data."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from soro_core.errors import SoroError
from soro_core.identification.arm.cases import Case
from soro_core.identification.arm.numbers import Number, with_numbers
from soro_core.identification.arm.predict import difference
from soro_core.model import SoftArm
from soro_core.robot import Robot

Array: TypeAlias = NDArray[np.float64]
Coordinates: TypeAlias = list[list[Array]]

# Step of the derivatives, in deviations of the prior: above the round-off of a simulation.
_STEP = 1e-4


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
        begin with ``frame/`` belong to the measurement, all others to the robot.
    expected : mapping of str to array
        Expected error of each column of a shape's difference, by its name: a row counts less beyond it.
    fixed : mapping of str to float
        Numbers of the robot that are not searched and differ from it.
    """

    robot: Robot
    cases: tuple[Case, ...]
    numbers: tuple[Number, ...]
    expected: Mapping[str, Array]
    fixed: Mapping[str, float] = field(default_factory=dict)

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
        return SoftArm(self.robot_of(values))

    def robot_of(self, values: Mapping[str, float]) -> Robot:
        """Return the robot with its share of the numbers, and those that are fixed."""
        own = {name: v for name, v in values.items() if not name.startswith("frame/")}
        return with_numbers(self.robot, {**self.fixed, **own})

    def coordinates(self, arm: SoftArm) -> Coordinates:
        """Return the coordinates of each shape of each case."""
        return [case.coordinates(arm) for case in self.cases]

    def differences(self, arm: SoftArm, found: Coordinates, values: Mapping[str, float]) -> list[list[Array]]:
        """Return measured minus predicted of each shape of each case.

        Parameters
        ----------
        arm : SoftArm
        found : list of lists of (n, n_q)
            Coordinates of each shape of each case.
        values : mapping of str to float
            Numbers, those of the frames among them.
        """
        return [
            [difference(shape, arm, q, values) for q, shape in zip(own, case.shapes, strict=True)]
            for own, case in zip(found, self.cases, strict=True)
        ]

    def predicted(self, values: Mapping[str, float]) -> list[list[Array]]:
        """Return measured minus predicted of each shape of each case, for given numbers."""
        arm = self.arm(values)
        return self.differences(arm, self.coordinates(arm), values)

    def rows(self, arm: SoftArm, found: Coordinates, values: Mapping[str, float]) -> Array:
        """Return all differences in expected errors, one long row.

        Parameters
        ----------
        arm : SoftArm
        found : list of lists of (n, n_q)
            Coordinates of each shape of each case.
        values : mapping of str to float
            Numbers, those of the frames among them.
        """
        parts = [
            (d / self.expected[shape.name]).ravel()
            for case, own in zip(self.cases, self.differences(arm, found, values), strict=True)
            for shape, d in zip(case.shapes, own, strict=True)
        ]
        return np.concatenate(parts)


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
    ModelError
        If the start cannot be simulated.
    """
    search = _Search(problem, progress)
    low, high = problem.bounds
    x0 = np.clip(problem.position(start or {}), low + 1e-9, high - 1e-9)
    search.best = np.inf, x0
    search.rows_at(x0, hopeless=False)
    interrupted = False
    try:
        found: Any = least_squares(
            search.residuals,
            x0,
            jac=search.jacobian,
            bounds=(low, high),
            loss=search.loss,
            max_nfev=most,
            ftol=tolerance,
            xtol=tolerance,
            x_scale="jac",
        )
        x, converged = np.asarray(found.x), bool(found.status > 0)
    except KeyboardInterrupt:
        x, converged, interrupted = search.best[1], False, True
    return _solution(search, x, converged, interrupted)


def evaluated(problem: Problem, values: Mapping[str, float]) -> Solution:
    """Return the solution that given numbers are, without a search."""
    search = _Search(problem, lambda cost: None)
    low, high = problem.bounds
    return _solution(search, np.clip(problem.position(values), low, high), True, False)


def _solution(search: _Search, x: Array, converged: bool, interrupted: bool) -> Solution:
    rows = search.rows_at(x, hopeless=False)
    jacobian = search.jacobian(x)[: len(rows)]
    values, cost = search.problem.value(x), search.cost(rows, x)
    return Solution(values, x, rows, jacobian, cost, converged, interrupted)


class _Search:
    """Residuals and derivatives for the library's search, which remember the last arm that was built."""

    def __init__(self, problem: Problem, progress: Callable[[float], None]) -> None:
        self.problem, self.progress = problem, progress
        self.last: tuple[bytes, SoftArm, Coordinates] | None = None
        self.size = 0
        self.best: tuple[float, Array] = np.inf, np.zeros(len(problem.numbers))
        self.frames = [n.name.startswith("frame/") for n in problem.numbers]

    def rows_at(self, x: Array, hopeless: bool = True) -> Array:
        """Rows at `x`; infinite where an arm with those numbers does not exist or cannot be simulated."""
        values = self.problem.value(x)
        try:
            arm, found = self._simulated(x, values)
            rows = self.problem.rows(arm, found, values)
        except SoroError:
            if not hopeless:
                raise
            return np.full(self.size, np.inf)  # which least squares takes as a step too far
        self.size = len(rows)
        return rows

    def residuals(self, x: Array) -> Array:
        rows = self.rows_at(x)
        cost = self.cost(rows, x)
        if cost < self.best[0]:
            self.best = cost, x.copy()
        self.progress(self.best[0])
        return np.concatenate([rows, x])

    @staticmethod
    def cost(rows: Array, x: Array) -> float:
        """Half the sum of the soft losses and of the squares of `x`."""
        return float(np.sum(np.sqrt(1.0 + rows**2) - 1.0) + 0.5 * x @ x)

    def jacobian(self, x: Array) -> Array:
        base = self.rows_at(x)

        def column(k: int) -> Array:
            for step in (_STEP, -_STEP):  # the other side where one is hopeless
                moved = x.copy()
                moved[k] += step
                values = self.problem.value(moved)
                try:
                    if self.frames[k]:
                        _, arm, found = self.last  # type: ignore[misc]
                    else:
                        arm = self.problem.arm(values)
                        found = self.problem.coordinates(arm)
                    return (self.problem.rows(arm, found, values) - base) / step
                except SoroError:
                    continue
            return np.zeros(len(base))

        with ThreadPoolExecutor() as pool:
            columns = list(pool.map(column, range(len(x))))
        return np.vstack([np.column_stack(columns), np.eye(len(x))])

    def loss(self, z: Array) -> Array:
        """Soft-L1 loss of the rows and squares of the prior: values, first and second derivatives (3, m)."""
        out = np.empty((3, len(z)))
        out[0], out[1], out[2] = z, 1.0, 0.0
        t = 1.0 + z[: self.size]
        out[0, : self.size], out[1, : self.size], out[2, : self.size] = (
            2 * (t**0.5 - 1),
            t**-0.5,
            -0.5 * t**-1.5,
        )
        return out

    def _simulated(self, x: Array, values: Mapping[str, float]) -> tuple[SoftArm, Coordinates]:
        key = np.asarray(x)[[not f for f in self.frames]].tobytes()
        if self.last is None or self.last[0] != key:
            arm = self.problem.arm(values)
            self.last = key, arm, self.problem.coordinates(arm)
        return self.last[1], self.last[2]
