"""Passages between references: whatever is asked for, the limits hold and nothing jumps."""

import control_samples
import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from soro_core import robot_from_dict
from soro_core.control.config import ReferenceConfig
from soro_core.control.motions.references import bounds_of
from soro_core.control.reference.active_reference import STREAM_S, follow, reference_ahead
from soro_core.control.reference.reference_transition import advance, begin, point, redirect
from soro_core.control.reference.trajectory import Circle, Hold, Waypoints
from soro_core.robot.coordinates import strain_fields

# Constant strains, and strains that vary along the link.
BASES = ({}, {"basis": "legendre", "order": 1})
DT = 0.005


def bounds(basis=0, **changes):
    strains = dict.fromkeys(("elongation", "bending_x", "bending_y"), BASES[basis])
    link = {**control_samples.LAW, "strains": strains}
    robot = robot_from_dict({**control_samples.ROBOT, "links": [link, link]})
    return bounds_of(strain_fields(robot), ReferenceConfig(**changes), 1)


BOUNDS = [bounds(basis) for basis in range(len(BASES))]


@st.composite
def references(draw, limits):
    """What comes by topic, or worse: targets beyond every limit too."""
    n = limits.strain.size

    def strains(factor):
        parts = st.lists(st.floats(-factor, factor, allow_subnormal=False), min_size=n, max_size=n)
        return np.array(draw(parts)) * limits.strain

    kind = draw(st.sampled_from(["hold", "circle", "waypoints"]))
    if kind == "hold":
        return Hold(strains(2.0))
    if kind == "circle":
        period = draw(st.floats(0.3, 10.0))
        return Circle(strains(0.5), strains(0.5), strains(0.5), 1.0, period, draw(st.floats(0.0, 1.0)))
    names = [str(k) for k in range(n)]
    times = np.cumsum(draw(st.lists(st.floats(0.05, 1.0), min_size=2, max_size=4)))
    return Waypoints(names, names, times, [strains(1.5) for _ in times])


@st.composite
def messages(draw, limits):
    """References, how long each is given [s], and the time for the way to it [s]."""
    times = st.floats(0.01, 0.6)
    row = st.tuples(references(limits), times, st.sampled_from([0.005, 0.05, 0.2, 1.0, 3.0]))
    return draw(st.lists(row, min_size=1, max_size=6)), draw(st.sampled_from([0.001, 0.005, 0.02]))


@pytest.mark.slow
@pytest.mark.parametrize("basis", range(len(BASES)))
@given(data=st.data())
@settings(deadline=None, max_examples=40, derandomize=True, phases=[Phase.generate])
def test_limits_hold_and_nothing_jumps_whatever_is_asked_for(basis, data):
    limits = BOUNDS[basis]
    fields, T = limits.fields, limits.smoothing_s
    asked, dt = data.draw(messages(limits))
    transition, t = (
        begin(limits, np.zeros(limits.strain.size), Hold(np.zeros(limits.strain.size)), 0.0, 1.0),
        0.0,
    )
    before = point(limits, transition)
    for target, seconds, within_s in asked:
        transition = redirect(limits, transition, target, t, within_s)
        # The point in force is the one that the new transition starts from.
        start = point(limits, transition)
        for one, two, size in zip(astuple(start), astuple(before), (1.0, 1 / T, 1 / T**2), strict=True):
            assert np.all(np.abs(one - two) <= 1e-9 * size * limits.strain)
        for _ in range(max(1, round(seconds / dt))):
            t += dt
            transition = advance(limits, transition, t, dt)
            now = point(limits, transition)
            assert np.all(fields.peaks(now.q) <= limits.strain * (1 + 1e-9))
            assert np.all(fields.peaks(now.qd) <= limits.rate * (1 + 1e-6) + 1e-9 * limits.strain / T)
            assert np.all(
                fields.peaks(now.qdd) <= 2 / T * limits.rate * (1 + 1e-6) + 1e-8 * limits.strain / T**2
            )
            # A jerk is that of the lead's rate, through both lags: no acceleration jumps.
            jerk = (now.qdd - before.qdd) / dt
            assert np.all(
                fields.peaks(jerk) <= 4 / T**2 * limits.rate * (1 + 1e-6) + 1e-7 * limits.strain / T**3
            )
            # The derivatives are those of what came before.
            moved = before.q + dt * before.qd
            assert np.all(np.abs(now.q - moved) <= dt * dt / T * limits.rate * 2 + 1e-9 * limits.strain)
            before = now


def astuple(at):
    return at.q, at.qd, at.qdd


@pytest.mark.slow
@pytest.mark.parametrize("basis", range(len(BASES)))
@given(data=st.data())
@settings(deadline=None, max_examples=15, derandomize=True, phases=[Phase.generate])
def test_what_was_asked_for_last_is_reached(basis, data):
    limits = BOUNDS[basis]
    asked, _ = data.draw(messages(limits))
    goal = data.draw(references(limits).filter(lambda one: isinstance(one, Hold)))
    zero = np.zeros(limits.strain.size)
    transition, t = begin(limits, zero, Hold(zero), 0.0, 1.0), 0.0
    for target, seconds, within_s in [*asked, (goal, 60.0, 0.2)]:
        transition = redirect(limits, transition, target, t, within_s)
        for _ in range(max(1, round(seconds / 0.02))):
            t += 0.02
            transition = advance(limits, transition, t, 0.02)
    end = point(limits, transition)
    assert np.all(np.abs(end.q - limits.fields.within(goal.q, limits.strain)) <= 1e-9 * limits.strain)
    assert np.all(np.abs(end.qd) <= 1e-9 * limits.strain)


