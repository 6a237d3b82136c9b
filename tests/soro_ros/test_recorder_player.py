"""Recorder and player as real processes: the same bytes in the same order, whatever the way round."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped, TransformStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from mcap.records import Attachment
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String

from soro_lab.bag import BagReader, BagWriter, Qos, Topic, repair
from soro_lab.bag.mcap.mcap_file import McapFile
from soro_ros.conversion.interfaces import definition
from soro_ros.nodes.player import Player
from soro_ros.nodes.recorder import Recorder
from tests.patience import LIMIT_S
from tests.refused import refused_keys
from tests.soro_ros.direct import receive
from tests.warm import Popen

# The parser that comes with the message packages imports a module that Python has deprecated.
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")

ALL = QoSProfile(history=HistoryPolicy.KEEP_ALL)
LATCHED = QoSProfile(depth=20, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
TYPES = {
    "/arm1/chambers/state": (JointState, ALL),
    "/arm1/sensors/pose0": (PoseStamped, ALL),
    "/arm1/chambers/commands": (Float64MultiArray, ALL),
    "/diagnostics_copy": (DiagnosticArray, ALL),
    "/clock_copy": (Clock, ALL),
    "/frames": (TransformStamped, ALL),
    "/latched": (String, LATCHED),
}
STORE = get_typestore(Stores.ROS2_JAZZY)


class Process:
    """A node's process; its output goes to a file that can be waited on."""

    def __init__(self, log: Path, module: str, *arguments: str) -> None:
        self._log = log
        with log.open("wb") as stream:
            self._process = Popen(
                [sys.executable, "-m", module, *arguments], stdout=stream, stderr=subprocess.STDOUT
            )

    def wait_for(self, words: str) -> None:
        limit = time.monotonic() + LIMIT_S
        while words not in self.output():
            assert self._process.poll() is None, self.output()
            assert time.monotonic() < limit, f"no {words!r} in {self.output()!r}"
            time.sleep(0.01)

    def output(self) -> str:
        return self._log.read_text(errors="replace")

    def end(self, number: int | None = None) -> int:
        if number is not None:
            self._process.send_signal(number)
        return self._process.wait(LIMIT_S)

    def kill(self) -> None:
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait(LIMIT_S)


@pytest.fixture
def start(domain, tmp_path):
    """Start soro nodes; whatever still runs at the end of the test is killed."""
    started: list[Process] = []

    def launch(node: str, *arguments: str) -> Process:
        words = [item for argument in arguments for item in ("-p", argument)]
        log = tmp_path / f"{node}{len(started)}.log"
        process = Process(log, f"soro_ros.nodes.{node}", "--ros-args", *words)
        started.append(process)
        return process

    yield launch
    for process in started:
        process.kill()


@pytest.fixture
def node(domain):
    """A node in the test's own process."""
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    made = Node("test", context=context, start_parameter_services=False, enable_rosout=False)
    yield made
    made.destroy_node()
    rclpy.shutdown(context=context)


def until(condition, what: str, spin=lambda: time.sleep(0.01)) -> None:
    limit = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < limit, what
        spin()


def record(start, folder: Path, *arguments: str) -> Process:
    recorder = start("recorder", f"folder:={folder}", *arguments)
    recorder.wait_for("recording in")
    return recorder


def mixed_messages(count: int, seed: int) -> list[tuple[str, object]]:
    """Messages of all topics in a random order, of random contents and lengths."""
    rng = np.random.default_rng(seed)
    result: list[tuple[str, object]] = []
    for number in range(count):
        topic = list(TYPES)[int(rng.integers(len(TYPES)))]
        text = "x" * int(rng.integers(0, 300))
        values = rng.standard_normal(int(rng.integers(0, 9))).tolist()
        message = TYPES[topic][0]()
        if isinstance(message, JointState):
            message.name, message.effort = [f"link0/chamber{index}" for index in range(len(values))], values
        elif isinstance(message, PoseStamped):
            message.header.frame_id, message.pose.position.x = text, float(number)
        elif isinstance(message, Float64MultiArray):
            message.data = values
        elif isinstance(message, DiagnosticArray):
            message.status = [DiagnosticStatus(name=text, values=[KeyValue(key="n", value=str(number))])]
        elif isinstance(message, Clock):
            message.clock.sec = number
        elif isinstance(message, TransformStamped):
            message.child_frame_id, message.transform.translation.z = text, float(number)
        else:
            message.data = f"{number} {text}"
        result.append((topic, message))
    return result


