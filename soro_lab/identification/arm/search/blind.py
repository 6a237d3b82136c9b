"""Before a search: streams that the arm as described cannot show, and a start that swings in phase."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing

import numpy as np

from soro_core.errors import ConfigError
from soro_core.jobs import given_or_threads, map_jobs
from soro_core.model import SoftArm
from soro_lab.identification.arm.cases.parameters import is_of_robot
from soro_lab.identification.arm.cases.predict import predict_measurement
from soro_lab.identification.arm.search.problem import Problem
from soro_lab.identification.arm.search.solve import FitSolution
from soro_lab.identification.recording import Recording
from soro_lab.identification.recording.streams import Shape

# What strains of 1e-3 and more change at least [m, rad, 1/m]; expected errors by one deviation of a number.
_NOTHING, _NO_EFFECT = 1e-12, 1e-6
_ALLOWED = "a stream that the arm shows: correct its link and direction in the column map, or take it out"


def check_motion(arm: SoftArm, recordings: Sequence[Recording]) -> None:
    """Refuse a stream that stays the same whatever the arm does, as the bend of a link that cannot bend so.

    Raises
    ------
    ConfigError
        That names the recording and the stream.
    """
    q = 1e-3 * np.outer([0.0, 1.0], np.arange(1.0, arm.n_q + 1.0))
    for recording in recordings:
        for shape in recording.shapes:
            does = predict_measurement(shape, arm.robot, arm, q).reshape(2, -1)
            if not _is_on_base(shape) and np.abs(does[1] - does[0]).max() < _NOTHING:
                got = "a prediction that is the same whatever the arm does"
                raise ConfigError(recording.name, shape.name, got, _ALLOWED)


def check_numbers(problem: Problem, solution: FitSolution) -> None:
    """Refuse a stream on which no number of the robot has an effect, as one that no pressure moves.

    Raises
    ------
    ConfigError
        That names the stream.
    """
    of_robot = [is_of_robot(number.name) for number in problem.numbers]
    moves, row = dict[str, bool](), 0
    for case in problem.cases:
        for shape in case.shapes:
            behind = row + len(shape.t) * len(problem.expected[shape.name])
            effect = bool((np.abs(solution.jacobian[row:behind, of_robot]) > _NO_EFFECT).any())
            moves[shape.name] = moves.get(shape.name, False) or effect or _is_on_base(shape)
            row = behind
    for name, is_moved in moves.items():
        if not is_moved:
            got = "a prediction that no number of the robot and no pressure of the recordings changes"
            raise ConfigError("recordings", name, got, _ALLOWED)


def _is_on_base(shape: Shape) -> bool:
    place = getattr(shape, "place", None)
    return place is not None and place.is_base


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
    with given_or_threads(problem.executor) as used, closing(map_jobs(problem.cost, starts, used)) as found:
        costs = list(found)
    return starts[int(np.argmin(costs))]
