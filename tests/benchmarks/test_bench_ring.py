"""Frequency and damping ratio of a ring-down: of a made one, and what cannot be one."""

import numpy as np
import pytest

from benchmarks.ring import ring_of
from soro_core.errors import ModelError


@pytest.mark.parametrize(("frequency", "damping"), [(8.2, 0.07), (7.7, 0.1), (5.0, 0.02)])
def test_a_made_ring_down_is_found(frequency: float, damping: float) -> None:
    draw = np.random.default_rng(1)
    t = np.delete(np.arange(0.0, 0.8, 0.01), [5, 6, 20, 41])  # repeated samples are left out
    w = 2.0 * np.pi * frequency
    sine = np.exp(-damping * w * t) * np.cos(w * np.sqrt(1.0 - damping**2) * t + 0.7)
    y = 3.0 + 2.0 * t - 1.0 * t**2 + sine + draw.normal(0.0, 5e-3, len(t))
    found = ring_of(10.0 + t, 1e-4 * y)  # of any unit
    assert found.frequency_hz == pytest.approx(frequency, rel=0.005)
    assert found.damping_ratio == pytest.approx(damping, rel=0.06)


def test_too_few_samples_are_refused() -> None:
    t = np.arange(0.0, 0.1, 0.01)
    with pytest.raises(ModelError) as caught:
        ring_of(t, np.cos(50.0 * t))
    assert caught.value.key == "t"


def test_what_grows_is_no_ring_down() -> None:
    t = np.arange(0.0, 0.8, 0.01)
    with pytest.raises(ModelError) as caught:
        ring_of(t, np.exp(3.0 * t) * np.cos(50.0 * t))
    assert caught.value.key == "y"
