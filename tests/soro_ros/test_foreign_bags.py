"""Bags of others: own definitions, messages that cannot be read, other encodings, sqlite3."""

from __future__ import annotations

import csv
import re
import sqlite3
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty, Float64

from soro_core.errors import BagError
from soro_lab.bag import BagReader, BagWriter, Topic
from soro_lab.bag.mcap.mcap_file import McapFile
from soro_lab.scene import load_scene
from soro_ros.conversion.decoding import Messages, playing, reading
from soro_ros.conversion.interfaces import definition
from soro_ros.recordings.recording import read
from soro_ros.recordings.replay import replay

SMALL = Path(__file__).parents[2] / "bags" / "imu_and_outliers"
JOINT = "sensor_msgs/msg/JointState"
# As the installed type, with its fields in another order, and a number that is narrower.
TURNED = """float32[] effort
float64[] velocity
float64[] position
string[] name
std_msgs/Header header
================================================================================
MSG: std_msgs/Header
string frame_id
builtin_interfaces/Time stamp
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def turned(state: JointState, text: str = TURNED) -> bytes:
    """The bytes of a JointState by another definition."""
    store = Typestore()
    store.register(get_types_from_msg(text, JOINT))
    stamp = store.types["builtin_interfaces/msg/Time"](state.header.stamp.sec, state.header.stamp.nanosec)
    header = store.types["std_msgs/msg/Header"](state.header.frame_id, stamp)
    effort = np.array(state.effort, np.float32)
    arrays = np.array(state.velocity), np.array(state.position)
    message = store.types[JOINT](effort, *arrays, list(state.name), header)
    return bytes(store.serialize_cdr(message, JOINT))


def write(folder: Path, topics: Mapping[Topic, Sequence[bytes]]) -> Path:
    with BagWriter(folder) as writer:
        for topic, rows in topics.items():
            writer.add_topic(topic)
            for k, data in enumerate(rows):
                writer.write(topic.name, data, 10**9 + k * 10**7)
    return folder


def table(file: Path) -> list[dict[str, str]]:
    with file.open(newline="") as stream:
        return list(csv.DictReader(stream))


def state(k: int) -> JointState:
    found = JointState(name=["a", "b"], position=[1.0 + k, 2.0], velocity=[3.0, 4.0], effort=[5.0, 6.0 + k])
    found.header.stamp.sec, found.header.frame_id = k, "base"
    return found


# Definitions --------------------------------------------------------------------------------------
def test_fields_in_another_order_give_the_right_columns(soro, tmp_path):
    bag = write(tmp_path / "bag", {Topic("/s", JOINT, TURNED): [turned(state(k)) for k in range(5)]})
    ended = soro("bag", "convert", str(bag), str(tmp_path / "out"))
    assert ended.status == 0, ended.err
    rows = table(tmp_path / "out" / "s.csv")
    assert [float(row["position.a"]) for row in rows] == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert [float(row["effort.b"]) for row in rows] == [6.0, 7.0, 8.0, 9.0, 10.0]
    assert [row["header.stamp_ns"] for row in rows] == [str(k * 10**9) for k in range(5)]
    with BagReader(bag) as reader:
        found = [message for _, message in Messages(reader, {"/s": JointState})()]
    assert found == [state(k) for k in range(5)]


IDL = """module lab_msgs { module msg {
  struct Pair {
    double first;
    lab_msgs::msg::Part second;
  };
}; };
"""
PART = "module lab_msgs { module msg { struct Part { float x; }; }; };\n"


@pytest.mark.parametrize("ruled", [True, False], ids=["a rule before each definition", "a rule between them"])
def test_definitions_in_idl_are_read(soro, tmp_path, ruled):
    """In MCAP a rule and a name stand before each definition."""
    rule = "=" * 80 + "\nIDL: lab_msgs/msg/"
    text = f"{rule}Pair\n{IDL}{rule}Part\n{PART}" if ruled else f"{IDL}{rule}Part\n{PART}"
    topic = Topic("/p", "lab_msgs/msg/Pair", text, definition_encoding="ros2idl")
    data = b"\0\1\0\0" + np.float64(0.5).tobytes() + np.float32(2.5).tobytes()
    bag = write(tmp_path / "bag", {topic: [data] * 3})
    ended = soro("bag", "convert", str(bag), str(tmp_path / "out"))
    assert ended.status == 0, ended.err
    assert [(row["first"], row["second.x"]) for row in table(tmp_path / "out" / "p.csv")] == [
        ("0.5", "2.5")
    ] * 3


def test_messages_of_others_on_the_topics_of_a_run_do_not_end_its_report(tmp_path):
    """Other columns, before those of the run too, and numbers of no arm."""
    names = ["distance", "bending", "rotation", "x", "y", "z"]
    good = [JointState(name=names, position=[1e-3 * k] * 6) for k in range(5)]
    odd = [JointState(name=["a", "b", "c"], position=[1.0, 2.0, 3.0])] * 2
    huge = [JointState(name=names, position=[1.8e307] * 6)]
    rows = [serialize_message(message) for message in odd + good + huge]
    topic = Topic("/arm/shadow/difference", JOINT)
    found = read(write(tmp_path / "bag", {topic: rows}), "").shadow
    assert found.names == tuple(names)
    assert found.value == pytest.approx(np.array([message.position for message in good]))


@pytest.mark.parametrize(
    ("text", "data", "column", "value"),
    [
        ("float32 data\n", b"\0\1\0\0\0\0\x20\x40", "data", 2.5),
        (
            "int64 count\nfloat32 data\n",
            b"\0\1\0\0" + (7).to_bytes(8, "little") + b"\0\0\x20\x40",
            "count",
            7,
        ),
        ("string data\n", b"\0\1\0\0\3\0\0\0up\0", "data", "up"),
    ],
)
def test_a_number_of_another_definition_is_read_by_that_one(soro, tmp_path, text, data, column, value):
    """Also as a picture, and of a type that is not installed."""
    for kind in ("std_msgs/msg/Float64", "lab_msgs/msg/Reading"):
        name = kind.rpartition("/")[2]
        bag = write(tmp_path / name, {Topic("/f", kind, text): [data] * 3})
        ended = soro("bag", "convert", str(bag), str(tmp_path / f"out{name}"))
        assert ended.status == 0, ended.err
        assert [type(value)(row[column]) for row in table(tmp_path / f"out{name}" / "f.csv")] == [value] * 3
        if not isinstance(value, str):
            picture = tmp_path / f"{name}.png"
            ended = soro("plot", str(bag), "--topic", "/f", "--field", column, "--out", str(picture))
            assert ended.status == 0, ended.err
            assert picture.stat().st_size > 5000


UNREADABLE = {
    "no words of one": "what is this",
    "part missing": "lab_msgs/Missing part\n",
    "wide text": "wstring data\n",
    "itself": "std_msgs/Float64 again\n",
    "large array": "string[999999999] data\n",
    "long": "float64 x\n" * 30_000,
}


@pytest.mark.parametrize("name", UNREADABLE)
@pytest.mark.parametrize("command", ["convert", "plot"])
def test_a_definition_that_cannot_be_read_is_refused_by_name(soro, tmp_path, name, command):
    bag = write(tmp_path / "bag", {Topic("/f", "std_msgs/msg/Float64", UNREADABLE[name]): [bytes(12)]})
    words = ("bag", "convert", bag, tmp_path / "out") if command == "convert" else ("plot", bag, "-t", "/f")
    ended = soro(*map(str, words))
    assert ended.status == 2
    assert "/f: the definition of std_msgs/msg/Float64 cannot be read" in ended.err
    assert len(ended.err.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_two_definitions_of_one_topic_are_refused_by_name(soro, tmp_path):
    """In two files of a bag: neither may be read by that of the other."""
    rows = {"float64 data\n": b"\0\1\0\0" + bytes(8), "float32 data\n": b"\0\1\0\0" + bytes(4)}
    for number, (text, row) in enumerate(rows.items()):
        part = write(tmp_path / f"bag_{number}", {Topic("/f", "std_msgs/msg/Float64", text): [row]})
        (tmp_path / "both").mkdir(exist_ok=True)
        (part / f"bag_{number}_0.mcap").rename(tmp_path / "both" / f"bag_{number}.mcap")
    ended = soro("bag", "convert", str(tmp_path / "both"), str(tmp_path / "out"))
    assert ended.status == 2
    assert "/f: the bag has several definitions of std_msgs/msg/Float64" in ended.err
    assert soro("bag", "info", str(tmp_path / "both")).status == 0


def test_a_message_is_played_as_the_installed_type_or_not_at_all(tmp_path):
    """The same definition byte for byte, one that fits by its fields, and what does not fit by name."""
    about = definition(JOINT)
    own = Topic("/s", JOINT, about.text, about.encoding, about.type_hash)
    data = bytes(serialize_message(state(1)))
    assert playing(own, JointState, tmp_path)(data) is data
    played = playing(Topic("/s", JOINT, TURNED), JointState, tmp_path)(turned(state(1)))
    assert deserialize_message(played, JointState) == state(1)
    for text, words in (
        (TURNED.replace("string[] name", "int8[] name"), "JointState.name was sequence<int8>, and is seq"),
        (TURNED.replace("float64[] velocity", "float64[] speed"), "JointState.velocity was missing"),
        (TURNED.replace("string frame_id", "string frame"), "std_msgs/Header.frame_id was missing"),
    ):
        with pytest.raises(BagError, match=f"/s: type {JOINT} was defined otherwise.*{words}"):
            playing(Topic("/s", JOINT, text), JointState, tmp_path)
    with pytest.raises(BagError, match="does not say how"):
        reading(Topic("/s", JOINT, "", type_hash="RIHS01_00"), JointState, tmp_path)


def with_definition(folder: Path, name: str, text: str, change: Callable[[Any], bytes]) -> Path:
    """The small recorded run with one topic by another definition."""
    with BagReader(SMALL) as reader, BagWriter(folder) as writer:
        for topic in reader.topics:
            same = topic.name != name
            writer.add_topic(topic if same else Topic(name, topic.type, text, qos=topic.qos))
        for item in reader.messages():
            data = item.data if item.topic != name else change(deserialize_message(item.data, JointState))
            writer.write(item.topic, data, item.log_time_ns)
    return folder


@pytest.mark.slow
def test_report_and_replay_read_by_the_definition_in_the_bag(tmp_path):
    """States in another order: the same run; without a field it is refused by name."""
    name = "/imu_and_outliers/chambers/state"
    text = TURNED.replace("float32[] effort", "float64[] effort")

    def turn(message: JointState) -> bytes:
        store = Typestore()
        store.register(get_types_from_msg(text, JOINT))
        at = message.header.stamp
        stamp = store.types["builtin_interfaces/msg/Time"](at.sec, at.nanosec)
        header = store.types["std_msgs/msg/Header"](message.header.frame_id, stamp)
        arrays = (np.array(part, float) for part in (message.effort, message.velocity, message.position))
        return bytes(store.serialize_cdr(store.types[JOINT](*arrays, list(message.name), header), JOINT))

    bag = with_definition(tmp_path / "turned", name, text, turn)
    before, after = read(SMALL, "imu_and_outliers").reading, read(bag, "imu_and_outliers").reading
    np.testing.assert_array_equal(before.value, after.value)
    scene = load_scene(SMALL / "scene.yaml")
    found = replay(bag, scene, ["controller"])
    assert found.same
    assert found.problems == ()
    other = with_definition(
        tmp_path / "other", name, "float64[] effort\n", lambda message: b"\0\1\0\0\0\0\0\0"
    )
    with pytest.raises(BagError, match=f"{name}: type {JOINT} was defined otherwise"):
        replay(other, scene, ["controller"])
    assert any(name in problem for problem in read(other, "imu_and_outliers").problems)


# Messages that cannot be read ---------------------------------------------------------------------
def test_one_bad_message_costs_itself(soro, tmp_path):
    about = definition("std_msgs/msg/Float64")
    rows = [bytes(serialize_message(Float64(data=1.5 * k))) for k in range(50)]
    bad = [*rows[:20], rows[20][:9], *rows[21:]]
    topics = [Topic(name, "std_msgs/msg/Float64", about.text) for name in ("/good", "/bad", "/none")]
    bag = write(tmp_path / "bag", dict(zip(topics, (rows, bad, [b"\0\1\0\0"]), strict=True)))
    ended = soro("bag", "convert", str(bag), str(tmp_path / "out"))
    assert ended.status == 0
    assert len(table(tmp_path / "out" / "good.csv")) == 50
    left = table(tmp_path / "out" / "bad.csv")
    assert [float(row["data"]) for row in left] == [1.5 * k for k in range(50) if k != 20]
    assert not (tmp_path / "out" / "none.csv").exists()
    assert len(ended.err.splitlines()) == 2
    assert "left out: /bad: 1 of 50 messages" in ended.err
    assert "left out: /none: 1 of 1 messages" in ended.err
    ended = soro("plot", str(bag), "--topic", "/bad", "--field", "data", "--out", str(tmp_path / "p.png"))
    assert ended.status == 0
    assert "left out: /bad: 1 of 50 messages" in ended.err


def test_an_empty_message_of_four_bytes_is_one(soro, tmp_path):
    for text in (definition("std_msgs/msg/Empty").text, "# nothing\n"):
        topic = Topic("/start", "std_msgs/msg/Empty", text)
        rows = [b"\0\1\0\0", bytes(serialize_message(Empty()))]
        bag = write(tmp_path / f"bag{len(text)}", {topic: rows})
        ended = soro("bag", "convert", str(bag), str(tmp_path / f"out{len(text)}"))
        assert (ended.status, ended.err) == (0, "")
        assert len(table(tmp_path / f"out{len(text)}" / "start.csv")) == 2


def test_a_bad_message_costs_itself_in_report_and_replay(tmp_path):
    name = "/imu_and_outliers/chambers/command"
    with BagReader(SMALL) as reader, BagWriter(tmp_path / "bag") as writer:
        for topic in reader.topics:
            writer.add_topic(topic)
        for number, item in enumerate(reader.messages()):
            short = item.topic == name and number > 500
            name = "" if short else name
            writer.write(item.topic, item.data[:-4] if short else item.data, item.log_time_ns)
    recording = read(tmp_path / "bag", "imu_and_outliers")
    assert len(recording.command.t) == len(read(SMALL, "imu_and_outliers").command.t) - 1
    assert ["1 of" in problem and "chambers/command" in problem for problem in recording.problems] == [True]
    found = replay(tmp_path / "bag", load_scene(SMALL / "scene.yaml"), ["controller"])
    assert ["1 of" in problem for problem in found.problems] == [True]
    assert sum(topic.differing for topic in found.topics) == 1


# Other encodings and storages -----------------------------------------------------------------------
@pytest.mark.parametrize(
    ("encoding", "words"), [("json", "JSON"), ("ros1", "ROS 1"), ("protobuf", "Protobuf"), ("x", "'x'")]
)
def test_messages_of_another_encoding_are_named(soro, tmp_path, encoding, words):
    topics = {
        Topic(f"/{kind}", f"{kind}_msgs/msg/Float64", "float64 data\n", serialization_format=encoding): [
            b"{}"
        ]
        for kind in ("std", "lab")
    }
    bag = write(tmp_path / "bag", topics)
    robot = "tue_three_bellow"
    commands = (
        ("bag", "convert", bag, tmp_path / "out"),
        ("plot", bag, "-t", "/std"),
        ("plot", bag),
        ("report", bag),
        ("play", bag),
        ("view", bag, "--robot", robot),
        ("identify", robot, bag, "--out", tmp_path / "found.yaml"),
    )
    for arguments in commands:
        ended = soro(*map(str, arguments))
        assert ended.status == 2
        assert ": messages are " in ended.err
        assert words in ended.err
    # The last one says what, where and what is allowed, each once.
    line = rf"soro: {re.escape(str(bag))}: /\w+: messages are [^:;]+; allowed: ROS 2 messages \(cdr\)\n"
    assert re.fullmatch(line, ended.err)
    assert not (tmp_path / "out").exists()
    told = soro("bag", "info", str(bag))
    assert told.status == 0
    assert f"std_msgs/msg/Float64 ({words}" in told.out or words == "'x'"


def database(folder: Path, rows: Mapping[str, Sequence[Any]]) -> Path:
    """A bag as rosbag2 wrote it before Iron: no definitions in it."""
    folder.mkdir()
    with sqlite3.connect(folder / "bag_0.db3") as connection:
        connection.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
            "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)"
        )
        connection.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
            "timestamp INTEGER NOT NULL, data BLOB NOT NULL)"
        )
        for number, (name, messages) in enumerate(rows.items(), 1):
            values = number, name, "std_msgs/msg/Float64", "cdr", ""
            connection.execute("INSERT INTO topics VALUES(?, ?, ?, ?, ?)", values)
            for k, message in enumerate(messages):
                data = number, 10**9 + k, bytes(serialize_message(message))
                connection.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", data)
    connection.close()
    return folder


def test_a_sqlite_bag_is_shown_converted_and_drawn(soro, tmp_path):
    bag = database(tmp_path / "bag", {"/f": [Float64(data=2.0 * k) for k in range(30)], "/g": []})
    for path, out in ((bag, tmp_path / "a"), (bag / "bag_0.db3", tmp_path / "b")):
        told = soro("bag", "info", str(path))
        assert told.status == 0, told.err
        assert "std_msgs/msg/Float64" in told.out
        assert "bag_0.db3" in told.out
        assert soro("bag", "convert", str(path), str(out)).status == 0
        assert [float(row["data"]) for row in table(out / "f.csv")] == [2.0 * k for k in range(30)]
        ended = soro("plot", str(path), "-t", "/f", "--out", str(tmp_path / "p.png"))
        assert ended.status == 0, ended.err
        ended = soro("bag", "repair", str(path))
        assert ended.status == 2
        assert "sqlite3" in ended.err


def test_commands_take_the_folder_of_a_run(soro, tmp_path):
    about = definition("std_msgs/msg/Float64")
    rows = [bytes(serialize_message(Float64(data=1.0)))]
    write(tmp_path / "run" / "bag", {Topic("/f", "std_msgs/msg/Float64", about.text): rows})
    for arguments in (("info",), ("repair",), ("convert", tmp_path / "out")):
        ended = soro("bag", arguments[0], str(tmp_path / "run"), *map(str, arguments[1:]))
        assert ended.status == 0, ended.err
    assert len(table(tmp_path / "out" / "f.csv")) == 1


def test_the_cases_from_outside(soro, tmp_path, data):
    """Files of an outside trial."""
    root = data / "outside_cases"
    if not root.is_dir():
        pytest.skip(f"no cases in {root}")
    ended = soro("bag", "convert", str(root / "bag_one_bad_message/onebad.mcap"), str(tmp_path / "a"))
    assert (len(table(tmp_path / "a/good.csv")), len(table(tmp_path / "a/bad.csv"))) == (50, 49)
    assert "1 of 50 messages" in ended.err
    assert (
        soro("bag", "convert", str(root / "bag_one_bad_message/empty.mcap"), str(tmp_path / "b")).status == 0
    )
    for name, words in (("json", "JSON"), ("json_rosname", "JSON"), ("ros1", "ROS 1")):
        ended = soro("bag", "convert", str(root / f"bag_other_encodings/{name}.mcap"), str(tmp_path / "c"))
        assert ended.status == 2
        assert f"messages are {words}" in ended.err
        assert len(ended.err.splitlines()) == 1


def test_a_repair_that_saves_nothing_is_no_success(soro, tmp_path):
    """The one chunk claims what no chunk may have."""
    path = tmp_path / "run_0.mcap"
    with path.open("wb") as stream:
        mcap = McapFile(stream, "zstd")
        channel = mcap.add_topic(Topic("/x", "std_msgs/msg/Float64", "float64 data\n"))
        mcap.write(channel, bytes(12), 1, 1, 1)
        mcap.finish()
    content = bytearray(path.read_bytes())
    chunk = content.index(b"zstd") - 4
    content[chunk - 12 : chunk - 4] = (1 << 40).to_bytes(8, "little")
    path.write_bytes(content)
    assert "'soro bag repair" not in soro("bag", "info", str(path)).out
    ended = soro("bag", "repair", str(path))
    assert (ended.status, ended.err) == (1, f"soro: {path}: no message could be saved\n")
    assert path.with_name("run_0.mcap.damaged").read_bytes() == content
