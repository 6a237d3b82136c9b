"""How sure numbers are: covariance from blocks of samples, correlations, and what the data do not determine.

Errors of a model last: samples of one run are no independent witnesses, and a covariance that counts each
sample is far too small. Here the scores of a block of samples (a second of a run, longer where scores stay
correlated; one state at rest) are summed first and the blocks count as independent: the sandwich estimate. It
is never taken smaller than the estimate of independent samples.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from soro_core.arrays import Array
from soro_lab.identification.arm.cases.parameters import ArmParameter, is_of_robot
from soro_lab.identification.arm.search.problem import Problem
from soro_lab.identification.arm.search.solve import FitSolution

# Data that leave a number more than this share of its doubt before any data do not determine it.
UNDETERMINED = 0.5
# A number within this many deviations of the prior from its bound is at it.
_AT_BOUND = 1e-3
# A run has at least so many blocks; a block is so many times as long as correlation lasts.
_FEWEST, _BLOCK = 10, 3.0
# Names of gains of whole links.
_GAIN = re.compile(r"link\d+/gain")
# Parts of a combination of numbers that are named: those above this share of the largest.
_NAMED = 0.5


@dataclass(frozen=True)
class Uncertainty:
    """How sure the numbers of a solution are.

    Attributes
    ----------
    deviations : dict
        Standard deviation of each number: of the natural logarithm for a factor, else in its unit.
    correlation : (n, n)
        Between the numbers, in the order of the problem.
    undetermined : dict
        Numbers that the data do not determine alone; with each, the combinations that stay open, as names
        with signs.
    at_bound : tuple of str
        Numbers at a bound: a finding about the model, not a result.
    """

    deviations: dict[str, float]
    correlation: Array
    undetermined: dict[str, tuple[str, ...]]
    at_bound: tuple[str, ...]


def scale_deviation(numbers: Sequence[ArmParameter], sure: Uncertainty) -> float | None:
    """Return the deviation of the scale of moments, and so of lateral forces, as a part of it.

    That of gain times moment arm, of the link for which it is least certain; None where no gain is searched.
    """
    at = {number.name: k for k, number in enumerate(numbers)}
    found = []
    for name in filter(_GAIN.fullmatch, at):
        parts = [part for part in (name, name.replace("/gain", "/arm")) if part in at]
        own = np.array([sure.deviations[part] for part in parts])
        index = [at[part] for part in parts]
        found.append(float(np.sqrt(max(own @ sure.correlation[np.ix_(index, index)] @ own, 0.0))))
    return min(max(found), 1.0) if found else None


def certainty(problem: Problem, solution: FitSolution) -> Uncertainty:
    """Return how sure the numbers of a solution are."""
    covariance = _covariance(problem, solution)
    spread = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(spread, spread)
    numbers = problem.numbers
    low, high = problem.bounds
    at_bound = [
        n.name
        for n, x, a, b in zip(numbers, solution.x, low, high, strict=True)
        if x - a < _AT_BOUND or b - x < _AT_BOUND
    ]
    deviations = {n.name: float(s) * n.doubt for n, s in zip(numbers, spread, strict=True)}
    return Uncertainty(deviations, correlation, _undetermined(numbers, covariance), tuple(at_bound))


def not_determined(problem: Problem, solution: FitSolution) -> dict[str, tuple[str, ...]]:
    """Return numbers of the robot to be fixed so that the data determine the others, with what stays open.

    The least certain number goes first; the covariance of the others is that with those fixed.
    """
    free = list(range(len(problem.numbers)))
    found: dict[str, tuple[str, ...]] = {}
    while True:
        covariance = _covariance(problem, solution, free)
        numbers = tuple(problem.numbers[k] for k in free)
        spread = np.sqrt(np.diag(covariance))
        open_ = [i for i, n in enumerate(numbers) if is_of_robot(n.name) and spread[i] > UNDETERMINED]
        if not open_:
            return found
        worst = max(open_, key=lambda i: float(spread[i]))
        found[numbers[worst].name] = _undetermined(numbers, covariance)[numbers[worst].name]
        del free[worst]


def _covariance(problem: Problem, solution: FitSolution, free: Sequence[int] | None = None) -> Array:
    """Covariance of x, or of those of its numbers that are free."""
    if free is not None:
        own = list(free)
        solution = replace(solution, x=solution.x[own], jacobian=solution.jacobian[:, own])
    rows, jacobian = solution.rows, solution.jacobian
    # First and second derivative of the soft loss.
    slope, curvature = rows / np.sqrt(1.0 + rows**2), (1.0 + rows**2) ** -1.5
    prior = np.eye(len(solution.x))
    # B = (R' R)^-1 of (3): squares of what is nearly open would leave round-off alone, maybe below 0.
    root = np.linalg.qr(np.vstack([np.sqrt(curvature)[:, None] * jacobian, prior]), mode="r")
    scores = jacobian * slope[:, None]
    blocks = _blocks(problem, scores)
    summed = np.zeros((int(blocks.max()) + 1, len(prior)))
    np.add.at(summed, blocks, scores)

    def spread(of: Array) -> Array:
        right = solve_triangular(root, np.vstack([of, prior]).T, trans="T")
        return np.asarray(solve_triangular(root, right))

    between, independent = spread(summed), spread(scores)
    # The estimate of independent samples, from below.
    factor = np.maximum(1.0, np.linalg.norm(independent, axis=1) / np.linalg.norm(between, axis=1))
    scaled = factor[:, None] * between
    return np.asarray(scaled @ scaled.T)


def _blocks(problem: Problem, scores: Array) -> NDArray[np.intp]:
    """Number of the block of each row, whose scores are (m, n)."""
    found, count, row = [], 0, 0
    for case in problem.cases:
        last, lasting, widths = 0, case.block_s, []
        for shape in case.shapes:
            widths.append(len(problem.expected[shape.name]))
            end = row + len(shape.t) * widths[-1]
            own = scores[row:end].reshape(len(shape.t), widths[-1], scores.shape[1]).sum(axis=1)
            lasting, row = max(lasting, _correlated_s(shape.t, own)), end
        for shape, width in zip(case.shapes, widths, strict=True):
            number = np.floor(shape.t / lasting).astype(np.intp)
            number = number - (number.min() if len(number) else 0)
            found.append(np.repeat(number + count, width))
            last = max(last, int(number.max()) + 1 if len(number) else 0)
        count += last
    return np.concatenate(found)


def _correlated_s(t: Array, scores: Array) -> float:
    """Time [s] of a block beyond which no score is correlated, of samples (n, n_x) at times (n,).

    Correlation ends at the first lag where it is no more than chance makes it, two deviations.
    """
    n = len(t)
    if n < 2 * _FEWEST:
        return 0.0
    off = scores - scores.mean(axis=0)
    power = np.abs(np.fft.rfft(off, 2 * n, axis=0)) ** 2
    along = np.fft.irfft(power, axis=0)[:n]
    ended = along <= 2.0 / np.sqrt(n) * along[0]
    lag = int(np.argmax(ended, axis=0).max())
    return float(min(_BLOCK * lag * np.median(np.diff(t)), (t[-1] - t[0]) / _FEWEST))


def _undetermined(numbers: tuple[ArmParameter, ...], covariance: Array) -> dict[str, tuple[str, ...]]:
    """Names of what stays open, each with the combinations that do."""
    values, vectors = np.linalg.eigh(covariance)
    open_: dict[str, list[str]] = {
        n.name: [] for n, s in zip(numbers, np.sqrt(np.diag(covariance)), strict=True) if s > UNDETERMINED
    }
    for value, vector in zip(values, vectors.T, strict=True):
        if np.sqrt(value) <= UNDETERMINED:
            continue
        largest = np.abs(vector).max()
        sign = np.sign(vector[np.argmax(np.abs(vector))])
        parts = [
            ("+" if v * sign > 0 else "-") + n.name
            for n, v in zip(numbers, vector, strict=True)
            if abs(v) > _NAMED * largest
        ]
        for part in parts:
            if part[1:] in open_:
                open_[part[1:]].append(" ".join(parts))
    return {name: tuple(combinations) for name, combinations in open_.items()}
