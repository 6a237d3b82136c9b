"""The most probable cause of a bad run, and the next step: a table, read from the top."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from soro_core.loop import AT_LIMIT_PART
from soro_ros.status_words import NO_COMMAND, NO_ESTIMATE

# Part of the time for which a chamber is at one bound of a run that this bound has spoilt.
_MOST_PART = 0.5
# Part of the cycles of a loop that may come too late.
_LATE_PART = 0.02
# Part of the time in which an arm that something holds back elsewhere follows its reference.
_FREE_PART = 0.35
# Part of the time in which an arm that is pushed off its reference touches something.
_TOUCHING_PART = 0.1


class Bound(NamedTuple):
    """A bound of the set points: what states it, with its value, and what to do about it."""

    name: str
    step: str


NO_BOUND = Bound("a bound", "")


class Answers(NamedTuple):
    """What the arm's answers to all pressures of a run say by the measurement of the probe, and the step.

    A probe refuses what is `grave`, and warns of the rest.
    """

    text: str = ""
    step: str = ""
    grave: bool = False


NO_ANSWERS = Answers()


@dataclass(frozen=True)
class Evidence:
    """What a run shows in its last 5 s. Lengths are parts of the arm's length, times seconds.

    Attributes
    ----------
    error, good : float
        Tip error, RMS, NaN if unknown, and the largest one of a good run.
    controller, estimator : str
        What the nodes said last; empty for nothing.
    at_bound, at_slew : float
        Part of the set points at a bound, or that of the whole run where it was lost by them; part of their
        changes at a limit of rate.
    held : float
        Largest part of that time for which one chamber is at one bound.
    bound : Bound
        The one that most of these set points are at.
    swing_hz : float
        Frequency at which the tip swings about its reference [Hz]; NaN where it does not.
    pressure_off : str
        Chamber whose pressure does not come to its set point, with both.
    estimator_error : float
        Error of the estimated tip, RMS; NaN if unknown.
    good_at_s : float
        Time at which an error that is still falling will be good; NaN where it does not fall.
    free : float
        Part of the time in which the tip is where a good run has it.
    late : float
        Part of the cycles of the loop that came too late.
    touching, pushed_n : float
        Part of the time in which the arm touches something, by the estimator, and the largest force [N].
    learns : bool
        Whether the law learns.
    answers : Answers
        Of the arm to the pressures of the whole run.
    """

    error: float
    good: float
    controller: str = ""
    estimator: str = ""
    at_bound: float = 0.0
    at_slew: float = 0.0
    held: float = 0.0
    bound: Bound = NO_BOUND
    swing_hz: float = math.nan
    pressure_off: str = ""
    estimator_error: float = math.nan
    good_at_s: float = math.nan
    free: float = 0.0
    late: float = 0.0
    touching: float = 0.0
    pushed_n: float = 0.0
    learns: bool = True
    answers: Answers = NO_ANSWERS


class PossibleCause(NamedTuple):
    """One row: what is said of the cause, or an empty text where it is another one; and the next step."""

    find: Callable[[Evidence], str]
    step: Callable[[Evidence], str]


def _says(node: str, *words: str) -> Callable[[Evidence], str]:
    """Return a finder of one of these words in what a node says."""

    def find(seen: Evidence) -> str:
        parts = str(getattr(seen, node)).split("; ")
        said = [part for part in parts if any(word in part for word in words)]
        return f"{node}: {'; '.join(said)}" if said else ""

    return find


def _when(holds: Callable[[Evidence], bool], text: str) -> Callable[[Evidence], str]:
    return lambda seen: text.format(seen=seen) if holds(seen) else ""


def _mostly(find: Callable[[Evidence], str]) -> Callable[[Evidence], str]:
    """Return a finder for runs with a chamber that is at one bound for most of the time."""
    return lambda seen: find(seen) if seen.held > _MOST_PART else ""


def _step(text: str) -> Callable[[Evidence], str]:
    return lambda seen: text.format(seen=seen)


_IDENTIFY = "soro excite, soro identify, then the same run with the file that they give"
_OTHER_ARM = f"see that each chamber is where the file has it (soro hil first-pressure); then {_IDENTIFY}"

_BOUND = PossibleCause(
    _when(lambda seen: seen.at_bound > AT_LIMIT_PART, "{seen.bound.name} holds set points back"),
    lambda seen: seen.bound.step,
)
_SATURATED = PossibleCause(
    _says("controller", "pressure saturated"),
    _step("a smaller load or motion; soro reach shows what the pressures can hold"),
)

# In the order of what a run shows for sure: a chamber that acts as another one, or is weak; what ended the
# commands, or the measurement; pressures that do not come, or are at a bound for most of the time; a loop
# that swings, which takes pressures to their bounds too; what holds back for a part of the time; the
# estimate; what the law could not learn in this run; what is left is the arm itself.
CAUSES = (
    # To a law a chamber that acts as another one looks weak.
    PossibleCause(
        lambda seen: seen.answers.text if seen.answers.grave else "", lambda seen: seen.answers.step
    ),
    PossibleCause(
        _says("controller", "of the force"),
        _step(f"check valve, line and bellow of this chamber; where they are right, {_IDENTIFY}"),
    ),
    PossibleCause(
        _says("controller", "fallen over"),
        _step("a smaller load or curvature; soro reach shows what the pressures can hold"),
    ),
    PossibleCause(
        _says("controller", "elongation"),
        _step("a smaller load, curvature or pressure, or least_elongation of the link in the robot file"),
    ),
    PossibleCause(
        _says("estimator", NO_ESTIMATE),
        _step("see that its sensors publish, in the right frame"),
    ),
    PossibleCause(_says("controller", NO_COMMAND), _step("what its text asks for; soro log has all of it")),
    PossibleCause(
        _when(lambda seen: seen.late > _LATE_PART, "{seen.late:.0%} of the cycles of the loop came too late"),
        _step("a machine that is less busy, a lower rate_hz, or --set mode=lockstep (docs/real_time.md)"),
    ),
    PossibleCause(
        _when(lambda seen: math.isnan(seen.error), "its sensor, or the recording of it, was silent"),
        _step("see with soro bag info RUN until when the tip was recorded"),
    ),
    PossibleCause(
        _when(lambda seen: bool(seen.pressure_off), "{seen.pressure_off}"),
        _step("check valve, supply and line of this chamber: soro hil first-pressure"),
    ),
    # A loop that swings between its bounds is at each of them for half of the time at most.
    PossibleCause(_mostly(_BOUND.find), _BOUND.step),
    PossibleCause(_mostly(_SATURATED.find), _SATURATED.step),
    PossibleCause(
        _says("controller", "limit cycle"),
        _step(
            "see that valves and sensors are as fast as the scene says (controller.probe_at_enable measures "
            "it), or lower controller.gains (soro gains shows them)"
        ),
    ),
    PossibleCause(
        _when(
            lambda seen: seen.swing_hz > 0.0, "the tip swings about its reference at {seen.swing_hz:.1f} Hz"
        ),
        _step(
            "lower controller.gains (soro gains shows them); the automatic ones are made of the robot file: "
            f"{_IDENTIFY}"
        ),
    ),
    _BOUND,
    _SATURATED,
    PossibleCause(
        _when(
            lambda seen: seen.at_slew > AT_LIMIT_PART,
            "{seen.at_slew:.0%} of the changes of set points are at limits.rise_pa_s or fall_pa_s",
        ),
        _step("a slower reference, or higher rates if the valves have them"),
    ),
    PossibleCause(
        _when(
            lambda seen: seen.estimator_error > max(0.5 * seen.error, 0.5 * seen.good),
            "the estimated tip is {seen.estimator_error:.1%} of the length away from the true one",
        ),
        _step("check place, noise and delay of the sensors; one sensor more: soro place-sensors"),
    ),
    PossibleCause(
        _when(lambda seen: seen.good_at_s > 0.0, "the error was still falling at the end"),
        _step("run longer: --set duration_s={seen.good_at_s:.0f}"),
    ),
    PossibleCause(
        _when(lambda seen: not seen.learns, "the law does not learn the load: controller.adapt is false"),
        _step("--set controller.adapt=true, or the load in the robot file (tip_mass)"),
    ),
    PossibleCause(
        _when(
            lambda seen: seen.touching > _TOUCHING_PART,
            "the arm touches something, with up to {seen.pushed_n:.3f} N ({seen.touching:.0%} of the time)",
        ),
        _step("look for an obstacle, a cable or a hose that it touches; to press on purpose: docs/force.md"),
    ),
    PossibleCause(
        _says("controller", "at its bound"),
        _step(f"the arm differs from its file by more than the law can learn: {_IDENTIFY}"),
    ),
    PossibleCause(
        _when(
            lambda seen: seen.free > _FREE_PART,
            "the arm is held back, or pushed, on a part of its way alone ({seen.free:.0%} of the time it is "
            "where it belongs)",
        ),
        _step("look for an obstacle, a cable or a hose that it touches there"),
    ),
    PossibleCause(lambda seen: seen.answers.text, lambda seen: seen.answers.step),
    PossibleCause(
        _says("controller", "poses are stamped"),
        _step("stamp each pose with the time at which it is taken, by the clock of chambers/state"),
    ),
    PossibleCause(
        _says("estimator", "NIS"),
        _step(f"see that the sensors are as the scene says; {_OTHER_ARM}"),
    ),
    PossibleCause(lambda seen: "the arm differs from its robot file", _step(_OTHER_ARM)),
)


def probable_cause(seen: Evidence) -> tuple[str, str]:
    """Return the most probable cause of a bad run, and the next step."""
    for cause in CAUSES:
        if text := cause.find(seen):
            return text, cause.step(seen)
    raise AssertionError("the last row always holds")


def end_of_commands(controller: str, estimator: str) -> str:
    """Return why no command was sent any more, as the nodes said it last; empty if they did not."""
    stopped = controller.startswith(NO_COMMAND)
    if estimator.startswith(NO_ESTIMATE) and (not stopped or NO_ESTIMATE in controller):
        return f"estimator: {estimator}"
    return f"controller: {controller}" if stopped else ""
