"""The front is what no other beats."""

from hypothesis import given
from hypothesis import strategies as st

from soro_lab.trade.results import near_front, pareto

points = st.lists(st.tuples(st.floats(0.1, 10), st.floats(0.1, 10)), min_size=1, max_size=30)


def cost(point):
    return point[0]


def error(point):
    return point[1]


def beats(one, other):
    return one != other and one[0] <= other[0] and one[1] <= other[1]


@given(points)
def test_nothing_beats_the_front_and_the_front_beats_the_rest(items):
    front = pareto(items, cost, error)
    assert not any(beats(item, f) for item in items for f in front)
    assert all(item in front or any(beats(f, item) for f in front) for item in items)
    assert [f[0] for f in front] == sorted({f[0] for f in front})


@given(points, st.floats(1.01, 3.0))
def test_near_is_the_front_and_what_is_not_beaten_by_the_factor(items, factor):
    near = near_front(items, cost, error, factor)
    assert near[: len(pareto(items, cost, error))] == pareto(items, cost, error)
    for item in items:
        beaten = any(factor * f[0] < item[0] and factor * f[1] < item[1] for f in items)
        assert (item in near) != beaten
