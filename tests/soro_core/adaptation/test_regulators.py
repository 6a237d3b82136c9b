"""The observer of the regulators finds what they add to their commands."""

import numpy as np
import pytest

from soro_core.adaptation import RegulatorObserver
from soro_core.pneumatics.lag import follow

DT, LAG, DEAD = 0.005, 0.052, 0.010


def observe(observer, bias_pa, ticks=400, dead=2, gain=1.0, target=lambda k: 30e3):
    """Bias found on a regulator whose pressure begins to follow `dead` ticks after a command."""
    state = observer.initial_state(np.zeros(1))
    pressure, commands, found = np.zeros(1), [np.zeros(1)] * (dead + 1), []
    for k in range(ticks):
        pressure = follow(pressure, gain * commands[-1 - dead] + bias_pa, DT, LAG)
        state = observer.observe(state, pressure, DT)
        found.append(state.bias_pa[0])
        commands.append(np.array([target(k)]))
        state = observer.commanded(state, commands[-1])
    return np.array(found)


def test_a_bias_is_found():
    found = observe(RegulatorObserver(LAG, DEAD), 2e3)
    assert found[-1] == pytest.approx(2e3, rel=0.01)


def test_a_declared_dead_time_is_no_bias():
    """While the set points move."""
    moving = {"target": lambda k: 30e3 + 20e3 * np.sin(0.05 * k)}
    known = observe(RegulatorObserver(LAG, DEAD), 0.0, **moving)
    unknown = observe(RegulatorObserver(LAG, 0.0), 0.0, **moving)
    assert np.abs(known[100:]).max() < 1.0
    assert np.abs(unknown[100:]).max() > 1e3


def test_a_gain_is_taken_up_as_a_bias_within_bounds():
    found = observe(RegulatorObserver(LAG, DEAD), 0.0, gain=0.9)
    assert found[-1] == pytest.approx(-3e3, rel=0.01)
    assert observe(RegulatorObserver(LAG, DEAD), 20e3).max() == 6e3


def through_play(width, command, target):
    """Target of a regulator with play."""
    return np.clip(target, command - 0.5 * width, command + 0.5 * width)


@pytest.mark.parametrize("told", [0.0, 900.0])
def test_what_a_play_adds_is_known_when_the_command_turns(told):
    observer = RegulatorObserver(LAG, DEAD, play_pa=told)
    state, target = observer.initial_state(np.zeros(1)), np.zeros(1)
    pressure, targets, late = np.zeros(1), [np.zeros(1)] * 3, []
    for k in range(800):
        pressure = follow(pressure, targets[-3], DT, LAG)
        state = observer.observe(state, pressure, DT)
        command = np.array([30e3 + 15e3 * np.sin(4.0 * DT * k)])
        state, target = observer.commanded(state, command), through_play(900.0, command, target)
        targets.append(target)
        late.append((state.bias_pa + state.play_pa)[0] - (target - command)[0])
    worst = np.abs(late[400:]).max()
    print(f"play told {told:g} Pa: {worst:.0f} Pa late")
    if told:
        assert worst < 20.0
    else:
        assert worst > 200.0
