"""A load at the tip that is hung on and taken off while the arm moves."""

from dataclasses import replace

import numpy as np
import pytest

from soro_core import load_robot
from soro_core.config import find_config, parse, with_changes
from soro_core.twin import Twin, TwinConfig
from tests.refused import refused

PRESSURE = np.array([10e3, 20e3, 15e3])
CHANGES = {"at_s": [0.02, 0.03], "payload_kg": [0.02, 0.005]}


@pytest.fixture(scope="module")
def robot():
    return load_robot(find_config("tue_three_bellow", "robots"))


def config(**keys):
    return parse({"refine": 1, "payload_changes": CHANGES, **keys}, TwinConfig, "test")


def test_the_arm_carries_each_load_from_its_time_on(robot):
    twin, state = Twin(robot, config()), Twin(robot, config()).initial()
    of_one = {
        mass: Twin(robot, with_changes(config(), payload_kg=mass, payload_changes={}))
        for mass in (0.0, 0.02, 0.005)
    }
    for tick in range(8):  # 5 ms each
        mass = 0.0 if tick < 4 else 0.02 if tick < 6 else 0.005
        assert config().payload_at(tick * twin.dt) == mass
        after = twin.step_pressures(state, PRESSURE)
        alone = of_one[mass].step_pressures(state, PRESSURE)
        np.testing.assert_array_equal(after.arm.q, alone.arm.q)
        others = [other for m, other in of_one.items() if m != mass]
        assert all(np.any(other.step_pressures(state, PRESSURE).arm.q != after.arm.q) for other in others)
        state = after


def test_the_times_count_from_the_begin_of_control(robot):
    twin = Twin(robot, config())
    light = Twin(robot, with_changes(config(), payload_changes={}))
    waiting = replace(twin.initial(), start_tick=None, tick=100)
    late = replace(waiting, start_tick=98)  # 10 ms ago
    started = replace(waiting, start_tick=96)  # 20 ms ago
    alone = light.step_pressures(waiting, PRESSURE).arm.q
    for state, changes in ((waiting, False), (late, False), (started, True)):
        assert np.any(twin.step_pressures(state, PRESSURE).arm.q != alone) == changes


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({"at_s": [1.0], "payload_kg": []}, ("1 and 0",)),
        ({"at_s": [2.0, 1.0], "payload_kg": [0.0, 0.1]}, ("increase",)),
        ({"at_s": [0.0], "payload_kg": [0.1]}, ("above 0",)),
        ({"at_s": [1.0], "payload_kg": [-0.1]}, ("0 to 5 kg",)),
    ],
)
def test_changes_that_cannot_be_are_refused(changes, names):
    with refused("payload_changes", names=names):
        config(payload_changes=changes)
