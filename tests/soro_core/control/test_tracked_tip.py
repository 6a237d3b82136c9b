"""The tip as the force loop tracks it: calm where it rests, quick where it moves."""

import numpy as np
import pytest

from soro_core.control.force.tracked_tip import FILTER_S, QUICK_S, Track, tracked

DT, NOISE_M = 0.005, 3e-4
HERE, STILL = np.array([0.02, 0.0, 0.06]), np.zeros(3)


def tracks(tips, touches=True, noise_m=NOISE_M, seed=1):
    """What is tracked at each tick of measured tips (n, 3); measured every second tick, behind 25 rad/s."""
    rng, seen, part = np.random.default_rng(seed), tips[0], 1.0 - np.exp(-25.0 * 2 * DT)
    state, found = None, []
    for k, tip in enumerate(tips):
        if k % 2 == 0:
            seen = seen + part * (tip + rng.normal(0.0, noise_m, 3) - seen)
        state = tracked(state, Track(tip, STILL), seen, touches, DT)
        found.append(state)
    return found


def moving(seconds, from_s, speed):
    """A tip that rests, then moves at a speed along x."""
    times = np.arange(0.0, seconds, DT)
    return HERE + np.outer(np.clip(times - from_s, 0.0, None) * speed, [1.0, 0.0, 0.0])


def test_a_tip_that_rests_is_tracked_more_calmly_the_longer_it_rests():
    found = tracks(moving(8.0, 9.0, 0.0))
    quick, calm = (np.array([getattr(one, kind).tip for one in found]) - HERE for kind in ("quick", "calm"))
    half, late = slice(round(0.5 / DT), round(1.5 / DT)), slice(round(4.0 / DT), None)
    assert calm[late].std() < 0.4 * quick[late].std()
    assert calm[late].std() < 0.7 * calm[half].std()


@pytest.mark.parametrize("seed", range(1, 6))
def test_a_tip_that_begins_to_move_is_tracked_without_lag(seed):
    tips = moving(6.0, 4.0, 0.01)
    found = tracks(tips, seed=seed)
    off = np.array([one.tip for one in found]) - tips
    since = round(4.0 / DT)
    assert np.abs(off[since:, 0]).max() < 1.3e-3, "what it goes in 0.13 s"
    assert np.abs(off[since + round(0.8 / DT) :, 0]).max() < 4e-4
    assert found[-1].speed == pytest.approx([0.01, 0.0, 0.0], abs=2e-3)


def test_a_tip_in_free_air_is_tracked_quickly():
    assert all(one.calm is one.quick and one.rests_s == 0.0 for one in tracks(moving(3.0, 1.0, 0.01), False))


def test_a_tip_that_nobody_measures_is_that_of_the_filter():
    state = tracked(None, Track(HERE, STILL), None, True, DT)
    there = HERE + 1e-3
    state = tracked(state, Track(there, STILL), None, True, DT)
    assert state.calm == state.quick
    part = 1.0 - np.exp(-DT / FILTER_S)
    assert state.tip == pytest.approx(HERE + part * (2.0 - part) * 1e-3)
    measured = tracked(state, Track(there, STILL), there, True, DT)
    assert np.linalg.norm(measured.tip - there) < np.linalg.norm(state.tip - there)
    assert QUICK_S < FILTER_S


def test_a_wall_that_rests_stops_what_is_tracked():
    state = tracked(None, Track(HERE, np.ones(3)), None, True, DT).stopped()
    assert (state.speed.tolist(), state.quick.speed.tolist(), state.rests_s) == ([0.0] * 3, [0.0] * 3, 0.0)
