"""Names of publishers: an honest program is never taken for two, two under one name are found."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from soro_core.safety import (
    Limits,
    Names,
    doubt,
    initial_state,
    note_message,
    offer,
    request_vent,
    reset,
    slew,
)
from soro_core.safety.names import MISSED

STEPS = st.lists(st.integers(1, MISSED), min_size=1, max_size=30)


def _after(messages: list[tuple[str, int | None]], publishers: int = 2, names: Names | None = None) -> Names:
    names = names or Names()
    for name, number in messages:
        names = note_message(names, name, number, publishers)
    return names


@given(STEPS, STEPS, st.integers(0, 10**6), st.integers(0, 10**6), st.randoms(use_true_random=False))
def test_programs_with_names_of_their_own_are_told_apart_whatever_is_missed(one, two, first, second, random):
    waiting = {
        "one": [first + int(n) for n in np.cumsum(one)],
        "two": [second + int(n) for n in np.cumsum(two)],
    }
    messages = []
    while any(waiting.values()):
        name = random.choice([name for name, left in waiting.items() if left])
        messages.append((name, waiting[name].pop(0)))
    assert not _after(messages).shared


@given(st.integers(1, 10**6), st.integers(1, 10**6))
def test_two_programs_of_one_name_are_found_when_each_has_spoken_twice(first, second):
    names = _after([("n", first), ("n", second), ("n", first + 1), ("n", second + 1)])
    assert names.shared == {"n"}
    assert note_message(names, "n", first + 2, 2).shared == {"n"}  # and it stays so


@given(STEPS, st.integers(0, 100))
def test_a_single_program_may_begin_anew_at_any_time(steps, again):
    before = [("n", int(n)) for n in np.cumsum(steps)]
    assert not _after([*before, ("n", again)], publishers=1).shared


def test_without_numbers_two_programs_cannot_be_told_apart():
    assert not _after([("n", None), ("n", None)], publishers=1).shared
    assert _after([("n", None)]).shared == {"n"}


def test_a_command_in_doubt_ends_the_way_to_the_last_one_and_does_not_open_a_latch():
    limits, ms = Limits(), 1_000_000
    state, _ = offer(limits, initial_state(1), np.array([50e3]), 0, 0, "a")
    for now_ns in (0, 5 * ms):
        state = slew(limits, state, now_ns)
    reached = state.setpoint_pa
    assert 0.0 < reached[0] < 50e3
    other = doubt(state, "same name: of others", "b")
    assert other.command_pa == state.command_pa
    state = doubt(state, "same name: twice", "a")
    assert state.rejected == {"same name": 1}
    for now_ns in range(10 * ms, 100 * ms, 5 * ms):
        state = slew(limits, state, now_ns)
        assert state.setpoint_pa == reached
    assert state.cause is None
    state = slew(limits, state, 105 * ms)
    assert state.cause.startswith("command lost")
    state = doubt(request_vent(state, "x"), "same name: twice", "a")
    assert "asked last for pressure" in reset(limits, state, 110 * ms)[1]