def publish(node: Node, messages: list[tuple[str, object]]) -> None:
    """Publish when the recorder listens to every topic, and wait until its middleware has everything."""
    publishers = {name: node.create_publisher(kind, name, qos) for name, (kind, qos) in TYPES.items()}
    for name, publisher in publishers.items():
        until(lambda pub=publisher: pub.get_subscription_count() > 0, f"no subscription to {name}")
    latched = 0
    for name, message in messages:
        publishers[name].publish(message)
        latched += TYPES[name][1] is LATCHED
        # A burst longer than the history overwrites what the recorder does not have yet.
        if TYPES[name][1] is LATCHED and latched % 10 == 0:
            assert publishers[name].wait_for_all_acked(Duration(seconds=LIMIT_S))
    for publisher in publishers.values():
        assert publisher.wait_for_all_acked(Duration(seconds=LIMIT_S))


def payloads(bag: Path) -> dict[str, list[bytes]]:
    with BagReader(bag) as reader:
        assert reader.problems == ()
        result: dict[str, list[bytes]] = {topic.name: [] for topic in reader.topics}
        for message in reader.messages():
            result[message.topic].append(message.data)
    return result


def contents(
    recorded: dict[str, list[bytes]], kinds: dict[str, type] | None = None
) -> dict[str, list[object]]:
    kinds = kinds or {name: kind for name, (kind, _) in TYPES.items()}
    return {
        name: [deserialize_message(data, kinds[name]) for data in items] for name, items in recorded.items()
    }


@pytest.mark.process
def test_recorder_player_recorder(start, node, tmp_path):
    """The same payload bytes, order, types, hashes and quality of service on every topic, twice over."""
    messages = mixed_messages(700, seed=1)
    expected = {name: [item for topic, item in messages if topic == name] for name in TYPES}
    first = record(
        start,
        tmp_path / "first",
        "exclude:=['/rosout', '/parameter_events', '/*transition_event', '/diagnostics']",
    )
    publish(node, messages)
    assert first.end(signal.SIGINT) == 0
    assert f"recorded {len(messages)} messages" in first.output()
    recorded = payloads(tmp_path / "first")
    # The bytes on the wire are not those of serialize_message: they are padded, with whatever memory held.
    assert contents(recorded) == expected

    node.destroy_node()  # its latched messages would be recorded again
    second = record(start, tmp_path / "second", f"topics:={list(TYPES)}")
    player = start(
        "player",
        f"bag:={tmp_path / 'first'}",
        "rate:=0.0",
        "wait_for_subscribers:=true",
        f"topics:={list(TYPES)}",  # commands are played only by name
    )
    assert player.end() == 0, player.output()
    assert f"played {len(messages)} messages" in player.output()
    assert second.end(signal.SIGTERM) == 0
    assert payloads(tmp_path / "second") == recorded

    with BagReader(tmp_path / "first") as one, BagReader(tmp_path / "second") as two:
        for before, after in zip(one.topics, two.topics, strict=True):
            assert (before.type, before.type_hash) == (after.type, after.type_hash)
            assert before.definition == after.definition
            assert [(q.reliability, q.durability) for q in before.qos] == [
                (q.reliability, q.durability) for q in after.qos
            ]
        assert {topic.qos[0].durability for topic in two.topics if topic.name == "/latched"} == {
            "transient_local"
        }
        times = [item.log_time_ns for item in two.messages()]
    assert times == sorted(times)

    with Reader(tmp_path / "second") as reader:
        for connection in reader.connections:
            assert connection.digest == STORE.hash_rihs01(connection.msgtype)
        read = [
            STORE.deserialize_cdr(data, connection.msgtype).effort.tolist()
            for connection, _, data in reader.messages()
            if connection.topic == "/arm1/chambers/state"
        ]
    assert read == [list(item.effort) for topic, item in messages if topic == "/arm1/chambers/state"]


