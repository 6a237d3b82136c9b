"""A recorder that is paused, goes on, begins a new file and waits for simulated time, in this process."""

import contextlib

import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from soro_lab.bag import BagReader
from soro_ros.host import middleware
from soro_ros.nodes.recorder import Recorder
from tests.soro_ros.direct import receive, request
from tests.soro_ros.running import wait_until

LATCHED = QoSProfile(depth=5, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@contextlib.contextmanager
def recorder(folder, *settings):
    given = (f"folder:={folder}", "exclude:=['/rosout', '/parameter_events']", *settings)
    middleware.init(["--ros-args", *(part for setting in given for part in ("-p", setting))])
    try:
        node = Recorder()
        node.trigger_configure()
        yield node
        node.make_safe()
        node.destroy_node()
    finally:
        rclpy.shutdown()


def recorded(folder) -> list[tuple[str, int]]:
    """Texts and times of what is in a bag."""
    with BagReader(folder) as reader:
        assert reader.problems == ()
        return [(deserialize_message(one.data, String).data, one.log_time_ns) for one in reader.messages()]


def test_services_pause_and_split_a_recording(domain, tmp_path):
    with recorder(tmp_path / "bag", "topics:=['/a std_msgs/msg/String']", "paused:=true") as node:

        def say(text: str) -> str:
            receive(node, "/a", serialize_message(String(data=text)))
            node.diagnose()
            return node.diagnostics.status.message

        assert not request(node, "~/split").success
        assert not request(node, "~/pause").success
        node.trigger_activate()
        assert say("left out at the begin") == "paused"
        assert request(node, "~/resume").success
        assert say("0") == "recording"
        assert request(node, "~/split").success
        say("1")
        assert request(node, "~/toggle_paused").message.startswith("paused")
        say("left out")
        assert request(node, "~/split").success
        assert request(node, "~/split").success  # of a file without a message: nothing
        assert request(node, "~/toggle_paused").success
        say("2")
        assert request(node, "~/pause").success
        say("left out at the end")
    assert [text for text, _ in recorded(tmp_path / "bag")] == ["0", "1", "2"]
    assert sorted(file.name for file in (tmp_path / "bag").glob("*.mcap")) == [
        f"bag_{k}.mcap" for k in range(3)
    ]


def test_a_latched_message_of_a_pause_is_recorded_when_it_ends(domain, tmp_path):
    """It still holds then: a bag without it would show an arm that is vented as one that is not."""
    topics = "topics:=['/a std_msgs/msg/String', '/latched std_msgs/msg/String transient_local']"
    with recorder(tmp_path / "bag", topics, "paused:=true") as node:
        node.trigger_activate()
        for topic, text in (("/latched", "old"), ("/latched", "new"), ("/a", "left out")):
            receive(node, topic, serialize_message(String(data=text)))
        assert request(node, "~/resume").success
        receive(node, "/a", serialize_message(String(data="later")))
        assert request(node, "~/pause").success
        assert request(node, "~/resume").success
    assert [text for text, _ in recorded(tmp_path / "bag")] == ["new", "later"]


def test_with_simulated_time_a_recording_begins_with_the_first_time(domain, tmp_path):
    topics = "topics:=['/a std_msgs/msg/String', '/latched std_msgs/msg/String transient_local']"
    with recorder(tmp_path / "bag", topics, "use_sim_time:=true", "discovery_s:=0.02") as node:
        other = Node("other")
        clock, latched = (
            other.create_publisher(kind, topic, quality)
            for kind, topic, quality in ((Clock, "/clock", 10), (String, "/latched", LATCHED))
        )
        latched.publish(String(data="latched"))
        node.trigger_activate()
        receive(node, "/a", serialize_message(String(data="before the first time")))
        for _ in range(30):  # time for what must not be taken yet
            rclpy.spin_once(node, timeout_sec=0.02)
        node.diagnose()
        assert node.diagnostics.status.message == "waiting for /clock"
        assert node.set_parameters([Parameter("use_sim_time", value=True)])[0].successful  # as it is
        (refused,) = node.set_parameters([Parameter("use_sim_time", value=False)])
        assert not refused.successful
        assert "deactivate" in refused.reason

        def tick(seconds: int) -> None:
            clock.publish(Clock(clock=Time(seconds=seconds).to_msg()))
            rclpy.spin_once(node, timeout_sec=0.02)

        def count() -> int:
            with BagReader(tmp_path / "bag") as reader:
                return reader.message_count

        wait_until(lambda: tick(5) or node.clock_watch.has_time, "the time", every_s=0.0)
        receive(node, "/a", serialize_message(String(data="a")))
        wait_until(lambda: tick(5) or count() == 2, "both messages", every_s=0.0)
        node.trigger_deactivate()
        assert all(one.successful for one in node.set_parameters([Parameter("use_sim_time", value=False)]))
        other.destroy_node()
    assert sorted(recorded(tmp_path / "bag")) == [("a", 5 * 10**9), ("latched", 5 * 10**9)]
