"""The one first-order lag of regulators, predictions and filters."""

import numpy as np
import pytest

from soro_core.pneumatics.lag import follow


def test_exact_for_any_step():
    tau_s = 0.05
    whole = follow(10.0, 30.0, 0.08, tau_s)
    assert whole == pytest.approx(30.0 - 20.0 * np.exp(-0.08 / tau_s))
    assert follow(follow(10.0, 30.0, 0.03, tau_s), 30.0, 0.05, tau_s) == pytest.approx(whole)


def test_no_lag_is_there_at_once():
    assert follow(10.0, 30.0, 1e-6, 0.0) == 30.0
    assert follow(10.0, 30.0, 0.0, 0.0) == 10.0, "no time has passed"


def test_each_chamber_has_its_own_times():
    value, target = np.array([0.0, 10.0, 5.0]), np.array([10.0, 0.0, 5.0])
    times, taus = np.array([0.1, 0.2, 0.3]), np.array([0.05, 0.0, 0.1])
    found = follow(value, target, times, taus)
    expected = [follow(*map(float, row)) for row in zip(value, target, times, taus, strict=True)]
    np.testing.assert_allclose(found, expected, rtol=1e-15)
