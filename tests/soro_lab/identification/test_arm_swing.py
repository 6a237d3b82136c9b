"""A start that swings at the frequency of the arm, where its rests do not show stiffness and gain apart."""

import numpy as np
from made_arm import record

from soro_core import load_robot
from soro_core.model import SoftArm
from soro_lab.identification.arm.cases.parameters import numbers_of, with_numbers
from soro_lab.identification.arm.frames import frame_numbers
from soro_lab.identification.arm.judge import ranges
from soro_lab.identification.arm.laws import free_parameters, plain
from soro_lab.identification.arm.search.blind import swinging
from soro_lab.identification.arm.search.prepare import first_errors, split
from soro_lab.identification.arm.search.problem import Problem


def test_a_stiffness_that_is_half_is_doubled_and_the_gain_with_it() -> None:
    robot = plain(load_robot("tue_three_bellow"))
    at = numbers_of(robot)
    ringing = with_numbers(robot, {"link0/damping_b": 0.3 * at["link0/damping_b"].value})
    names = ("link0/k_e", "link0/k_b", "link0/gain")
    described = with_numbers(ringing, {name: 0.5 * at[name].value for name in names})
    runs, held = split([record(ringing)], 0.005, 20.0)
    numbers = (*free_parameters(described, (), "eb")[0], *frame_numbers(SoftArm(described), runs))
    moved = ranges([*runs, *held])
    expected = {s.name: first_errors(s, moved[s.name]) for case in runs for s in case.shapes}
    problem = Problem(described, tuple(runs), numbers, expected)
    started = swinging(problem, {"link0/damping_b": 0.7 * numbers_of(described)["link0/damping_b"].value})
    middle = {n.name: n.value for n in numbers}
    for name in names:
        assert abs(np.log(started[name] / (2.0 * middle[name]))) < 0.13
    assert problem.cost(started) < 0.5 * problem.cost(middle)
    # A candidate that no arm has is no start.
    assert problem.cost({**started, "link0/k_b": -1.0}) == np.inf