@pytest.mark.process
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_closes_the_bag(start, tmp_path, number):
    recorder = record(start, tmp_path / "bag")
    assert recorder.end(number) == 0
    assert "recorded" in recorder.output()
    assert "Traceback" not in recorder.output()
    with BagReader(tmp_path / "bag") as reader:
        assert reader.problems == ()


@pytest.mark.process
def test_deactivating_closes_the_bag(start, node, tmp_path):
    recorder = record(start, tmp_path / "bag", "notes:=['scene=circle']")
    client = node.create_client(ChangeState, "/recorder/change_state")
    until(client.service_is_ready, "no change_state")
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    future = client.call_async(
        ChangeState.Request(transition=Transition(id=Transition.TRANSITION_DEACTIVATE))
    )
    executor.spin_until_future_complete(future, timeout_sec=LIMIT_S)
    executor.shutdown()
    assert future.result().success
    with BagReader(tmp_path / "bag") as reader:
        assert reader.problems == ()
        assert reader.metadata.custom_data == {"scene": "circle"}
    assert recorder.end(signal.SIGINT) == 0, recorder.output()


@pytest.mark.process
def test_a_killed_recorder_leaves_a_bag_to_repair(start, node, tmp_path):
    messages = [("/clock_copy", Clock()) for _ in range(50)]
    recorder = record(start, tmp_path / "bag", f"topics:={list(TYPES)}", "flush_s:=0.05")
    publish(node, messages)

    def on_the_disk() -> int:
        with BagReader(tmp_path / "bag") as reader:
            return reader.message_count

    until(lambda: on_the_disk() == len(messages), "messages are flushed")
    recorder.end(signal.SIGKILL)
    with BagReader(tmp_path / "bag") as reader:
        assert reader.problems != ()
    repair(tmp_path / "bag")
    assert len(payloads(tmp_path / "bag")["/clock_copy"]) == len(messages)


@pytest.mark.process
def test_a_topic_named_with_its_type_is_recorded_from_its_first_message(start, node, tmp_path):
    recorder = record(start, tmp_path / "bag", "topics:=['early std_msgs/msg/String']", "discovery_s:=10.0")
    publisher = node.create_publisher(String, "/early", ALL)
    until(lambda: publisher.get_subscription_count() > 0, "the recorder subscribes without discovery")
    publisher.publish(String(data="first"))
    assert publisher.wait_for_all_acked(Duration(seconds=LIMIT_S))
    assert recorder.end(signal.SIGINT) == 0, recorder.output()
    assert contents(payloads(tmp_path / "bag"), {"/early": String}) == {"/early": [String(data="first")]}


@pytest.mark.process
def test_exclusion_wins_and_hidden_topics_are_recorded_by_name_only(start, node, tmp_path):
    words = "topics:=['/out std_msgs/msg/String', '/_named', '/*']"
    recorder = record(start, tmp_path / "bag", words, "exclude:=['/o*', '/*/transition_event', '/[rpd]*']")
    publishers = {
        name: node.create_publisher(String, name, ALL) for name in ("/_named", "/_other", "/out", "/in")
    }
    for name in ("/_named", "/in"):
        until(lambda name=name: publishers[name].get_subscription_count() > 0, f"{name} is recorded")
    for publisher in publishers.values():
        publisher.publish(String(data="a"))
        assert publisher.wait_for_all_acked(Duration(seconds=LIMIT_S))
    assert recorder.end(signal.SIGINT) == 0, recorder.output()
    recorded = payloads(tmp_path / "bag")
    assert {name: len(items) for name, items in recorded.items()} == {"/_named": 1, "/in": 1}


