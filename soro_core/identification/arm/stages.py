"""The way from recordings to the numbers of an arm: frames, states at rest, whole runs, laws, certainty."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.errors import ConfigError, ModelError
from soro_core.identification.arm.cases import Case, Interval, Rests, Whole
from soro_core.identification.arm.certainty import Certainty, certainty
from soro_core.identification.arm.choose import Choice, Trial, choose
from soro_core.identification.arm.frames import frame_numbers
from soro_core.identification.arm.judge import Error, errors, ranges, share_of_range
from soro_core.identification.arm.laws import LAWS, Law, freed, is_of_law, plain
from soro_core.identification.arm.numbers import Number, with_numbers
from soro_core.identification.arm.problem import Problem, Solution, solve
from soro_core.identification.recording import Plate, Recording, hold_out, rest_states, sections
from soro_core.identification.recording.streams import Curvature, Marker, Shape
from soro_core.model import SoftArm
from soro_core.robot import Robot

Array: TypeAlias = NDArray[np.float64]
Progress: TypeAlias = Callable[[str, float], None]

# Expected errors before any fit, in parts of the range that a shape moved, and of a plate's angle [rad].
_FIRST_SHARE, _FIRST_TURN = 0.03, 0.05
# No expected error is smaller than this: m, rad, 1/m.
_LEAST = {"m": 1e-4, "rad": 1e-3, "1/m": 1e-3}


@dataclass(frozen=True)
class Options:
    """How arms are identified.

    Attributes
    ----------
    dt_s : float
        Step of simulations [s].
    rate_hz : float
        Samples a second that are compared.
    laws : tuple of Law
        Laws that may be added.
    most : int
        Largest number of steps of each search.
    starts : int
        Number of starts of the fit of states at rest.
    seed : int
        Of these starts.
    """

    dt_s: float = 0.005
    rate_hz: float = 25.0
    laws: tuple[Law, ...] = LAWS
    most: int = 25
    starts: int = 3
    seed: int = 1


@dataclass(frozen=True)
class Identified:
    """What an identification found.

    Attributes
    ----------
    robot : Robot
        With all numbers that the data determine; the others as described.
    problem, solution, certainty
        Of the last fit, on all data.
    choice : Choice or None
        Laws that were tried; None where nothing could be held out.
    fitted, held_out : tuple of Error
        Of the fit without the held-out sections.
    held_out_share : float
        RMS error on the held-out sections in ranges moved; nan where there are none.
    kept : dict
        Numbers that the data do not determine, with the combinations that stay open: as described, or, of a law, where
        the fit had them.
    """

    robot: Robot
    problem: Problem
    solution: Solution
    certainty: Certainty
    choice: Choice | None
    fitted: tuple[Error, ...]
    held_out: tuple[Error, ...]
    held_out_share: float
    kept: dict[str, tuple[str, ...]] = field(default_factory=dict)


def identify(
    robot: Robot,
    recordings: Sequence[Recording],
    options: Options | None = None,
    progress: Progress = lambda stage, cost: None,
) -> Identified:
    """Find the numbers of an arm.

    Parameters
    ----------
    robot : Robot
        Its geometry and masses hold; other numbers are where the search begins.
    recordings : sequence of Recording
        Cleaned; each begins at rest.
    options : Options, optional
    progress : callable
        Called with the name of a stage and its cost, often.

    Raises
    ------
    ConfigError
        If no recording shows the shape of the arm, or too few sections are left to fit.
    ModelError
        If the arm as described cannot be simulated.
    """
    options = Options() if options is None else options
    robot = plain(robot)
    fit_cases, held = _split(recordings, options)
    kinds = "eb" if any(isinstance(s, Plate | Marker) for r in recordings for s in r.shapes) else "b"
    rests = _rests(recordings)
    everything: list[Case] = [*fit_cases, *held]
    moved = ranges(everything)
    expected = {s.name: _first(s, moved[s.name]) for case in everything for s in case.shapes}
    frames = frame_numbers(SoftArm(robot), [rests] if rests is not None else fit_cases)
    values: dict[str, float] = {}
    if rests is not None:
        values = _at_rest(robot, rests, frames, expected, kinds, options, progress)

    def problem(laws: Sequence[Law], cases: Sequence[Case]) -> tuple[Problem, dict[str, float]]:
        numbers, starts = freed(robot, laws, kinds)
        return Problem(robot, tuple(cases), (*numbers, *frames), expected), starts

    first, _ = problem((), fit_cases)
    linear = solve(first, values, options.most, progress=lambda cost: progress("linear", cost))
    expected.update(_residual(first, linear))

    def trial(laws: tuple[Law, ...], start: dict[str, float]) -> Trial | None:
        name = " + ".join(law.name for law in laws) or "linear"
        own, begin = problem(laws, fit_cases)
        try:
            found = solve(
                own, {**linear.values, **begin, **start}, options.most, 1e-3, lambda c: progress(name, c)
            )
            squares = _squares(replace(own, cases=tuple(held)), found, moved)
        except (ModelError, ConfigError):
            return None
        return Trial(laws, squares, found.values)

    choice = choose(options.laws, trial) if held else None
    laws = choice.chosen.laws if choice else ()
    best = choice.chosen.values if choice else linear.values
    own, _ = problem(laws, fit_cases)
    fitted = errors(fit_cases, _differences(own, best), expected)
    judged = errors(held, _differences(replace(own, cases=tuple(held)), best), expected) if held else ()
    last, _ = problem(laws, everything)
    expected.update(_residual(last, solve(last, best, 0 or 1)))
    last, _ = problem(laws, everything)
    solution, sure, kept, last = _determined(last, best, options, progress)
    own_values = {k: v for k, v in solution.values.items() if not k.startswith("frame/")}
    share = share_of_range(judged, moved) if judged else float("nan")
    return Identified(
        with_numbers(last.robot, own_values), last, solution, sure, choice, fitted, judged, share, kept
    )


def _determined(
    problem: Problem, start: Mapping[str, float], options: Options, progress: Progress
) -> tuple[Solution, Certainty, dict[str, tuple[str, ...]], Problem]:
    """Fit, and fix the least certain number as described as long as the data do not determine it."""
    kept: dict[str, tuple[str, ...]] = {}
    while True:
        solution = solve(problem, start, options.most, progress=lambda cost: progress("all data", cost))
        sure = certainty(problem, solution)
        doubts = {n.name: n.doubt for n in problem.numbers}
        candidates = [name for name in sure.undetermined if not name.startswith("frame/")]
        if not candidates:
            return solution, sure, kept, problem
        worst = max(candidates, key=lambda name: sure.deviations[name] / doubts[name])
        kept[worst] = sure.undetermined[worst]
        start = {k: v for k, v in solution.values.items() if k != worst}
        # A number of a law stays where the fit has it: the law was chosen because it predicts.
        robot = problem.robot
        if is_of_law(worst):
            robot = with_numbers(robot, {worst: solution.values[worst]})
        problem = replace(problem, robot=robot, numbers=tuple(n for n in problem.numbers if n.name != worst))


def _at_rest(
    robot: Robot,
    rests: Rests,
    frames: tuple[Number, ...],
    expected: Mapping[str, Array],
    kinds: str,
    options: Options,
    progress: Progress,
) -> dict[str, float]:
    """Numbers from the states at rest: the best of several starts."""
    numbers = [n for n in freed(robot, (), kinds)[0] if "/damping_" not in n.name]
    problem = Problem(robot, (rests,), (*numbers, *frames), expected)
    draw = np.random.default_rng(options.seed)
    best: Solution | None = None
    for k in range(options.starts):
        x = draw.normal(0.0, 0.5, len(numbers)) * (k > 0)
        start = problem.value(np.concatenate([x, np.zeros(len(frames))]))
        try:
            found = solve(problem, start, options.most, progress=lambda cost: progress("rest", cost))
        except (ModelError, ConfigError):
            if k == options.starts - 1 and best is None:
                raise
            continue
        if best is None or found.cost < best.cost:
            best = found
    assert best is not None
    return best.values


def _split(recordings: Sequence[Recording], options: Options) -> tuple[list[Whole], list[Whole]]:
    """Cases of the fit and of the judge: sections of each kind are held out of every recording."""
    fit, held = [], []
    for recording in recordings:
        used, out = hold_out(sections(recording))
        for parts, into in ((used, fit), (out, held)):
            if parts:
                judged: tuple[Interval, ...] = tuple((p.start, p.end) for p in parts)
                into.append(Whole(recording, options.dt_s, judged, options.rate_hz))
    if not fit:
        raise ConfigError("recordings", "", "no section with pressures and shape", "a recording with both")
    return fit, held


def _rests(recordings: Sequence[Recording]) -> Rests | None:
    """All states at rest of all recordings; None where there are fewer than three."""
    pressure: list[Array] = []
    rows: dict[str, list[tuple[int, Array, Shape]]] = {}
    for recording in recordings:
        by_name = {shape.name: shape for shape in recording.shapes}
        for state in rest_states(recording):
            for mean in state.shapes:
                rows.setdefault(mean.stream, []).append((len(pressure), mean.value, by_name[mean.stream]))
            pressure.append(state.pressure.value)
    if len(pressure) < 3 or not any(isinstance(r[0][2], Plate | Marker) for r in rows.values()):
        return None
    shapes = tuple(
        _of_means(r[0][2], np.array([k for k, _, _ in r], float), np.array([v for _, v, _ in r]))
        for r in rows.values()
    )
    return Rests("states at rest", np.array(pressure), shapes)


def _of_means(shape: Shape, t: Array, values: Array) -> Shape:
    if isinstance(shape, Plate):
        return replace(shape, t=t, position=values[:, :3], quaternion=values[:, 3:])
    if isinstance(shape, Marker):
        return replace(shape, t=t, position=values)
    return (
        replace(shape, t=t, curvature=values)
        if isinstance(shape, Curvature)
        else replace(shape, t=t, angle=values[:, 0])
    )


def _first(shape: Shape, moved: float) -> Array:
    """Expected error of each column before any fit."""
    if isinstance(shape, Plate):
        return np.array([max(_FIRST_SHARE * moved, _LEAST["m"])] * 3 + [_FIRST_TURN] * 3)
    width = shape.motion().reshape(len(shape.t), -1).shape[1] if len(shape.t) else 1
    least = _LEAST["m" if isinstance(shape, Marker) else "1/m" if isinstance(shape, Curvature) else "rad"]
    return np.full(width, max(_FIRST_SHARE * moved, least))


def _residual(problem: Problem, solution: Solution) -> dict[str, Array]:
    """Expected errors after a fit: the RMS of what is left of each shape, of places and angles apart."""
    found: dict[str, list[Array]] = {}
    for case, own in zip(problem.cases, _differences(problem, solution.values), strict=True):
        for shape, rows in zip(case.shapes, own, strict=True):
            found.setdefault(shape.name, []).append(rows)
    expected = {}
    for name, parts in found.items():
        squares = np.mean(np.concatenate(parts) ** 2, axis=0)
        groups = [squares[:3], squares[3:]] if len(squares) == 6 else [squares]
        least = [_LEAST["m"], _LEAST["rad"]]
        expected[name] = np.concatenate(
            [
                np.full(len(g), max(float(np.sqrt(g.mean())), low))
                for g, low in zip(groups, least, strict=False)
            ]
        )
    return expected


def _differences(problem: Problem, values: Mapping[str, float]) -> list[list[Array]]:
    arm = problem.arm({k: v for k, v in values.items() if not k.startswith("frame/")})
    return problem.differences(arm, problem.coordinates(arm), values)


def _squares(problem: Problem, found: Solution, moved: Mapping[str, float]) -> tuple[float, ...]:
    """Mean square of the held-out error of each section, in ranges moved."""
    squares = []
    for case, own in zip(problem.cases, _differences(problem, found.values), strict=True):
        judged = case.judged if isinstance(case, Whole) else ()
        for start, end in judged:
            parts = []
            for shape, rows in zip(case.shapes, own, strict=True):
                inside = rows[(shape.t >= start) & (shape.t <= end)]
                width = 3 if isinstance(shape, Plate) else rows.shape[1]
                if len(inside) and moved[shape.name] > 0.0:
                    parts.append(np.mean(np.sum(inside[:, :width] ** 2, axis=1)) / moved[shape.name] ** 2)
            if parts:
                squares.append(float(np.mean(parts)))
    return tuple(squares)
