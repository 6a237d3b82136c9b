"""A hand opens when asked to, when it is deactivated, and when its fingers are no longer measured."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState

from soro_ros.conversion import messages
from soro_ros.nodes.hand import HandNode
from tests.soro_ros.direct import active, captured, receive, request

FINGERS, TRACKED = ("thumb", "index"), "bodies/ball/pose"
DT_NS = 20_000_000


class Fed:
    """A hand in real time, the messages that it gets, and what it asks and says."""

    def __init__(self, node):
        self.node, self.now_ns = node, node.get_clock().now().nanoseconds - 60_000_000_000
        self.asked = {name: captured(node, f"{name}/arm/reference/trajectory") for name in FINGERS}
        self.said = captured(node, "hand/grasp")

    def feed(self, ticks, tracked=True, controls=True):
        for _ in range(ticks):
            self.now_ns += DT_NS
            stamp = messages.to_time(self.now_ns)
            if tracked and self.node._config.tracked:
                pose = PoseStamped()
                pose.header.stamp, pose.pose.orientation.w = stamp, 1.0
                receive(self.node, TRACKED, pose)
            for name, chambers, coordinates in zip(
                FINGERS, self.node._chambers, self.node._coordinates, strict=True
            ):
                desired = PoseStamped()
                desired.header.stamp = stamp
                if controls:
                    receive(self.node, f"{name}/arm/desired/tip", desired)
                still = JointState(name=coordinates, position=np.zeros(len(coordinates)).tolist())
                empty = messages.chambers(chambers, np.zeros(len(chambers)), self.now_ns)
                still.header.stamp = stamp
                receive(self.node, f"{name}/arm/state", still)
                receive(self.node, f"{name}/chambers/state", empty)

    def bends(self):
        """Return how far from an open one each finger was asked to be last, by its coordinates."""
        hand = self.node._hand
        opened = hand.shapes(hand.squeeze.initial_state())
        asked = [one[-1].points[0].positions for one in self.asked.values()]
        return [np.abs(np.subtract(q, own)).max() for q, own in zip(asked, opened, strict=True)]


@pytest.fixture
def hand(domain):
    fingers = f"fingers:=[{', '.join(FINGERS)}]"
    with active(HandNode, fingers, f"tracked:={TRACKED}") as node:
        yield Fed(node)


def test_a_hand_whose_tracker_is_silent_opens_when_it_is_asked_to(hand):
    hand.feed(1, tracked=False)
    assert f"nothing has come on {TRACKED}" in request(hand.node, "hand/close").message
    hand.feed(2)
    assert request(hand.node, "hand/close").success
    hand.feed(20)
    assert "tracks" not in hand.said[-1].message
    hand.feed(40, tracked=False)
    assert hand.said[-1].message.endswith("nothing tracks the object")
    bent = min(hand.bends())
    assert bent > 0.0
    request(hand.node, "hand/open")
    hand.feed(100, tracked=False)
    assert hand.said[-1].name == "open"
    assert max(hand.bends()) < 0.01 * bent


def test_a_hand_on_an_arm_sees_its_object_from_the_palm(domain):
    """A ball that stays below a palm that goes aside and tilts has not moved."""
    fingers = f"fingers:=[{', '.join(FINGERS)}]"
    arm = ("carrier:=upper", "carrier_robot:=three_bellow_hanging")
    with active(HandNode, fingers, f"tracked:={TRACKED}", *arm) as node:
        carrier, seen = node._carrier, []
        for bend in (0.0, 8.0):
            q = np.array([0.02, bend, 0.0])
            now_ns = node.get_clock().now().nanoseconds
            stamp = messages.to_time(now_ns)
            state = JointState(name=carrier.robot.coordinate_names, position=q.tolist())
            palm = carrier.pose(q, carrier.length)
            below = np.eye(4)
            below[:3, 3] = [0.01, 0.0, 0.06]
            ball = messages.pose_stamped(palm @ below, now_ns, "")
            state.header.stamp = stamp
            receive(node, "upper/arm/state", state)
            receive(node, TRACKED, ball)
            for name, chambers, coordinates in zip(FINGERS, node._chambers, node._coordinates, strict=True):
                still = JointState(name=coordinates, position=[0.0] * len(coordinates))
                still.header.stamp = stamp
                receive(node, f"{name}/arm/state", still)
                receive(
                    node,
                    f"{name}/chambers/state",
                    messages.chambers(chambers, np.zeros(len(chambers)), now_ns),
                )
            seen.append(node._felt_now(now_ns))
        straight, tilted = seen
        up = node._hand.squeeze.fingers[0].up
        assert straight.height_m == pytest.approx(up @ [0.01, 0.0, 0.06], abs=1e-9)
        assert tilted.height_m == pytest.approx(straight.height_m, abs=1e-9)
        np.testing.assert_allclose(straight.gravity, [0.0, 0.0, 9.81], atol=1e-9)
        np.testing.assert_allclose(tilted.gravity, palm[:3, :3].T @ [0.0, 0.0, -9.81], atol=1e-9)
        assert abs(tilted.gravity[:2]).max() > 1.0
        old_s = 1.1 * node._config.state_age_s
        assert node._felt_now(now_ns + round(1e9 * old_s)).gravity is None
        receive(node, "upper/arm/state", JointState(header=state.header))  # no estimate of the arm
        felt = node._felt_now(now_ns)
        assert (felt.height_m, felt.gravity) == (None, None)


def test_an_open_hand_says_so_whenever_it_is_asked_to_open(hand):
    """Whoever asks waits for a report; of fingers that are not in control it says that."""
    hand.feed(1, tracked=False)
    for count in (1, 2):
        said = len(hand.said)
        request(hand.node, "hand/open")
        assert [one.name for one in hand.said[said:]] == ["open"], count
    hand.feed(60, controls=False)
    said = len(hand.said)
    request(hand.node, "hand/open")
    assert [one.name for one in hand.said[said:]] == ["vented"]
    assert "thumb is not in control" in hand.said[-1].message
    hand.node.trigger_deactivate()
    said = len(hand.said)
    request(hand.node, "hand/open")
    assert len(hand.said) == said


def test_a_hand_that_hears_nothing_of_its_fingers_lets_go(hand):
    hand.feed(2)
    request(hand.node, "hand/close")
    hand.feed(40)
    bent = min(hand.bends())
    hand.node.diagnose()
    assert hand.said[-1].name == "lost"
    assert max(hand.bends()) < 0.01 * bent


def test_a_hand_goes_on_when_the_clock_is_set_back(hand):
    hand.feed(2)
    request(hand.node, "hand/close")
    hand.feed(40)
    bent, at_s = min(hand.bends()), hand.node._t_s
    hand.now_ns -= 3_600_000_000_000
    hand.feed(20)
    assert min(hand.bends()) > 1.1 * bent
    assert hand.node._t_s == pytest.approx(at_s + 0.4, abs=0.05)
    assert not hand.said[-1].message.endswith("nothing tracks the object")
    # A controller that says nothing since then is known by its age.
    hand.feed(40, controls=False)
    assert hand.said[-1].name == "vented"


def test_the_time_of_a_hand_in_lockstep_is_that_of_the_clock(domain):
    """It closes at the same time in whatever order messages come."""
    fingers = f"fingers:=[{', '.join(FINGERS)}]"
    with active(HandNode, fingers, "mode:=lockstep", "close_at_s:=1.0") as node:
        fed = Fed(node)
        fed.now_ns = 0
        fed.feed(20, controls=False)
        fed.feed(29)
        assert not node._closes
        fed.feed(1)
        assert (node._t_s, node._closes) == (1.0, True)


def test_a_hand_that_is_deactivated_opens_and_takes_no_part(hand):
    hand.feed(2)
    request(hand.node, "hand/close")
    hand.feed(40)
    bent = min(hand.bends())
    hand.node.trigger_deactivate()
    assert max(hand.bends()) < 0.01 * bent
    said = len(hand.said)
    hand.feed(10)
    assert len(hand.said) == said
    assert "inactive" in request(hand.node, "hand/close").message
    hand.node.trigger_activate()
    hand.feed(2)
    assert request(hand.node, "hand/close").success
