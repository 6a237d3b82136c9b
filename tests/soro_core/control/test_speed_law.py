"""Distance over time: limits of speed and acceleration hold, and nothing jumps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soro_core.control.motions.speed_law import speed_law

LENGTHS, SPEEDS = st.floats(1e-4, 1.0), st.floats(1e-3, 1.0)
ACCELERATIONS, CURVATURES = st.floats(1e-2, 10.0), st.floats(0.0, 1e3)


def sampled(law, n=1001, end_s=None):
    times = np.linspace(0.0, law.duration_s if end_s is None else end_s, n)
    return times, np.array([law.at(t) for t in times]).T


@settings(max_examples=60, deadline=None, derandomize=True)
@given(LENGTHS, SPEEDS, ACCELERATIONS, CURVATURES)
def test_speed_and_acceleration_keep_their_limits_on_every_curve(length, speed, acceleration, curvature):
    law = speed_law(length, speed, acceleration, curvature)
    _, (s, ds, dds) = sampled(law, 301)
    assert (s[0], ds[0], dds[0]) == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    assert s[-1] == pytest.approx(length)
    assert (ds[-1], dds[-1]) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert ds.max() <= speed * (1 + 1e-9)
    assert np.hypot(dds, curvature * ds**2).max() <= acceleration * (1 + 1e-9)


@settings(max_examples=12, deadline=None, derandomize=True)
@given(LENGTHS, SPEEDS, ACCELERATIONS, CURVATURES)
def test_speed_and_acceleration_are_the_derivatives_and_continuous(length, speed, acceleration, curvature):
    law = speed_law(length, speed, acceleration, curvature)
    rise, fall = sampled(law, end_s=1.2 * law.ramp_s), law.duration_s - 1.2 * law.ramp_s
    for times, (s, ds, dds) in (rise, (rise[0], np.array([law.at(fall + t) for t in rise[0]]).T)):
        h = times[1]
        assert np.diff(s) / h == pytest.approx(0.5 * (ds[1:] + ds[:-1]), abs=5e-6 * law.speed_m_s)
        assert np.diff(ds) / h == pytest.approx(0.5 * (dds[1:] + dds[:-1]), abs=1e-3 * np.abs(dds).max())
        # The largest slope of x^2 (1 - x)^2 is some three times its largest value.
        assert np.abs(np.diff(dds)).max() <= 4.0 * np.abs(dds).max() * h / law.ramp_s


def test_a_long_line_takes_the_limits_and_a_short_one_only_the_acceleration():
    long, short = (speed_law(length, 0.04, 0.1) for length in (0.1, 0.001))
    assert sampled(long)[1][1].max() == pytest.approx(0.04)
    assert sampled(short)[1][1].max() < 0.01
    for law in (long, short):
        assert np.abs(sampled(law)[1][2]).max() == pytest.approx(0.1, rel=1e-3)
