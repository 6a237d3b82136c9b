"""Messages that do not arrive are counted, by the numbers of those that do."""

from __future__ import annotations

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from soro_lab.bag import BagReader
from soro_ros.nodes.recorder import Recorder
from soro_ros.recorder.recorder_stream import LossCounter
from tests.patience import LIMIT_S
from tests.soro_ros.direct import fire, values
from tests.soro_ros.test_recorder_player import until

ONE, OTHER = frozenset([b"1"]), frozenset([b"2"])


def counted(numbers: list[int | None], counter: LossCounter | None = None) -> LossCounter:
    counter = counter or LossCounter()
    counter.is_from(ONE)
    for number in numbers:
        counter.receive(number)
    return counter


def test_gaps_count_from_the_first_number_on():
    assert counted([5, 6, 7]).lost == 0
    assert counted([5, None, None, 8, 11]).lost == 2
    assert counted([None, None, 3, None, 9]).lost == 4  # 4, and one without a number, then 9
    assert counted([None, None]).lost == 0


def test_another_publisher_begins_anew_and_several_count_nothing():
    counter = counted([5, 9])
    assert counter.lost == 3
    counter.is_from(OTHER)
    for number in (1, 2, 4):
        counter.receive(number)
    assert counter.lost == 4
    counter.is_from(ONE | OTHER)
    assert not counter.wants_sample
    counter.receive(100)
    assert counter.lost == 4


def test_a_sample_is_wanted_until_there_is_one_and_now_and_then():
    counter = counted([None])
    assert counter.wants_sample
    counter.receive(2)
    assert not counter.wants_sample
    assert sum(1 for _ in range(640) if (counter.receive(), counter.wants_sample)[1]) == 10


def test_the_recorder_reports_what_did_not_arrive(domain, tmp_path):
    """Three messages are taken away before it sees them; no node spins here."""
    words = ["-p", f"folder:={tmp_path / 'bag'}", "-p", "topics:=['t std_msgs/msg/String']"]
    rclpy.init(args=["--ros-args", *words])
    try:
        recorder, sender = Recorder(), Node("sender", start_parameter_services=False)
        recorder.trigger_configure()
        recorder.trigger_activate()
        publisher = sender.create_publisher(String, "/t", QoSProfile(history=HistoryPolicy.KEEP_ALL))
        until(lambda: publisher.get_subscription_count() > 0, "the recorder subscribes")
        until(lambda: recorder.count_publishers("/t") > 0, "the recorder knows the publisher")
        fire(recorder, 0.1)  # the search for topics
        for number in range(20):
            publisher.publish(String(data=str(number)))
        assert publisher.wait_for_all_acked(Duration(seconds=LIMIT_S))
        assert recorder._take_one("/t")
        (handle,) = [one.handle for one in recorder.subscriptions if one.topic_name == "/t"]
        for _ in range(3):
            with handle:
                assert handle.take_message(String, True) is not None
        assert recorder._take_one("/t")
        recorder.diagnose()
        assert recorder.diagnostics.status.message == "messages were lost"
        recorder.diagnostics.publish()
        assert values(recorder)["lost"] == "3"
        recorder.make_safe()
        recorder.destroy_node()
        sender.destroy_node()
    finally:
        rclpy.shutdown()
    # What had arrived is recorded, although the node had not taken it before its end.
    with BagReader(tmp_path / "bag") as reader:
        recorded = [deserialize_message(message.data, String).data for message in reader.messages()]
    assert recorded == [str(number) for number in (0, *range(4, 20))]