def test_a_target_within_the_limits_is_followed_exactly_after_the_way_to_it():
    limits = BOUNDS[0]
    across, along = (limits.fields.of(name) for name in ("bending_x", "bending_y"))
    circle = Circle(0.1 * limits.fields.of("elongation"), across, along, 5.0, 4.0, 0.3)
    zero = np.zeros(limits.strain.size)
    transition = redirect(limits, begin(limits, zero, Hold(zero), 0.0, 1.0), circle, 0.0, 1.0)
    for k in range(1, 801):
        transition = advance(limits, transition, k * DT, DT)
    for one, two in zip(astuple(point(limits, transition)), astuple(circle.sample(4.0)), strict=True):
        assert one.tolist() == two.tolist()


@pytest.mark.parametrize("h", [0.1, 1.0])
def test_derivatives_against_differences(h):
    """Of a transition that is nowhere at its limits: q, qd and qdd belong together, at every step."""
    limits, step = BOUNDS[0], h * BOUNDS[0].smoothing_s
    zero = np.zeros(limits.strain.size)
    transition = redirect(
        limits, begin(limits, zero, Hold(zero), 0.0, 1.0), Hold(0.05 * limits.strain), 0.0, 3.0
    )
    here, fine = advance(limits, transition, step, step), 1e-5
    parts = [point(limits, advance(limits, here, step + x, x)) for x in (fine, 2 * fine, 3 * fine)]
    assert parts[1].qd == pytest.approx((parts[2].q - parts[0].q) / (2 * fine), rel=1e-4)
    assert parts[1].qdd == pytest.approx((parts[2].qd - parts[0].qd) / (2 * fine), rel=1e-4)
    # One step and many end in the same place.
    many = transition
    for k in range(1, 11):
        many = advance(limits, many, k * step / 10, step / 10)
    assert point(limits, many).q == pytest.approx(point(limits, here).q, rel=1e-6)


def test_a_reference_waits_while_there_are_no_ticks():
    limits = BOUNDS[0]
    across, along = (limits.fields.of(name) for name in ("bending_x", "bending_y"))
    circle = Circle(np.zeros(limits.strain.size), across, along, 5.0, 4.0, 0.0)
    state = follow(limits, 1.0, circle, None, np.zeros(limits.strain.size), 0.0, DT, None)
    for k in range(1, 401):
        state = follow(limits, 1.0, circle, state, None, k * DT, DT, None)
    before, state = (
        reference_ahead(limits, state, 0.0),
        follow(limits, 1.0, circle, state, None, 3.0, DT, None),
    )
    after = reference_ahead(limits, state, 0.0)
    assert np.all(limits.fields.peaks(after.q - before.q) <= DT * limits.rate * (1 + 1e-9))
    for k in range(1, 1001):
        state = follow(limits, 1.0, circle, state, None, 3.0 + k * DT, DT, None)
    assert reference_ahead(limits, state, 0.0).q == pytest.approx(circle.sample(8.0).q, abs=1e-6)


@pytest.mark.parametrize("hz", [5, 20, 200])
def test_a_stream_is_one_message_late_and_comes_to_rest_where_it_stops(hz):
    """The way from one message to the next is even, and takes as long as they are apart."""
    limits, start_s = BOUNDS[0], 3.0
    elongation, zero = limits.fields.of("elongation"), np.zeros(limits.strain.size)
    state, given_, rows = None, None, []
    for k in range(1200):
        t = k * DT
        if k % round(1 / hz / DT) == 0 and k <= 800:
            given_ = Hold(0.02 * t * elongation)  # a ramp
        state = follow(limits, start_s, Hold(zero), state, zero, t, DT, given_)
        now = reference_ahead(limits, state, 0.0)
        rows.append((t, now.q[0], now.qd[0]))
    t, q, qd = np.array(rows).T
    late = (t > 3.0) & (t < 4.0)
    lag = t[late] - q[late] / 0.02
    assert lag == pytest.approx(1 / hz + 2 * limits.smoothing_s, abs=DT + 1e-3)
    assert qd[late] == pytest.approx(0.02, rel=1e-2)
    # After the last message: no further than it, no faster than before, and at rest.
    assert q.max() <= 0.02 * 4.0 * (1 + 1e-9)
    assert np.all((qd[t >= 4.0] >= -1e-9) & (qd[t >= 4.0] <= 0.0202))
    assert (q[-1], qd[-1]) == pytest.approx((0.08, 0.0), abs=1e-9)


def test_what_is_given_alone_is_walked_to_slowly():
    limits, zero = BOUNDS[0], np.zeros(BOUNDS[0].strain.size)
    goal = Hold(0.5 * limits.strain)
    state = follow(limits, 3.0, Hold(zero), None, zero, 0.0, DT, None)
    fastest = 0.0
    for k in range(1, 1201):
        state = follow(limits, 3.0, Hold(zero), state, zero, k * DT, DT, goal)
        fastest = max(fastest, float(np.max(reference_ahead(limits, state, 0.0).qd / goal.q)))
    assert fastest == pytest.approx(1 / 3.0, rel=1e-3)
    assert reference_ahead(limits, state, 0.0).q.tolist() == goal.q.tolist()
    assert STREAM_S < 3.0
