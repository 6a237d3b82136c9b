"""Messages between nodes of one process: handed over as they are, or by the middleware, never both."""

from __future__ import annotations

import inspect
from types import SimpleNamespace

import pytest
import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from soro_ros.conversion import qos
from soro_ros.host import middleware
from soro_ros.topics.command_topic import CommandTopic
from soro_ros.topics.intra_process import Handover, NodeWithHandover
from tests.soro_ros.running import wait_until

OPEN: list[Process] = []


class Process:
    """Two nodes with one executor, and what their readers have got."""

    def __init__(self, profile=qos.RELIABLE, **options) -> None:
        self.handover, self.executor = Handover(), EventsExecutor()
        self.writing, self.reading = NodeWithHandover("writing"), NodeWithHandover("reading")
        for node in (self.writing, self.reading):
            node.handover = self.handover
            self.executor.add_node(node)
        self.handover.begin(self.executor)
        self.got: list[object] = []
        self.writer = self.writing.create_publisher(String, "words", profile)
        self.reader = self.reading.create_subscription(String, "words", self.got.append, profile, **options)
        OPEN.append(self)
        self.readers(1)

    def close(self) -> None:
        self.executor.shutdown()
        for node in (self.writing, self.reading):
            node.destroy_node()

    def readers(self, count: int) -> None:
        # The executor learns of a reader while it spins.
        wait_until(lambda: self.spun() and self.writer.get_subscription_count() == count, "the readers")

    def send(self, *words: str) -> list[String]:
        sent = [String(data=word) for word in words]
        for message in sent:
            self.writer.publish(message)
        return sent

    def spun(self) -> bool:
        self.executor.spin_once(timeout_sec=0.01)
        return True

    def wait(self, count: int) -> None:
        wait_until(lambda: self.spun() and len(self.got) >= count, "the messages")
        for _ in range(3):  # a second copy would come now
            self.spun()


@pytest.fixture
def started(domain):
    middleware.init([])
    yield
    while OPEN:  # an executor that is not shut down keeps its nodes in their domain
        OPEN.pop().close()
    rclpy.try_shutdown()


def words(got: list[String]) -> list[str]:
    return [message.data for message in got]


def are_the_same(got: list[object], sent: list[object]) -> bool:
    return len(got) == len(sent) and all(one is other for one, other in zip(got, sent, strict=True))


def test_readers_of_the_process_get_the_message_itself_in_order_and_not_before_the_executor_calls(started):
    process = Process()
    second: list[String] = []
    process.reading.create_subscription(String, "words", second.append, qos.SENSOR)
    process.readers(2)
    sent = process.send("one", "two")
    assert process.got == []
    process.wait(2)
    assert are_the_same(process.got, sent)
    assert are_the_same(second, sent)


def test_what_a_reader_sends_has_its_turn_in_the_same_task_after_what_waits(started):
    process, heard = Process(), []
    answers = process.reading.create_publisher(String, "answers", qos.RELIABLE)
    process.writing.create_subscription(String, "answers", lambda m: heard.append(m.data), qos.RELIABLE)
    wait_until(lambda: process.spun() and answers.get_subscription_count() == 1, "the reader of answers")
    process.reader.callback = lambda m: (heard.append(m.data), answers.publish(String(data=f"to {m.data}")))
    tasks: list[object] = []
    create = process.executor.create_task
    process.handover.begin(SimpleNamespace(create_task=lambda *task: (tasks.append(task), create(*task))))
    process.send("one", "two")
    wait_until(lambda: process.spun() and len(heard) == 4, "the answers")
    assert heard == ["one", "two", "to one", "to two"]
    assert len(tasks) == 1


def test_a_reader_that_wants_bytes_gets_bytes(started):
    process = Process(raw=True)
    process.send("one")
    process.wait(1)
    assert deserialize_message(process.got[0], String).data == "one"


def test_with_a_reader_outside_the_middleware_brings_the_message_to_all_once_and_in_order(started):
    process, outside = Process(), Node("outside")
    heard = outside.create_subscription(String, "words", lambda _: None, qos.RELIABLE)
    process.readers(2)
    sent = process.send("one", "two")
    outside.destroy_subscription(heard)
    wait_until(lambda: process.writer.get_subscription_count() == 1, "the end of the reader outside")
    sent += process.send("three")
    process.wait(3)
    assert words(process.got) == ["one", "two", "three"]
    assert not any(one is other for one, other in zip(process.got[:2], sent, strict=False))
    assert process.got[2] is sent[2]


def test_with_a_second_publisher_the_middleware_brings_the_messages_of_both(started):
    process, outside = Process(), Node("outside")
    other = outside.create_publisher(String, "words", qos.RELIABLE)
    wait_until(lambda: process.reader.get_publisher_count() == 2, "the other publisher")
    wait_until(lambda: other.get_subscription_count() == 1, "the reader")
    sent = process.send("one")
    other.publish(String(data="two"))
    process.wait(2)
    assert words(process.got) == ["one", "two"]
    assert process.got[0] is not sent[0]