@pytest.mark.process
def test_best_effort_publishers_are_heard_even_when_they_come_late(start, node, tmp_path):
    """A reliable subscription does not match them: the recorder renews it."""
    recorder = record(start, tmp_path / "bag", "topics:=['/mixed']")
    reliable = node.create_publisher(String, "/mixed", ALL)
    until(lambda: reliable.get_subscription_count() > 0, "reliable")
    late = node.create_publisher(String, "/mixed", BEST_EFFORT)
    until(lambda: late.get_subscription_count() > 0, "best effort")
    late.publish(String(data="late"))

    def recorded() -> bool:
        with BagReader(tmp_path / "bag") as reader:
            return reader.message_count > 0

    until(recorded, "the message of the best-effort publisher")
    assert recorder.end(signal.SIGINT) == 0, recorder.output()
    assert contents(payloads(tmp_path / "bag"), {"/mixed": String}) == {"/mixed": [String(data="late")]}


@pytest.mark.parametrize("setting", ["exclude:=[/clock]", "topics:=['/early std_msgs/msg/String']"])
def test_in_lockstep_the_clock_gives_the_times_although_it_is_not_recorded(domain, tmp_path, setting):
    words = [f"folder:={tmp_path / 'bag'}", "mode:=lockstep", setting]
    rclpy.init(args=given(*words))
    try:
        sender = Node("sender", start_parameter_services=False)
        clock, early = (
            sender.create_publisher(Clock, "/clock", ALL),
            sender.create_publisher(String, "/early", ALL),
        )
        until(lambda: sender.count_publishers("/early") and sender.count_publishers("/clock"), "the sender")
        recorder = Recorder()
        recorder.trigger_configure()
        recorder.trigger_activate()
        until(lambda: clock.get_subscription_count() and early.get_subscription_count(), "the recorder")
        for second in range(3):
            receive(recorder, "/clock", serialize_message(Clock(clock=Time(sec=second))))
            receive(recorder, "/early", serialize_message(String(data=str(second))))
        recorder.make_safe()
        recorder.destroy_node()
        sender.destroy_node()
    finally:
        rclpy.shutdown()
    with BagReader(tmp_path / "bag") as reader:
        assert "/clock" not in {topic.name for topic in reader.topics}
        assert [one.log_time_ns for one in reader.messages() if one.topic == "/early"] == [
            0,
            10**9,
            2 * 10**9,
        ]


def test_a_recorder_whose_subscription_is_gone_closes_its_bag(domain, tmp_path):
    words = ["-p", f"folder:={tmp_path / 'bag'}", "-p", "topics:=['early std_msgs/msg/String']"]
    rclpy.init(args=["--ros-args", *words])
    try:
        recorder = Recorder()
        recorder.trigger_configure()
        recorder.trigger_activate()
        for subscription in list(recorder.subscriptions):
            recorder.destroy_subscription(subscription)
        recorder.make_safe()
        assert "InvalidHandle" in str(recorder.failure)
        recorder.destroy_node()
    finally:
        rclpy.shutdown()
    assert payloads(tmp_path / "bag") == {}


