"""The way from recordings to the numbers of an arm: frames, states at rest, whole runs, laws, certainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from soro_core.config import with_changes
from soro_core.errors import ConfigError, ModelError, SoroError
from soro_core.jobs import Executor
from soro_core.model import SoftArm
from soro_core.robot import Robot
from soro_lab.identification.arm.cases.case import Whole, longest_step
from soro_lab.identification.arm.cases.initial_conditions import is_release
from soro_lab.identification.arm.cases.parameters import ArmParameter, is_of_robot
from soro_lab.identification.arm.choose import LawChoice, choose
from soro_lab.identification.arm.frames import calibrated, clock_numbers, frame_numbers
from soro_lab.identification.arm.judge import Error, errors, ranges, share_of_range
from soro_lab.identification.arm.laws import LAWS, LawTerm, is_of_law, plain
from soro_lab.identification.arm.search.blind import check_motion, check_numbers, swinging
from soro_lab.identification.arm.search.prepare import first_errors, residual_errors, rests_of, split
from soro_lab.identification.arm.search.problem import Problem
from soro_lab.identification.arm.search.solve import FitSolution, evaluated, solve
from soro_lab.identification.arm.search.uncertainty import (
    Uncertainty,
    certainty,
    not_determined,
    scale_deviation,
)
from soro_lab.identification.arm.trials import COMPARED, LawTrials, Problems, Progress
from soro_lab.identification.recording import (
    Marker,
    Plate,
    Recording,
    check_names,
    still_limits,
    without_hands,
)
from soro_lab.identification.search import only_in_searches

# Step of the simulations by which laws are compared, over that of the last fit.
_COARSE = 2.0
# Turn of the slowest swing in a step of the last fit [rad]: its stiffness comes out right to 0.3 %.
_TURN = 0.2
# Relative change of the cost at which the last search ends. With ten thousand samples of noise, one deviation
# of a number changes the cost by less than 1e-4 of it.
_LAST = 1e-6


@dataclass(frozen=True)
class IdentificationOptions:
    """How arms are identified.

    Attributes
    ----------
    dt_s : float or None
        Step of simulations [s] of the last fit; laws are compared with twice that. None: so long that
        stiffness is right to 0.3 %.
    rate_hz : float
        Samples a second that are compared.
    laws : tuple of LawTerm
        Laws that may be added.
    most : int
        Largest number of steps of each search.
    is_constant : bool
        Whether strains are simulated as constant along a link, as in the default model of a controller:
        faster, and stiffness is what makes that model swing right; else it is that of the link.
    starts : int
        Number of starts of the fit of states at rest.
    seed : int
        Of these starts.
    hold_out : tuple of str
        Names of recordings that no fit sees, not even the last one; () holds out sections of all.
    keep : tuple of str
        Names of numbers that stay as described.
    executor : Executor or None
        Computes the derivatives of all fits, and starts; None: threads on all cores.
    """

    dt_s: float | None = None
    rate_hz: float = 100.0
    laws: tuple[LawTerm, ...] = LAWS
    most: int = 25
    is_constant: bool = False
    starts: int = 3
    seed: int = 1
    hold_out: tuple[str, ...] = ()
    keep: tuple[str, ...] = ()
    executor: Executor | None = None


@dataclass(frozen=True)
class ArmIdentification:
    """What an identification found.

    Attributes
    ----------
    robot : Robot
        With all numbers that the data determine.
    problem, solution, certainty
        Of the last fit, on all data.
    choice : LawChoice or None
        Laws that were tried; None where nothing could be held out.
    fitted, held_out : tuple of Error
        Of the fit without the held-out sections.
    held_out_share : float
        RMS error on the held-out sections in ranges moved; nan where there are none.
    kept : dict
        Numbers that the data do not determine, with the combinations that stay open: as described, or, of a
        law, where the fit had them.
    fit_cases, held_cases : tuple of Whole
        What the choice of laws was fitted to and judged by.
    interrupted : bool
        Whether Ctrl-C ended a search: then these are the best numbers until there.
    """

    robot: Robot
    problem: Problem
    solution: FitSolution
    certainty: Uncertainty
    choice: LawChoice | None
    fitted: tuple[Error, ...]
    held_out: tuple[Error, ...]
    held_out_share: float
    kept: dict[str, tuple[str, ...]] = field(default_factory=dict)
    fit_cases: tuple[Whole, ...] = ()
    held_cases: tuple[Whole, ...] = ()
    interrupted: bool = False


@only_in_searches()
def identify(
    robot: Robot,
    recordings: Sequence[Recording],
    options: IdentificationOptions | None = None,
    progress: Progress = lambda stage, cost: None,
) -> ArmIdentification:
    """Find the numbers of an arm. Ctrl-C ends the search; what was found until then is returned.

    Parameters
    ----------
    robot : Robot
        Its geometry and masses hold; other numbers are where the search begins.
    recordings : sequence of Recording
        Cleaned; each begins at rest or with a release.
    options : IdentificationOptions, optional
    progress : callable
        Called with the name of a stage and its cost, often.

    Raises
    ------
    ConfigError
        If no recording has a section with pressures and shape, a name stands for two kinds of streams, the
        arm cannot show a stream, or one of the options is unknown.
    ModelError
        If the arm as described cannot be simulated.
    """
    options = IdentificationOptions() if options is None else options
    recordings = [recording for recording in recordings if recording.shapes]
    check_names(recordings)
    recordings, options = _let_go(recordings, options)
    robot, keep, executor = plain(robot, options.keep), options.keep, options.executor
    is_constant = options.is_constant
    check_motion(SoftArm(robot), recordings)
    dt = options.dt_s or longest_step(SoftArm(robot), _TURN)
    fit, held = split(recordings, _COARSE * dt, options.rate_hz, options.hold_out)
    recordings = [recording for recording in recordings if recording.name not in options.hold_out]
    whole = [Whole(r, dt, rate_hz=options.rate_hz) for r in recordings]
    rests, moved = rests_of(recordings), ranges(whole)
    expected = {s.name: first_errors(s, moved[s.name]) for case in whole for s in case.shapes}
    frames = frame_numbers(SoftArm(robot), [rests] if rests is not None else fit)
    releases = [recording.name for recording in recordings if is_release(recording)]
    clocks = clock_numbers([case for case in whole if case.name not in releases])
    kinds = "eb" if any(isinstance(s, Plate | Marker) for r in recordings for s in r.shapes) else "b"

    problems = Problems(robot, keep, kinds, frames, clocks, tuple(releases), expected, is_constant, executor)
    problem = problems.of
    values: dict[str, float] = {}
    interrupted = False
    if rests is not None:
        values, interrupted = _at_rest(problem((), [rests]), options, progress)
        options = replace(options, most=1) if interrupted else options
    values = swinging(problem((), fit), values)
    linear = solve(problem((), fit), values, options.most, COMPARED, partial(progress, "linear"))
    check_numbers(problem((), fit), linear)
    problems = problems.expecting(residual_errors(problem((), fit), linear.values))

    trials = LawTrials(problems, tuple(fit), tuple(held), moved, linear.values, options.most)
    interrupted = interrupted or linear.interrupted
    choice = None
    if held and not interrupted:
        choice = choose(
            options.laws, partial(trials.one, progress=progress), partial(trials.several, progress=progress)
        )
    laws, best = (choice.chosen.laws, choice.chosen.values) if choice else ((), linear.values)
    problem = problems.of
    fitted = errors(fit, problem(laws, fit).prediction_errors(best), problems.expected)
    judged = errors(held, problem(laws, held).prediction_errors(best), problems.expected)
    problems = problems.expecting(residual_errors(problem(laws, whole), best))
    interrupted = interrupted or (choice is not None and choice.interrupted)
    limits = replace(options, most=1) if interrupted else options
    last = problems.of(laws, whole)
    solution, sure, kept = _determined(last, best, limits, progress)
    share = share_of_range(judged, moved) if judged else float("nan")
    found = calibrated(
        last.robot_of(solution.values), (s for r in recordings for s in r.shapes), solution.values
    )
    std = scale_deviation(last.numbers, sure)
    if std is not None:
        found = found.replace(calibration=with_changes(found.calibration, gain_std=std))
    interrupted = interrupted or solution.interrupted
    parts = tuple(fit), tuple(held)
    return ArmIdentification(
        found, last, solution, sure, choice, fitted, judged, share, kept, *parts, interrupted=interrupted
    )


def _let_go(
    recordings: Sequence[Recording], options: IdentificationOptions
) -> tuple[list[Recording], IdentificationOptions]:
    """Return the recordings without the time in which a hand holds the arm; parts are held out together."""
    still = still_limits(recordings)
    parts = {recording.name: without_hands(recording, still) for recording in recordings}
    held = tuple(part for name in options.hold_out for part in _names(parts.get(name, ())) or (name,))
    return [part for own in parts.values() for part in own], replace(options, hold_out=held)


def _names(recordings: Sequence[Recording]) -> tuple[str, ...]:
    return tuple(recording.name for recording in recordings)


def _at_rest(
    problem: Problem, options: IdentificationOptions, progress: Progress
) -> tuple[dict[str, float], bool]:
    """Return the numbers at rest, undamped, the best of several starts, and whether Ctrl-C came."""
    numbers = tuple(n for n in problem.numbers if "/damping_" not in n.name)
    problem = replace(problem, numbers=numbers)
    own = np.array([is_of_robot(n.name) for n in numbers])
    draw = np.random.default_rng(options.seed)
    found: list[FitSolution] = []
    for k in range(options.starts):
        start = problem.value(own * draw.normal(0.0, 0.5, len(numbers)) * (k > 0))
        try:
            found.append(solve(problem, start, options.most, progress=partial(progress, "rest")))
        except (ModelError, ConfigError):
            if k == 0 and options.starts == 1:
                raise
        if found and found[-1].interrupted:
            break
    best = min(found, key=lambda s: s.cost).values if found else {}
    return best, any(s.interrupted for s in found)


def _determined(
    problem: Problem, start: Mapping[str, float], options: IdentificationOptions, progress: Progress
) -> tuple[FitSolution, Uncertainty, dict[str, tuple[str, ...]]]:
    """Fit, take out what the data do not determine, and fit the rest again.

    The deviations are those with all numbers free: what is taken out is no surer for it, nor are the others.
    """
    kept: dict[str, tuple[str, ...]] = {}
    whole = problem
    while True:
        told, again = partial(progress, "all data"), bool(kept)
        # What is taken out was open, so the others hardly move.
        solution = solve(problem, start, options.most, _LAST, told, secant=again)
        if solution.interrupted or options.most == 1:  # Ctrl-C: no search any more
            break
        open_ = not_determined(problem, solution)
        if not open_:
            break
        kept.update(open_)
        for name in open_:
            problem = _without(problem, name, solution.values)
        start = {k: v for k, v in solution.values.items() if k not in kept}
    if not kept:
        return solution, certainty(problem, solution), kept
    last = evaluated(whole, {**problem.fixed, **solution.values})
    return last, certainty(whole, last), kept


def _without(problem: Problem, name: str, values: Mapping[str, float]) -> Problem:
    """Return the problem that does not search a number.

    One of a law stays where the fit had it: the law was chosen because it predicts. Others stay as described,
    where such an arm can be simulated with the other numbers.
    """
    numbers: tuple[ArmParameter, ...] = tuple(n for n in problem.numbers if n.name != name)
    described = replace(problem, numbers=numbers)
    if not is_of_law(name):
        try:
            described.prediction_errors({n.name: values[n.name] for n in numbers})
            return described
        except SoroError:
            pass
    return replace(described, fixed={**problem.fixed, name: values[name]})
