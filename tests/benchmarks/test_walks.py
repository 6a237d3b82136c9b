"""Functions and files that one tick of each part calls: they may become fewer, not more."""

import pytest

from benchmarks.walks import Walk
from benchmarks.walks import walks as all_walks

MOST = {
    "control tick": (103, 39),  # 17 of them learn the chambers, 7 are the loop of a force
    "CANopen cycle": (90, 22),
    "pose to state": (39, 13),  # one has the shape of the pressures checked, one tells the force
    "scene key to node": (115, 28),  # 3 of them are a law of a file, and noise that a scene states
}


@pytest.fixture(scope="module")
def walks():
    return all_walks()


@pytest.mark.slow
@pytest.mark.parametrize("name", MOST)
def test_a_tick_calls_no_more_functions_than_stated(walks, name):
    walk = walks[name]
    assert (len(walk) <= MOST[name][0], walk.files <= MOST[name][1]) == (True, True), walk.functions


def test_a_walk_has_each_named_function_of_the_project_once_in_its_order():
    from soro_core.pneumatics.lag import follow
    from soro_core.safety.monitor_state import chamber

    walk = Walk(chamber.__code__)
    with walk.taken():
        [follow(0.0, 1.0, 0.1, 0.1) for _ in range(2)]
        chamber(("a",), 0)
        sorted([2, 1], key=lambda one: -one)
    assert walk.functions == [("soro_core/pneumatics/lag.py", "follow")]
