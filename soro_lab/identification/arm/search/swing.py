"""A start from which a search finds the swing of an arm: where it is out of phase, damping hides it."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from soro_lab.identification.arm.cases.parameters import is_of_robot
from soro_lab.identification.arm.search.problem import Problem

# Factors of stiffness and gains together: frequencies 6 % apart, to half and to one and a half times.
_FACTORS = np.exp(np.sort([0.0, *np.arange(-1.4, 0.9, 0.12)]))


def swinging(problem: Problem, values: Mapping[str, float]) -> dict[str, float]:
    """Return the best of some starts that bend alike and swing at different frequencies.

    Rests without much gravity show stiffness over gain, not the two alone. From a start that swings too fast
    or too slowly by half a turn, the nearest minimum is an arm that does not swing at all.

    Parameters
    ----------
    problem : Problem
        Whole runs.
    values : mapping of str to float
        Numbers at rest. The arm as described is tried too: few rests may mislead.
    """
    middle = {n.name: n.value for n in problem.numbers}
    scaled = [
        name for name in middle if is_of_robot(name) and name.split("/", 1)[1] in ("k_e", "k_b", "gain")
    ]
    damped = [name for name in middle if is_of_robot(name) and "/damping_" in name]

    def start(given: Mapping[str, float], factor: float) -> dict[str, float]:
        # The damping ratio stays.
        changes = {**dict.fromkeys(scaled, factor), **dict.fromkeys(damped, float(np.sqrt(factor)))}
        return {name: value * changes.get(name, 1.0) for name, value in given.items()}

    given_starts = ({**middle, **values}, middle) if values else (middle,)
    starts = [start(given, float(factor)) for given in given_starts for factor in _FACTORS]
    with ThreadPoolExecutor() as pool:  # simulations run beside each other
        costs = list(pool.map(problem.cost, starts))
    return starts[int(np.argmin(costs))]
