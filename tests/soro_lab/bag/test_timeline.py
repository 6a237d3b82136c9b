"""Rate, pause and seek of a playback, without a clock."""

import pytest

from soro_lab.bag.timeline import Timeline

S = 10**9


def test_the_position_follows_the_rate():
    line = Timeline(10 * S, 100 * S, rate=2.0)
    assert line.at(99 * S) == 10 * S  # not started
    assert line.at(103 * S) == 16 * S
    assert line.wait_s(16 * S, 102 * S) == pytest.approx(1.0)
    assert line.wait_s(12 * S, 102 * S) == 0.0  # late
    slow = line.at_rate(0.5, 103 * S)
    assert slow.at(103 * S) == 16 * S
    assert slow.at(105 * S) == 17 * S


def test_a_pause_takes_no_recorded_time():
    line = Timeline(0, 0).pause(3 * S)
    assert line.at(50 * S) == 3 * S
    assert line.wait_s(4 * S, 50 * S) is None
    going = line.resume(60 * S)
    assert going.wait_s(4 * S, 60 * S) == pytest.approx(1.0)
    assert going.resume(61 * S) == going  # one that runs stays
    assert line.pause(70 * S).at(80 * S) == 3 * S


def test_a_seek_keeps_rate_and_pause():
    line = Timeline(0, 0, rate=4.0).seek(7 * S, 2 * S)
    assert (line.at(2 * S), line.at(3 * S)) == (7 * S, 11 * S)
    assert Timeline(0, 0).pause(S).seek(5 * S, 2 * S).at(9 * S) == 5 * S


def test_without_a_rate_everything_is_due_and_the_position_is_what_was_played():
    line = Timeline(0, 0, rate=0.0)
    assert line.wait_s(100 * S, 1) == 0.0
    assert line.reached(8 * S).at(50 * S) == 8 * S
    assert line.reached(8 * S).at_rate(1.0, 50 * S).at(51 * S) == 9 * S
    assert Timeline(0, 0).reached(8 * S).at(S) == S