@pytest.mark.process
def test_simulated_time_is_the_time_of_the_bag(start, node, tmp_path):
    words = ("use_sim_time:=true", "topics:=['/tick']", "flush_s:=0.05")
    recorder = record(start, tmp_path / "bag", *words)
    recorder.wait_for("from the first time on /clock on")
    clock, tick = node.create_publisher(Clock, "/clock", 10), node.create_publisher(String, "/tick", ALL)
    until(lambda: tick.get_subscription_count() > 0, "the recorder subscribes")

    def in_the_bag() -> tuple[int, int]:
        with BagReader(tmp_path / "bag") as reader:
            return reader.end_ns, reader.message_count

    said = 0

    def say(seconds: int) -> None:
        nonlocal said
        message = Clock()
        message.clock.sec = seconds
        clock.publish(message)
        tick.publish(String(data=str(said)))
        said += 1
        time.sleep(0.01)

    for seconds in (5, 7):
        until(
            lambda wanted=seconds: in_the_bag()[0] == wanted * 10**9,
            f"a message at {seconds} s",
            lambda wanted=seconds: say(wanted),
        )
    # A clock that jumps back does not change the order of what was received.
    for _ in range(30):
        say(6)
    assert tick.wait_for_all_acked(Duration(seconds=LIMIT_S))
    assert recorder.end(signal.SIGINT) == 0, recorder.output()
    with BagReader(tmp_path / "bag") as reader:
        times = {message.log_time_ns for message in reader.messages()}
        numbers = [int(deserialize_message(message.data, String).data) for message in reader.messages()]
    assert times == {5 * 10**9, 7 * 10**9}
    assert numbers == list(range(numbers[0], said))


# Player -------------------------------------------------------------------------------------------
def clock_bag(folder: Path, seconds: float, rate_hz: float = 50.0) -> Path:
    """A bag of /numbers (JointState) and /other (String) from time 100 s on."""
    with BagWriter(folder) as writer:
        for name, kind in (("/numbers", "sensor_msgs/msg/JointState"), ("/other", "std_msgs/msg/String")):
            about = definition(kind)
            writer.add_topic(Topic(name, kind, about.text, about.encoding, about.type_hash, (Qos(),)))
        for index in range(round(seconds * rate_hz) + 1):
            stamp = 100 * 10**9 + round(index / rate_hz * 1e9)
            writer.write("/numbers", serialize_message(JointState(position=[float(index)])), stamp)
            writer.write("/other", serialize_message(String(data=str(index))), stamp)
    return folder


class Listener:
    """Subscribes in the test's process and notes what comes, and when."""

    def __init__(self, node: Node, **topics: type) -> None:
        self.messages: list[tuple[str, object]] = []
        self.times: list[float] = []
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
        for name, kind in topics.items():
            node.create_subscription(
                kind, f"/{name}", lambda message, name=name: self._take(name, message), ALL
            )

    def _take(self, name: str, message: object) -> None:
        self.messages.append((name, message))
        self.times.append(time.monotonic())

    def spin(self) -> None:
        self._executor.spin_once(timeout_sec=0.05)

    def close(self) -> None:
        self._executor.shutdown()


@pytest.mark.process
def test_player_picks_topics_and_times_and_renames(start, node, tmp_path):
    bag = clock_bag(tmp_path / "bag", seconds=1.0)
    listener = Listener(node, renamed=JointState, other=String)
    player = start(
        "player",
        f"bag:={bag}",
        "topics:=['numbers']",
        "remap:=['numbers:=renamed']",
        "start_s:=0.2",
        "duration_s:=0.5",
        "rate:=0.0",
        "wait_for_subscribers:=true",
    )
    until(lambda: len(listener.messages) >= 26, "messages", listener.spin)
    assert player.end() == 0, player.output()
    listener.close()
    assert [(name, message.position[0]) for name, message in listener.messages] == [
        ("renamed", float(index)) for index in range(10, 36)
    ]


@pytest.mark.process
@pytest.mark.real_time
def test_player_keeps_the_recorded_time_and_publishes_the_clock(start, node, tmp_path):
    bag = clock_bag(tmp_path / "bag", seconds=1.0)
    listener = Listener(node, numbers=JointState, other=String, clock=Clock)
    player = start(
        "player", f"bag:={bag}", "rate:=2.0", "clock:=true", "clock_hz:=20.0", "wait_for_subscribers:=true"
    )

    def ended() -> bool:
        return [name for name, _ in listener.messages].count("numbers") == 51

    until(ended, "messages", listener.spin)
    assert player.end() == 0, player.output()
    numbers = [index for index, (name, _) in enumerate(listener.messages) if name == "numbers"]
    # One recorded second at twice the speed; a busy machine may only be late.
    assert listener.times[numbers[-1]] - listener.times[numbers[0]] > 0.4
    clocks = [
        message.clock.sec + message.clock.nanosec / 1e9
        for name, message in listener.messages
        if name == "clock"
    ]
    listener.close()
    assert len(clocks) >= 15
    np.testing.assert_allclose(np.diff(clocks), 0.05, atol=1e-9)
    assert 100.0 <= clocks[0] <= clocks[-1] <= 101.0


