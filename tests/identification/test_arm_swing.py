"""A start that swings at the frequency of the arm, where its rests do not show stiffness and gain apart."""

import numpy as np
from made_arm import record

from soro_core import load_robot
from soro_core.identification.arm.frames import frame_numbers
from soro_core.identification.arm.judge import ranges
from soro_core.identification.arm.laws import freed, plain
from soro_core.identification.arm.numbers import numbers_of, with_numbers
from soro_core.identification.arm.prepare import first_errors, split
from soro_core.identification.arm.problem import Problem
from soro_core.identification.arm.swing import swinging
from soro_core.model import SoftArm


def test_a_stiffness_that_is_half_is_doubled_and_the_gain_with_it() -> None:
    robot = plain(load_robot("tue_three_bellow"))
    true = numbers_of(robot)
    ringing = with_numbers(robot, {"link0/damping_b": 0.3 * true["link0/damping_b"].value})
    runs, held = split([record(ringing)], 0.005, 20.0)
    numbers = (*freed(ringing, (), "eb")[0], *frame_numbers(SoftArm(ringing), runs))
    moved = ranges([*runs, *held])
    expected = {s.name: first_errors(s, moved[s.name]) for case in runs for s in case.shapes}
    problem = Problem(ringing, tuple(runs), numbers, expected)
    names = ("link0/k_e", "link0/k_b", "link0/gain")
    true = numbers_of(ringing)
    half = {name: 0.5 * true[name].value for name in names}
    # The arm as described is the right one here: without it the rests alone begin the search.
    begun = swinging(problem, {**half, "link0/damping_b": 0.7 * true["link0/damping_b"].value})
    for name in names:
        assert abs(np.log(begun[name] / true[name].value)) < 0.13
    assert problem.cost(begun) < 0.5 * problem.cost({n.name: half.get(n.name, n.value) for n in numbers})
    assert problem.cost({**begun, "link0/k_b": -1.0}) == np.inf
