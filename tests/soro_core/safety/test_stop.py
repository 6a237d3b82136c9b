"""An emergency stop that is heard again and again: pressed, silent, several under one name; and the latch."""

import numpy as np
import pytest

from soro_core.errors import ConfigError
from soro_core.safety import Limiter, Limits, StopState, hear, why_stopped
from soro_hardware import load_platform
from soro_hardware.families import parse_platform
from tests.refused import refused

S = 1_000_000_000


def heard(*messages):
    """What was heard: time [s] and state of each message."""
    state = StopState()
    for time_s, is_pressed in messages:
        state = hear(state, is_pressed, round(time_s * S))
    return state


def why(state, time_s):
    return why_stopped(state, "/safety/stop", 0.5, round(time_s * S))


@pytest.mark.parametrize(
    ("messages", "time_s", "says"),
    [
        ([], 1.0, "no message on /safety/stop yet"),
        ([(1.0, False)], 1.5, None),
        ([(1.0, False)], 1.51, "stop silent: no message on /safety/stop for 0.51 s, allowed 0.5 s"),
        ([(1.0, True)], 1.0, "stop pressed: /safety/stop"),
        ([(1.0, True)], 2.0, "stop silent"),
        # Two publishers: the one that says pressed counts, whichever came last.
        ([(1.0, True), (1.1, False)], 1.1, "stop pressed"),
        ([(1.0, False), (1.1, True)], 1.1, "stop pressed"),
        ([(1.0, True), (1.1, False), (1.6, False)], 1.6, None),
    ],
)
def test_what_counts_as_pressed(messages, time_s, says):
    found = why(heard(*messages), time_s)
    assert (found is None) if says is None else (says in found)


class Stopped(Limiter):
    """A limiter with a stop by hand, in cycles of 5 ms."""

    def __init__(self):
        super().__init__(Limits(), ["link0/chamber0"])
        self.why, self.now_ns = None, 0
        self.why_stopped = lambda: self.why

    def cycle(self, pressure_pa):
        self.now_ns += 5_000_000
        self.offer(np.array([pressure_pa]), self.now_ns, self.now_ns)
        pressure_pa = self.slew(self.now_ns)[0]
        self.judge(np.zeros(1), True, self.now_ns)
        return pressure_pa


def test_a_stop_vents_in_the_cycle_latches_and_keeps_the_latch():
    limiter = Stopped()
    assert limiter.cycle(20e3) == 0.0
    assert limiter.cycle(20e3) > 0.0
    limiter.why = "stop pressed: here"
    assert limiter.cycle(20e3) == 0.0
    assert limiter.cause == "stop pressed: here"
    limiter.cycle(0.0)
    assert limiter.reset(lambda: limiter.now_ns) == "stop pressed: here"
    limiter.why = None
    assert limiter.cycle(20e3) == 0.0, "a released stop opens nothing"
    limiter.cycle(0.0)
    limiter.state = limiter.state._replace(command_pa=np.zeros(1))  # what it last accepted
    assert limiter.reset(lambda: limiter.now_ns) is None
    limiter.cycle(20e3)
    assert limiter.cycle(20e3) > 0.0


def platform(**keys):
    return parse_platform({**load_platform("emulated_canopen").model_dump(), **keys}, "test")


@pytest.mark.parametrize("topic", ["", "/safety/stop", "safety/stop", "stop", "/a/b_1/C"])
def test_topics(topic):
    assert platform(stop_topic=topic).stop_topic == topic


@pytest.mark.parametrize(
    "topic", ["/", "safety//stop", "safety/stop/", "1stop", "a b", "~/stop", "/safety/stop\n"]
)
def test_what_no_topic_is(topic):
    with refused("stop_topic", topic):
        platform(stop_topic=topic)


@pytest.mark.parametrize("timeout_s", [0.0, 0.04, 2.1, float("nan"), float("inf")])
def test_what_no_timeout_is(timeout_s):
    with pytest.raises(ConfigError, match="stop_timeout_s"):
        platform(stop_topic="stop", stop_timeout_s=timeout_s)
