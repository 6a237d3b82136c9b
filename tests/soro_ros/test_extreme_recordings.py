"""Recorder and player with messages, times and rates at their extremes: they live, and lose nothing."""

import threading

import pytest
from geometry_msgs.msg import PoseStamped
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64MultiArray

from soro_lab.bag import BagReader, BagWriter, Topic
from soro_ros.conversion import messages
from soro_ros.nodes.player import Player
from soro_ros.nodes.recorder import Recorder
from soro_ros.recorder.playback import Playback
from tests.patience import LIMIT_S
from tests.soro_ros.direct import active, captured, receive, request
from tests.soro_ros.extremes import extremes

# Each kind of message of a run, with something in it.
RECORDED = {
    "/arm/state": JointState(name=["a"], position=[0.1], velocity=[0.2], effort=[0.3]),
    "/pose": PoseStamped(),
    "/imu": Imu(),
    "/commands": Float64MultiArray(data=[1.0, 2.0]),
}
END_NS = messages.END_NS


def type_of(message):
    package, _, name = type(message).__module__.partition(".msg.")
    return f"{package}/msg/{type(message).__name__}" if name else ""


def everything():
    """Topic and bytes of each message with each field at each extreme."""
    return [
        (topic, serialize_message(changed))
        for topic, usual in RECORDED.items()
        for _, changed in extremes(usual)
    ]


@pytest.mark.process
def test_each_message_is_recorded_and_played_byte_for_byte(domain, tmp_path):
    given, folder = everything(), tmp_path / "bag"
    topics = [f"{topic} {type_of(message)}" for topic, message in RECORDED.items()]
    with active(Recorder, f"folder:={folder}", f"topics:={topics}") as node:
        for topic, data in given:
            receive(node, topic, data)
        node.make_safe()
        assert node.failure is None
    with BagReader(folder) as reader:
        assert reader.problems == ()
        assert sorted((one.topic, one.data) for one in reader.messages()) == sorted(given)
    with active(Player, f"bag:={folder}", "rate:=0.0", "paused:=true") as node:
        played = {topic: captured(node, topic) for topic in RECORDED}
        assert request(node, "~/resume").success
        await_playback()
        assert node.failure is None
        assert played == {name: [data for topic, data in given if topic == name] for name in RECORDED}
        node.teardown()


def test_a_recorder_lives_through_each_simulated_time(domain, tmp_path):
    folder, usual = tmp_path / "bag", RECORDED["/pose"]
    topics = "topics:=['/pose geometry_msgs/msg/PoseStamped']"
    times = [5 * 10**9 + k for k in range(len(list(extremes(Clock()))))]
    with active(Recorder, f"folder:={folder}", topics, "use_sim_time:=true") as node:
        for time_ns, (_, odd) in zip(times, extremes(Clock()), strict=True):
            receive(node, "/clock", odd)
            receive(node, "/pose", serialize_message(usual))
            node.diagnostics.publish()
            node.clock_watch.check()
            receive(node, "/clock", Clock(clock=messages.to_time(time_ns)))
            receive(node, "/pose", serialize_message(usual))
        node.make_safe()
        assert node.failure is None
    with BagReader(folder) as reader:
        assert reader.problems == ()
        assert set(times) <= {one.log_time_ns for one in reader.messages()}


def await_playback() -> None:
    """Wait for the end of the player's thread."""
    for thread in threading.enumerate():
        if thread.name == "player":
            thread.join(LIMIT_S)


@pytest.mark.parametrize("rate", [5e-324, 1e-200, 1e-9])
def test_a_playback_waits_at_any_rate_and_can_be_stopped(rate):
    playback = Playback(lambda begin_ns: iter([(0, 0), (2**62, 1)]), 0, 2**62, rate, False)
    seen, raised = [], []

    def run():
        try:
            playback.run(lambda _, number: (seen.append(number), playback.set_rate(rate)))
        except Exception as error:
            raised.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    playback.seek(0.0)
    thread.join(0.1)
    playback.stop()
    thread.join(LIMIT_S)
    assert not raised
    assert not thread.is_alive()
    assert 1 not in seen


@pytest.mark.process
@pytest.mark.parametrize(("at_ns", "plays"), [(0, True), (END_NS - 10**7, True), (END_NS, False)])
def test_a_player_gives_a_clock_as_long_as_there_are_seconds_for_it(domain, tmp_path, at_ns, plays):
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic(Topic("/commands", "std_msgs/msg/Float64MultiArray"))
        for k in range(3):
            writer.write("/commands", serialize_message(RECORDED["/commands"]), at_ns + k * 10**6)
    settings = (f"bag:={tmp_path / 'bag'}", "rate:=0.0", "clock:=true", "clock_hz:=1000.0", "paused:=true")
    if not plays:
        with (
            pytest.raises(AssertionError, match="clock: got True; allowed: false"),
            active(Player, *settings),
        ):
            pass
        return
    with active(Player, *settings) as node:
        ticks = captured(node, "/clock")
        assert request(node, "~/resume").success
        await_playback()
        assert node.failure is None
        assert [messages.to_ns(one.clock) for one in ticks] == [at_ns + k * 10**6 for k in range(3)]
        node.teardown()


def test_a_player_refuses_each_extreme_parameter_and_plays_on(domain, tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic(Topic("/commands", "std_msgs/msg/Float64MultiArray"))
        for k in range(2):
            writer.write("/commands", serialize_message(RECORDED["/commands"]), k * 10**9)
    with active(Player, f"bag:={tmp_path / 'bag'}", "paused:=true") as node:
        sent = captured(node, "/commands")
        for name in ("rate", "start_s"):
            for value in (5e-324, 1e-200, 1e200, -1e200, 1.7976931348623157e308, float("nan"), float("inf")):
                (result,) = node.set_parameters([Parameter(name, value=value)])
                assert not result.successful, (name, value)
        assert all(one.successful for one in node.set_parameters([Parameter("rate", value=1000.0)]))
        assert request(node, "~/resume").success
        await_playback()
        assert node.failure is None
        assert len(sent) == 2
        node.teardown()
