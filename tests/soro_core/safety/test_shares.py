"""Several arms behind one limiter: each commands its own chambers, and what vents one of them vents all."""

import numpy as np
import pytest

from soro_core.safety import Limiter, Limits

MS = 1_000_000
NAMES = tuple(f"{arm}/link0/chamber{k}" for arm in ("thumb", "index") for k in range(2))
AIR = np.zeros(4)


class Hand:
    """A limiter of two arms of two chambers, and its cycles of 5 ms."""

    def __init__(self):
        self.limiter, self.now_ns = Limiter(Limits(), NAMES), 0
        self.arms = self.limiter.of_arms()

    def offer(self, arm, *command_pa, source="controller"):
        return self.arms[arm].offer(np.array(command_pa), self.now_ns, self.now_ns, source)

    def run(self, seconds, reading_pa=AIR, **commands):
        for _ in range(round(seconds / 0.005)):
            self.now_ns += 5 * MS
            for arm, command in commands.items():
                assert self.offer(arm, *command) is None
            self.limiter.slew(self.now_ns)
            self.limiter.judge(reading_pa, True, self.now_ns)


def test_one_arm_has_no_share_and_commands_the_limiter_itself():
    limiter = Limiter(Limits(), ("link0/chamber0", "link0/chamber1"))
    assert (limiter.state.shares, limiter.of_arms()) == ((), {"": limiter})


def test_each_arm_moves_its_own_chambers():
    hand = Hand()
    assert hand.arms["index"].names == ("link0/chamber0", "link0/chamber1")
    hand.run(0.02, thumb=(3e3, 4e3))
    assert np.flatnonzero(hand.limiter.state.setpoint_pa).tolist() == [0, 1]
    hand.run(0.5, thumb=(3e3, 4e3), index=(0.0, 5e3), reading_pa=np.array([3e3, 4e3, 0.0, 5e3]))
    assert hand.limiter.state.setpoint_pa.tolist() == [3e3, 4e3, 0.0, 5e3]


@pytest.mark.parametrize("command", [(np.nan, 0.0), (0.0,), (1e6, 0.0)])
def test_a_bad_command_of_one_arm_is_refused_by_the_name_of_its_chamber(command):
    hand = Hand()
    hand.run(0.05, thumb=(0.0, 0.0), index=(0.0, 0.0))
    before = hand.limiter.state
    refusal = hand.offer("index", *command)
    assert refusal.startswith(
        "wrong length" if len(command) < 2 else ("not finite: index/", "out of range: index/")
    )
    assert hand.limiter.state.command_pa.tolist() == before.command_pa.tolist()
    assert sum(hand.limiter.state.rejected.values()) == 1


def test_an_arm_whose_commands_end_vents_all_and_is_named():
    hand = Hand()
    hand.run(0.1, thumb=(3e3, 3e3), index=(4e3, 4e3))
    hand.run(0.05, thumb=(3e3, 3e3))
    assert not hand.limiter.state.vented
    hand.run(0.1, thumb=(3e3, 3e3))
    assert hand.limiter.cause.startswith("command lost: last one of index ")
    assert hand.limiter.state.setpoint_pa.tolist() == [0.0] * 4


def test_a_fault_of_one_arm_vents_all_that_share_its_air():
    hand = Hand()
    hand.run(0.1, thumb=(3e3, 3e3), index=(4e3, 4e3))
    hand.run(0.005, np.array([0.0, 0.0, 0.0, 1e6]), thumb=(3e3, 3e3), index=(4e3, 4e3))
    assert hand.limiter.cause.startswith("short circuit: index/link0/chamber1")
    assert all(arm.state.vented for arm in hand.arms.values())
    assert hand.limiter.state.setpoint_pa.tolist() == [0.0] * 4


def test_a_second_source_of_one_arm_is_refused_and_that_of_the_other_is_another_one():
    hand = Hand()
    hand.run(0.05, thumb=(0.0, 0.0), index=(0.0, 0.0))
    hand.now_ns += MS
    assert hand.offer("thumb", 1e3, 0.0, source="other").startswith("second source: other")
    assert hand.offer("index", 1e3, 0.0) is None
    hand.arms["index"].doubt("same name: two", "controller")
    assert hand.limiter.state.command_pa.tolist() == [0.0] * 4


def test_the_latch_opens_once_every_arm_asks_for_zero():
    hand = Hand()
    hand.run(0.1, thumb=(3e3, 3e3), index=(4e3, 4e3))
    hand.limiter.latch("vent requested")
    hand.run(0.05, thumb=(0.0, 0.0), index=(4e3, 4e3))
    assert hand.limiter.reset(lambda: hand.now_ns).startswith("index (controller) still asks for pressure")
    hand.run(0.05, thumb=(0.0, 0.0), index=(0.0, 0.0))
    hand.run(0.3, thumb=(0.0, 0.0))  # index is silent: it has no command that could be lost
    assert hand.limiter.reset(lambda: hand.now_ns) is None
    hand.run(0.3, thumb=(2e3, 0.0))
    assert hand.limiter.state.setpoint_pa.tolist() == [2e3, 0.0, 0.0, 0.0]


def test_a_command_of_the_whole_is_one_of_every_arm():
    hand = Hand()
    hand.limiter.offer(np.array([0.0, 0.0, 2e3, 0.0]), 0, 0, "whole")
    hand.now_ns = MS
    hand.limiter.offer(np.array([0.0, 0.0, 2e3, 0.0]), MS, MS, "whole")
    for _ in range(60):
        hand.now_ns += 5 * MS
        hand.arms["thumb"].offer(np.array([1e3, 0.0]), hand.now_ns, hand.now_ns, "whole")
        hand.limiter.slew(hand.now_ns)
        hand.limiter.judge(AIR, True, hand.now_ns)
    assert hand.limiter.cause.startswith("command lost: last one of index ")
    assert hand.limiter.state.setpoint_pa.tolist() == [0.0] * 4
