"""What an identification of a made arm may find, without its search: the true numbers, evaluated."""

from dataclasses import replace
from typing import Any

import numpy as np
from made_arm import record

from soro_core import load_robot
from soro_core.model import SoftArm
from soro_lab.identification.arm.cases.case import Whole
from soro_lab.identification.arm.choose import LawChoice, Trial
from soro_lab.identification.arm.frames import frame_numbers
from soro_lab.identification.arm.judge import errors, ranges, share_of_range, squares
from soro_lab.identification.arm.laws import LAWS, free_parameters, plain
from soro_lab.identification.arm.search.prepare import first_errors
from soro_lab.identification.arm.search.problem import Problem
from soro_lab.identification.arm.search.solve import evaluated
from soro_lab.identification.arm.search.uncertainty import certainty
from soro_lab.identification.arm.stages import ArmIdentification
from soro_lab.identification.recording import Recording

END_S = 6.0  # the levels of one chamber
HELD_S = 2.4, 3.6
DT, RATE_HZ = 0.005, 10.0


def runs(damaged: bool) -> list[Recording]:
    """Three runs of one arm; the last with a tracker that is late by a second, if it is damaged."""
    robot = plain(load_robot("tue_three_bellow"))
    found = [replace(record(robot, seed=k), name=f"run <{k}>") for k in (1, 2, 3)]
    if damaged:
        plate = found[2].plates[0]
        late = replace(plate, position=np.roll(plate.position, 100, axis=0))
        found[2] = replace(found[2], plates=(late,))
    return [run.window(0.0, END_S) for run in found]


def made(damaged: bool = True, **changes: Any) -> ArmIdentification:
    """Return the result; one section of each run is held out."""
    robot = plain(load_robot("tue_three_bellow"))
    recordings = runs(damaged)
    whole = tuple(Whole(r, DT, rate_hz=RATE_HZ) for r in recordings)
    held = tuple(Whole(r, DT, (HELD_S,), RATE_HZ) for r in recordings)
    fit = tuple(Whole(r, DT, ((0.0, HELD_S[0]), (HELD_S[1], END_S)), RATE_HZ) for r in recordings)
    moved = ranges(whole)
    expected = {"tip": first_errors(whole[0].shapes[0], moved["tip"])}
    # The frame is that of the runs that are whole.
    frames = frame_numbers(SoftArm(robot), whole[:2])
    problem = Problem(robot, whole, (*free_parameters(robot, (), "eb")[0], *frames), expected)
    solution = evaluated(problem, {})
    seen, unseen = replace(problem, cases=fit), replace(problem, cases=held)
    judged = errors(held, unseen.prediction_errors(solution.values), expected)
    own = squares(held, unseen.prediction_errors(solution.values), moved)
    chosen = Trial((), own, solution.values)
    other = Trial(LAWS[1:2], tuple(0.99 * each for each in own), solution.values)
    result = ArmIdentification(
        robot,
        problem,
        solution,
        certainty(problem, solution),
        LawChoice(chosen, (chosen, other)),
        errors(fit, seen.prediction_errors(solution.values), expected),
        judged,
        share_of_range(judged, moved),
        {"link0/gain": ("+link0/gain +link0/k_e", "+link0/gain")},
        fit_cases=fit,
        held_cases=held,
    )
    return replace(result, **changes)
