"""A load beyond the bound of the learned mass is named."""

from loop_harness import Harness, Setup

from soro_core import load_robot
from soro_core.config import find_config, parse
from soro_core.control import Controller, ControllerConfig
from soro_core.estimation import Estimator
from soro_core.loop import Loop

BOUND_KG, LOAD_KG = 0.04, 0.045


def test_a_load_beyond_the_bound_of_the_learned_mass_is_named_within_two_seconds():
    robot = load_robot(find_config("tue_three_bellow", "robots"))
    keys = {"law": "composite", "law_options": {"mass_upper_kg": BOUND_KG}}
    control = parse(keys, ControllerConfig, "test")
    setup = Setup(control=control, payload_kg=LOAD_KG)
    loop = Loop(Estimator(robot, setup.estimation, setup.dt), Controller(robot, control))
    masses, named_s = [], None
    for tick in loop.run(Harness(robot, setup), round(2.0 / setup.dt), setup.dt, delay=0):
        masses.append(tick.command.learned.mass_kg)
        if named_s is None and "bound" in tick.command.status.note:
            named_s = tick.t_s
    at_bound_s = masses.index(BOUND_KG) * setup.dt
    assert max(masses) == BOUND_KG
    assert named_s is not None
    print(f"at its bound after {at_bound_s:.2f} s, named after {named_s:.2f} s")
    assert at_bound_s < named_s <= 2.0
