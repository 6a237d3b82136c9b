"""Fits of sets of laws without what is held out, each judged by it: one after the other, or as jobs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

from soro_core.arrays import Array
from soro_core.errors import ConfigError, ModelError
from soro_core.jobs import Executor, Here, given_or_threads, map_jobs
from soro_core.robot import Robot
from soro_lab.identification.arm.cases.case import Case, Whole
from soro_lab.identification.arm.cases.initial_conditions import start_numbers
from soro_lab.identification.arm.cases.parameters import ArmParameter, with_numbers
from soro_lab.identification.arm.choose import Laws, Trial
from soro_lab.identification.arm.judge import squares
from soro_lab.identification.arm.laws import free_parameters
from soro_lab.identification.arm.search.problem import Problem, modelled
from soro_lab.identification.arm.search.solve import solve
from soro_lab.identification.search import end_if_interrupted, searching

Progress: TypeAlias = Callable[[str, float], None]

# Relative change of the cost at which a search ends that only compares laws.
COMPARED = 2e-3
# Most steps of a search that compares laws, and of one that shows which promise most.
_FULL, _FEW = 10, 4


@dataclass(frozen=True)
class Problems:
    """The problems of one identification: of each set of laws, with each part of its data.

    Attributes
    ----------
    robot : Robot
        With linear laws.
    keep : tuple of str
        Names of numbers that stay as described.
    kinds : str
        Kinds of strain that the data show, of e and b.
    frames, clocks : tuple of ArmParameter
        Numbers of the measurement, and of whole runs.
    releases : tuple of str
        Names of the runs that begin with a release.
    expected, is_constant, executor
        Of `Problem`.
    """

    robot: Robot
    keep: tuple[str, ...]
    kinds: str
    frames: tuple[ArmParameter, ...]
    clocks: tuple[ArmParameter, ...]
    releases: tuple[str, ...]
    expected: Mapping[str, Array]
    is_constant: bool
    executor: Executor | None

    def of(self, laws: Laws, cases: Sequence[Case]) -> Problem:
        """Return the problem of a set of laws with some cases."""
        numbers, begin = free_parameters(self.robot, laws, self.kinds, self.keep)
        runs = [case.name for case in cases if isinstance(case, Whole)]
        model = modelled(with_numbers(self.robot, begin), self.is_constant)
        starts = start_numbers(model, [run for run in runs if run in self.releases])
        own = (*self.clocks, *starts) if runs else ()
        every = (*numbers, *self.frames, *own)
        return Problem(self.robot, tuple(cases), every, self.expected, {}, self.is_constant, self.executor)

    def expecting(self, expected: Mapping[str, Array]) -> Problems:
        """Return them with other expected errors."""
        return replace(self, expected=expected)


@dataclass(frozen=True)
class LawTrials:
    """Sets of laws, fitted to one part of the data and judged by another.

    Attributes
    ----------
    problems : Problems
    fit, held : tuple of Whole
    moved : mapping of str to float
        Range of each stream.
    linear : mapping of str to float
        Numbers of the linear laws, where each search begins.
    most : int
        Largest number of steps of a search.
    """

    problems: Problems
    fit: tuple[Whole, ...]
    held: tuple[Whole, ...]
    moved: Mapping[str, float]
    linear: Mapping[str, float]
    most: int

    def one(self, laws: Laws, start: Mapping[str, float], in_full: bool, progress: Progress) -> Trial | None:
        """Return a set of laws fitted from given values; None where no such arm can be simulated."""
        return self._tried(laws, start, in_full, partial(progress, _name(laws)))

    def several(
        self, sets: Sequence[Laws], start: Mapping[str, float], progress: Progress
    ) -> Iterator[Trial | None]:
        """Yield sets of laws, each fitted by a few steps as one job.

        Raises
        ------
        KeyboardInterrupt
            After Ctrl-C, with several jobs at a time; one alone ends as `Trial.interrupted`.
        """
        with given_or_threads(self.problems.executor) as executor:
            if isinstance(executor, Here):
                yield from (self.one(laws, start, False, progress) for laws in sets)
                return
            alone = replace(self, problems=replace(self.problems, executor=Here()))
            job = partial(alone._few_steps, start)
            with searching(), closing(map_jobs(job, sets, executor)) as found:
                for laws, trial in zip(sets, found, strict=True):
                    if trial is not None:
                        progress(_name(laws), trial.cost)
                    yield trial

    def _few_steps(self, start: Mapping[str, float], laws: Laws) -> Trial | None:
        return self._tried(laws, start, False, end_if_interrupted)

    def _tried(
        self, laws: Laws, start: Mapping[str, float], in_full: bool, told: Callable[[float], None]
    ) -> Trial | None:
        problems = self.problems
        begin = {**self.linear, **free_parameters(problems.robot, laws, problems.kinds, problems.keep)[1]}
        most = min(_FULL if in_full else _FEW, self.most)
        try:
            cases = problems.of(laws, self.fit)
            found = solve(cases, {**begin, **start}, most, COMPARED, told, secant=not in_full)
            held = problems.of(laws, self.held).prediction_errors(found.values)
            own = squares(self.held, held, self.moved)
        except (ModelError, ConfigError):
            return None
        return Trial(laws, own, found.values, found.interrupted, found.cost)


def _name(laws: Laws) -> str:
    return " + ".join(law.name for law in laws) or "linear"
