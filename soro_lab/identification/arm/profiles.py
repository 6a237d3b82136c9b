"""Profiles of the numbers of an identification: those of all from the derivatives, some by simulations."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from concurrent.futures import ThreadPoolExecutor

from soro_core.arrays import Array
from soro_core.errors import SoroError
from soro_lab.identification.arm.search.profile import Optimum, Profile, linear, searched
from soro_lab.identification.arm.stages import ArmIdentification


def least_certain(found: ArmIdentification, count: int = 3) -> tuple[str, ...]:
    """Return the numbers of the arm that are determined, inside their bounds and least certain.

    Parameters
    ----------
    found : ArmIdentification
    count : int
    """
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
) -> tuple[tuple[Profile, ...], bool]:
    """Return the profile of each number, and whether Ctrl-C came: then some are linear that were wanted.

    Parameters
    ----------
    found : ArmIdentification
    wanted : collection of str
        Numbers whose profile is searched with simulations; those of all others are linear.
    progress : callable
        Called with the name of a profile and the share of them that is done.
    """
    problem, solution, deviations = found.problem, found.solution, found.certainty.deviations
    optimum = Optimum(solution.x, solution.rows, solution.jacobian, *problem.bounds)

    def rows_at(x: Array) -> Array | None:
        values = problem.value(x)
        try:
            return problem.rows(problem.predict(values), values)
        except SoroError:
            return None

    def spread(k: int) -> float:
        return deviations[problem.numbers[k].name] / problem.numbers[k].doubt

    every = range(len(problem.numbers))
    by_name = {
        problem.numbers[k].name: Profile(problem.numbers[k].name, False, linear(optimum, k, spread(k)))
        for k in every
    }
    asked = [k for k in every if problem.numbers[k].name in wanted]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        try:
            for done, (k, points) in enumerate(
                zip(asked, pool.map(lambda k: searched(rows_at, optimum, k, spread(k)), asked), strict=True)
            ):
                name = problem.numbers[k].name
                by_name[name] = Profile(name, True, points)
                progress(f"profile of {name}", (done + 1) / len(asked))
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
            return tuple(by_name.values()), True
    return tuple(by_name.values()), False