def test_a_message_that_is_handed_over_has_no_number_and_one_of_the_middleware_has_its_own(started):
    process = Process()
    taken: list[int | None] = []

    def take(*received):
        """The events executor passes message and information as a pair."""
        taken.append(received[0][1]["publication_sequence_number"])

    take.__signature__ = inspect.signature(lambda message, information: None)
    process.reading.create_subscription(String, "words", take, qos.RELIABLE)
    process.readers(2)
    sent = process.send("one", "two")
    process.wait(2)
    assert taken == [None, None]
    assert are_the_same(process.got, sent)
    process.handover.end()
    process.send("three", "four")
    process.wait(4)
    assert taken[2:] == [1, 2]


def test_a_loop_of_messages_leaves_the_executor_its_turns(started):
    process, turns = Process(), []
    process.reader.callback = lambda m: process.writer.publish(m)  # each message brings the next
    process.reading.create_timer(0.001, lambda: turns.append(1))
    process.send("one")
    wait_until(lambda: process.spun() and len(turns) >= 3, "turns of the timer")
    process.handover.end()


def test_a_topic_that_keeps_its_messages_stays_with_the_middleware(started):
    process = Process(qos.LOCKSTEP)
    sent = process.send("one")
    late: list[String] = []
    process.reading.create_subscription(String, "words", late.append, qos.LOCKSTEP)
    process.wait(1)
    wait_until(lambda: process.spun() and bool(late), "the message for a late reader")
    assert process.got[0] is not sent[0]


def test_a_slow_reader_of_the_newest_message_misses_the_others(started):
    process = Process(qos.NEWEST)
    sent = process.send("one", "two", "three")
    process.wait(1)
    assert are_the_same(process.got, sent[2:])


def test_a_destroyed_reader_gets_nothing_that_waits_for_it(started):
    process = Process()
    process.send("one")
    process.reading.destroy_subscription(process.reader)
    for _ in range(5):
        process.spun()
    assert process.got == []


def test_what_a_reader_raises_is_kept_and_no_other_message_is_handed_over(started):
    process = Process()
    process.reading.destroy_subscription(process.reader)
    taken: list[String] = []

    def take(message):
        taken.append(message)
        raise ValueError("wrong word")

    process.reading.create_subscription(String, "words", take, qos.RELIABLE)
    process.readers(1)
    process.send("one", "two")
    wait_until(lambda: process.spun() and process.handover.failure is not None, "the failure")
    for _ in range(3):
        process.spun()
    node, error = process.handover.failure
    assert (node, str(error)) == (process.reading, "wrong word")
    assert words(taken) == ["one"]


def test_what_can_wait_is_done_after_the_answers_of_the_other_nodes(started):
    process, done = Process(), []
    answers = process.reading.create_publisher(String, "answers", qos.RELIABLE)
    process.writing.create_subscription(String, "answers", lambda m: done.append(m.data), qos.RELIABLE)
    wait_until(lambda: process.spun() and answers.get_subscription_count() == 1, "the reader of answers")
    process.reader.callback = lambda m: answers.publish(String(data=f"to {m.data}"))
    process.send("one")
    process.writing.after_handover(lambda: done.append("after"))
    assert done == []
    wait_until(lambda: process.spun() and len(done) == 2, "the answer")
    assert done == ["to one", "after"]


def test_without_other_nodes_nothing_waits(started):
    done, alone = [], NodeWithHandover("alone")
    alone.after_handover(lambda: done.append("alone"))
    process = Process()
    process.handover.end()
    process.writing.after_handover(lambda: done.append("ended"))
    assert done == ["alone", "ended"]
    alone.destroy_node()


def test_what_waits_and_raises_is_the_failure_of_its_node(started):
    process = Process()

    def fail():
        raise ValueError("no motion")

    process.writing.after_handover(fail)
    wait_until(lambda: process.spun() and process.handover.failure is not None, "the failure")
    node, error = process.handover.failure
    assert (node, str(error)) == (process.writing, "no motion")


def test_a_command_that_is_handed_over_is_not_doubted_for_a_publisher_that_cannot_reach_its_reader(started):
    """One of another quality of service: the graph has it, the reader gets nothing of it."""
    process, stranger = Process(), Node("stranger")
    doubts: list[str | None] = []
    topic = CommandTopic(
        process.reading, String, "words", qos.RELIABLE, lambda m: "name", lambda m, d: doubts.append(d), bool
    )
    stranger.create_publisher(String, "words", qos.SENSOR)
    process.readers(2)
    wait_until(lambda: process.spun() and topic.conflict is not None, "the stranger in the graph")
    process.send("one", "two")
    wait_until(lambda: process.spun() and len(doubts) == 2, "the commands")
    assert doubts == [None, None]
    stranger.destroy_node()