@pytest.mark.process
def test_player_loops_until_it_is_stopped(start, node, tmp_path):
    bag = clock_bag(tmp_path / "bag", seconds=0.1)
    listener = Listener(node, numbers=JointState)
    player = start("player", f"bag:={bag}", "loop:=true", "exclude:=['/other']", "wait_for_subscribers:=true")
    until(lambda: len(listener.messages) > 15, "messages", listener.spin)
    listener.close()
    assert player.end(signal.SIGINT) == 0
    assert "Traceback" not in player.output()
    positions = [message.position[0] for _, message in listener.messages]
    assert positions[:12] == [*range(6), *range(6)]


def given(*settings: str) -> list[str]:
    """ROS arguments that set parameters."""
    return ["--ros-args", *(part for setting in settings for part in ("-p", setting))]


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        ([], "bag"),
        (["bag:={bag}", "rate:=-1.0"], "rate"),
        (["bag:={bag}", "speed:=2.0"], "speed"),
        (["bag:={bag}", "remap:=['a']"], "remap"),
        (["bag:={bag}", "remap:=['/a:=b c']"], "remap"),
        (["bag:={bag}", "topics:=['a-b']"], "topics"),
        (["bag:={bag}", "topics:=['/numbers', '/nothing']"], "topics"),
    ],
)
def test_player_names_a_wrong_parameter(node_main, tmp_path, arguments, key):
    bag = clock_bag(tmp_path / "bag", seconds=0.1)
    ended = node_main("player", *given(*(argument.format(bag=bag) for argument in arguments)))
    assert ended.status == 2, ended.err
    assert set(refused_keys(ended.err)) == {key}
    assert "Traceback" not in ended.err


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["bag:=/nowhere/bag"], ("/nowhere/bag",)),
        (["bag:={bag}", "exclude:=['/*']"], ("/numbers", "/other")),
        (["bag:={bag}", "start_s:=99.0"], ()),
        (["bag:={bag}", "wait_for_subscribers:=true", "wait_timeout_s:=0.2"], ("/numbers", "/other")),
    ],
)
def test_player_without_anything_to_play_fails(node_main, tmp_path, arguments, names):
    bag = clock_bag(tmp_path / "bag", seconds=0.1)
    ended = node_main("player", *given(*(argument.format(bag=bag) for argument in arguments)))
    assert ended.status == 1, ended.err
    assert all(name in ended.err for name in names), ended.err
    assert "Traceback" not in ended.err


@pytest.mark.process
def test_player_leaves_out_what_means_something_else_here(start, tmp_path):
    """A number that was narrower is played as the one of today; what does not fit is named."""
    with BagWriter(tmp_path / "bag") as writer:
        about = definition("std_msgs/msg/String")
        writer.add_topic(Topic("/same", "std_msgs/msg/String", about.text, about.encoding, about.type_hash))
        writer.add_topic(Topic("/changed", "std_msgs/msg/String", "int8 x", "ros2msg", "RIHS01_00"))
        writer.add_topic(Topic("/unknown", "no_msgs/msg/Thing", "int8 x"))
        writer.add_topic(Topic("/other", "std_msgs/msg/String", "", serialization_format="json"))
        writer.add_topic(Topic("/class", "collections/abc/Mapping", "int8 x"))
        writer.add_topic(Topic("/st!te\n", "std_msgs/msg/String", about.text))
        writer.add_topic(Topic("/narrow", "std_msgs/msg/Float64", "float32 data"))
        writer.write("/narrow", b"\0\1\0\0\0\0\x20\x40", 1)
        writer.write("/narrow", b"\0\1\0\0\0", 1)
        for name in ("/same", "/changed", "/unknown", "/other", "/class", "/st!te\n"):
            writer.write(name, serialize_message(String(data="a")), 1)
    player = start("player", f"bag:={tmp_path / 'bag'}", "rate:=0.0")
    assert player.end() == 0, player.output()
    assert "played 2 messages" in player.output()
    for name in (
        "left out: /narrow: 1 messages, which cannot be read",
        "/changed: not played: type",
        "/unknown: not played: type",
        "/other: not played: messages are JSON",
        "/class: not played: type",
        r"'/st!te\n': not played: no name of a topic",
    ):
        assert name in player.output()


