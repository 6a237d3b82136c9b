"""Inverse of the regulator's lag: exact without bounds, no wind-up at them."""

import math

import numpy as np
import pytest

from soro_core.control.pressures.lag_compensation import compensate
from soro_core.pneumatics.lag import follow

LOW, HIGH = np.zeros(1), np.full(1, 90e3)


def run(wishes, tau=0.052, left=0.02, dt=0.005):
    pressure = model = np.full(1, 40e3)
    trace = []
    for wish in wishes:
        command = compensate(np.array([wish]), model, tau, left, LOW, HIGH)
        pressure = command + (pressure - command) * math.exp(-dt / tau)
        model = follow(model, command, dt, tau)
        trace.append(float(pressure[0]))
    return np.array(trace)


def test_a_step_arrives_with_the_time_constant_that_is_left():
    trace = run([50e3] * 40)
    # Sampled at 5 ms the pole is 1 - (1 - exp(-dt/tau)) tau/left instead of exp(-dt/left).
    pole = 1.0 - (1.0 - math.exp(-0.005 / 0.052)) * 0.052 / 0.02
    assert trace == pytest.approx(50e3 - 10e3 * pole ** np.arange(1, 41), abs=1e-6)
    assert trace[3] > 40e3 + 10e3 * (1 - math.exp(-0.02 / 0.024))


def test_the_command_stays_in_its_bounds_and_does_not_wind_up():
    trace = run([200e3] * 60 + [60e3] * 4)
    assert trace[:60].max() <= 90e3
    assert trace[59] == pytest.approx(90e3, rel=3e-3)
    # Coming back takes as long as without the excursion: the model knows what really happened.
    assert trace[63] < 60e3 + 30e3 * math.exp(-0.02 / 0.024)


def test_no_lag_hands_the_wish_through():
    assert compensate(np.array([47e3]), np.array([1.0]), 0.0, 1.0, LOW, HIGH).tolist() == [47e3]
    assert follow(np.array([1.0]), np.array([47e3]), 0.005, 0.0).tolist() == [47e3]
