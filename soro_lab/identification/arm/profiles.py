"""Profiles of the numbers of an identification: those of all from the derivatives, some by simulations."""

from __future__ import annotations

from collections.abc import Callable, Collection
from contextlib import closing
from dataclasses import dataclass

from soro_core.arrays import Array
from soro_core.errors import SoroError
from soro_core.jobs import Executor, given_or_threads, map_jobs
from soro_lab.identification.arm.search.problem import Problem
from soro_lab.identification.arm.search.profile import Optimum, Profile, ProfilePoint, linear, searched
from soro_lab.identification.arm.stages import ArmIdentification


def least_certain(found: ArmIdentification, count: int = 3) -> tuple[str, ...]:
    """Return the numbers of the arm that are determined, inside their bounds and least certain."""
    sure = found.certainty
    doubts = {
        n.name: sure.deviations[n.name] / n.doubt
        for n in found.problem.numbers
        if not n.name.startswith("frame/") and n.name not in (*sure.undetermined, *sure.at_bound)
    }
    return tuple(sorted(doubts, key=lambda name: -doubts[name])[:count])


def profiles(
    found: ArmIdentification,
    wanted: Collection[str],
    progress: Callable[[str, float], None] = lambda stage, done: None,
    executor: Executor | None = None,
) -> tuple[tuple[Profile, ...], bool]:
    """Return the profile of each number, and whether Ctrl-C came: then some are linear that were wanted.

    Parameters
    ----------
    found : ArmIdentification
    wanted : collection of str
        Numbers whose profile is searched with simulations; those of all others are linear.
    progress : callable
        Called with the name of a profile and the share of them that is done.
    executor : Executor, optional
        Searches the profiles; default threads on all cores.
    """
    problem, solution, deviations = found.problem, found.solution, found.certainty.deviations
    optimum = Optimum(solution.x, solution.rows, solution.jacobian, *problem.bounds)

    def spread(k: int) -> float:
        return deviations[problem.numbers[k].name] / problem.numbers[k].doubt

    every = range(len(problem.numbers))
    by_name = {
        problem.numbers[k].name: Profile(problem.numbers[k].name, False, linear(optimum, k, spread(k)))
        for k in every
    }
    asked = [k for k in every if problem.numbers[k].name in wanted]
    job, jobs = _Searched(problem, optimum), [(k, spread(k)) for k in asked]
    try:
        with given_or_threads(executor) as used, closing(map_jobs(job, jobs, used)) as points_of:
            for done, (k, points) in enumerate(zip(asked, points_of, strict=True)):
                name = problem.numbers[k].name
                by_name[name] = Profile(name, True, points)
                progress(f"profile of {name}", (done + 1) / len(asked))
    except KeyboardInterrupt:
        return tuple(by_name.values()), True
    return tuple(by_name.values()), False


@dataclass(frozen=True)
class _Searched:
    """The profile of one number, as a job that can be sent."""

    problem: Problem
    optimum: Optimum

    def __call__(self, number: tuple[int, float]) -> tuple[ProfilePoint, ...]:
        return searched(self._rows_at, self.optimum, *number)

    def _rows_at(self, x: Array) -> Array | None:
        values = self.problem.value(x)
        try:
            return self.problem.rows(self.problem.predict(values), values)
        except SoroError:
            return None