@pytest.mark.process
@pytest.mark.parametrize(
    ("arguments", "played", "left_out"),
    [
        ([], 1, ["/arm/chambers/command", "/arm/chambers/commands"]),
        (["exclude:=['*/commands']"], 1, ["/arm/chambers/command"]),
        (["topics:=['/arm/chambers/command']"], 1, []),
        (["topics:=['/arm/*']"], 3, []),
    ],
)
def test_player_drives_valves_only_on_request(start, tmp_path, arguments, played, left_out):
    names = [f"/arm/chambers/{name}" for name in ("state", "command", "commands")]
    with BagWriter(tmp_path / "bag") as writer:
        about = definition("std_msgs/msg/String")
        for name in names:
            writer.add_topic(Topic(name, "std_msgs/msg/String", about.text, about.encoding, about.type_hash))
            writer.write(name, serialize_message(String(data="a")), 1)
    player = start("player", f"bag:={tmp_path / 'bag'}", "rate:=0.0", *arguments)
    assert player.end() == 0, player.output()
    assert f"played {played} messages" in player.output()
    lines = [line for line in player.output().splitlines() if "left out" in line]
    assert len(lines) == bool(left_out)
    assert all(f"left out: {', '.join(left_out)} (" in line for line in lines)


def test_help_of_the_player_names_the_commands_that_it_leaves_out(soro):
    for text in (soro("play", "--help").out, Player.config_model.model_fields["topics"].description):
        assert "/chambers/command or /chambers/commands" in " ".join(text.split())


@pytest.mark.process
def test_player_fails_when_its_thread_does(domain, tmp_path):
    """A middleware that refuses a message raises RuntimeError, which is no SoroError."""
    bag = clock_bag(tmp_path / "bag", seconds=0.1)
    code = (
        "from rclpy.publisher import Publisher\n"
        "from soro_ros.nodes import player\n"
        "publish = Publisher.publish\n"
        "def refuse(self, message):\n"
        "    if isinstance(message, bytes): raise RuntimeError('cannot publish')\n"
        "    publish(self, message)\n"
        "Publisher.publish = refuse\n"
        "player.main()"
    )
    command = [sys.executable, "-c", code, "--ros-args", "-p", f"bag:={bag}", "-p", "rate:=1.0"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 1, done.stderr
    assert "RuntimeError: cannot publish" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "status", "key"),
    [
        (["folder:={tmp}/bag", "compression:=gzip"], 2, "compression"),
        (["folder:={tmp}"], 1, None),  # exists already
        (["folder:={tmp}/bag", "notes:=['scene']"], 2, "notes"),
        (["folder:={tmp}/bag", "exclude:=['a-b']"], 2, "exclude"),
        (["folder:={tmp}/bag", "topics:=['']"], 2, "topics"),
        (["folder:={tmp}/bag", "topics:=['a b c']"], 2, "topics"),
    ],
)
def test_recorder_names_what_is_wrong(node_main, tmp_path, arguments, status, key):
    ended = node_main("recorder", *given(*(argument.format(tmp=tmp_path) for argument in arguments)))
    assert ended.status == status, ended.err
    assert set(refused_keys(ended.err)) == ({key} if key else set())
    assert str(tmp_path) in ended.err or key
    assert "Traceback" not in ended.err


