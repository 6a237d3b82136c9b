"""Lateness of a loop: against the schedule of its timer, whatever its first cycles do."""

from __future__ import annotations

import numpy as np
import pytest

from soro_hardware import timing

PERIOD_S = 0.005


def timed(monkeypatch, times_s):
    """Return the timer after cycles at these times."""
    timer, rest = timing.LoopTimer(PERIOD_S), iter(times_s)
    monkeypatch.setattr(timing.time, "perf_counter", lambda: next(rest))
    for _ in times_s:
        timer.tick()
    return timer


def on_time(count, first=0):
    return PERIOD_S * np.arange(first, first + count)


def test_what_is_late_is_late_against_the_earliest_cycle(monkeypatch):
    late_s = np.zeros(1020)
    late_s[::50] = 1e-3  # 2 %
    timer = timed(monkeypatch, on_time(1020) + late_s)
    assert timer.percentile_ms(50) == pytest.approx(0.0, abs=1e-9)
    assert timer.percentile_ms(99) == pytest.approx(1.0, abs=1e-9)
    assert timer.overruns == 0


def test_first_cycles_in_a_bunch_are_not_taken_for_the_schedule(monkeypatch):
    # Measured as an executor began: two calls that were due, and the schedule after them.
    bunch = np.array([1.75e-3, 4.08e-3])
    timer = timed(monkeypatch, [*bunch, *on_time(1000, first=2)])
    assert timer.percentile_ms(99) == pytest.approx(0.0, abs=1e-9)


def test_periods_without_a_cycle_are_counted_and_the_schedule_stays(monkeypatch):
    stall = on_time(100, first=103)
    timer = timed(monkeypatch, [*on_time(100), *stall])
    assert timer.overruns == 3
    assert timer.percentile_ms(50) == pytest.approx(0.0, abs=1e-9)


def test_nothing_is_said_before_there_is_a_schedule(monkeypatch):
    timer = timed(monkeypatch, on_time(timing.UNSETTLED))
    assert timer.percentile_ms(99) == 0.0