# Commands -----------------------------------------------------------------------------------------
def test_soro_play_and_soro_bag(soro, domain, tmp_path):
    bag = clock_bag(tmp_path / "bag", seconds=0.2)
    played = soro("play", str(bag), "--rate", "0", "--topic", "/numbers", "-r", "/numbers:=/b")
    assert played.status == 0, played.err
    assert "played 11 messages" in played.err
    told = soro("bag", "info", str(bag))
    assert told.status == 0, told.err
    assert "sensor_msgs/msg/JointState" in told.out
    assert "22 messages" in told.out
    content = (bag / "bag_0.mcap").read_bytes()
    (bag / "bag_0.mcap").write_bytes(content[:-100])
    assert "soro bag repair" in soro("bag", "info", str(bag)).out
    mended = soro("bag", "repair", str(bag))
    assert mended.status == 0
    assert "rewritten, 22 messages" in mended.out
    assert "soro bag repair" not in soro("bag", "info", str(bag)).out


def test_soro_bag_info_prints_names_as_they_are(soro, tmp_path):
    """What looks like markup is none, what would steer the terminal is replaced; attachments are listed."""
    with (tmp_path / "bag.mcap").open("wb") as stream:
        file = McapFile(stream, "none")
        file.add_topic(Topic("/a[/b]\x1b[31m", "std_msgs/msg/String", "string data"))
        file.add_metadata("setup[/x]", {"robot": "six_link"})
        file.add_attachment(Attachment(8, 7, "camera.yaml", "text/yaml", b"k: 1"))
        file.finish()
    told = soro("bag", "info", str(tmp_path / "bag.mcap"))
    assert told.status == 0, told.err
    for words in ("/a[/b]\N{REPLACEMENT CHARACTER}[31m", "setup[/x]", "camera.yaml: 4 B, text/yaml"):
        assert words in told.out


def test_soro_bag_info_says_how_much_of_many_things_it_leaves_out(soro, tmp_path):
    with (tmp_path / "bag.mcap").open("wb") as stream:
        file = McapFile(stream, "none")
        for number in range(1007):
            file.add_topic(Topic(f"/topic{number}", "std_msgs/msg/String", "string data"))
        for number in range(1008):
            file.add_metadata(f"note{number}", {})
        for number in range(1009):
            file.add_attachment(Attachment(0, 0, f"{number}.txt", "", b""))
        file.finish()
    told = soro("bag", "info", str(tmp_path / "bag.mcap"))
    assert told.status == 0, told.err
    lines = [line.strip() for line in told.out.splitlines()]
    assert [line for line in lines if line.startswith("and ")] == [
        "and 9 more attachments",
        "and 8 more metadata",
        "and 7 more topics",
    ]
    assert len(lines) < 3020


@pytest.mark.parametrize(
    ("arguments", "status", "name"),
    [
        (["play", "{tmp}/nothing"], 2, "nothing"),
        (["play", "{tmp}/folder"], 2, "folder"),
        (["play", "{tmp}/text.mcap"], 2, "text.mcap"),
        (["play", "{tmp}/text.mcap", "--rate", "-1"], 2, "rate"),
        (["bag", "info", "{tmp}/nothing"], 2, "nothing"),
        (["bag", "info", "{tmp}/text.mcap"], 2, "text.mcap"),
        (["bag", "repair", "{tmp}/text.mcap"], 2, "text.mcap"),
    ],
)
def test_commands_name_what_is_wrong(node_main, soro, tmp_path, arguments, status, name):
    (tmp_path / "text.mcap").write_text("t,p1,p2,p3\n")
    (tmp_path / "folder").mkdir()
    ended = soro(*(argument.format(tmp=tmp_path) for argument in arguments))
    assert ended.status == status, ended.err
    assert name in ended.err
    assert "Traceback" not in ended.err
