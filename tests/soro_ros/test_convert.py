"""Bags as tables and back: nothing is lost, columns have units, and what is wrong is one line."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import yaml
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from soro_lab.bag import BagReader, BagWriter, Topic
from soro_lab.scene import load_scene
from soro_ros.conversion.fields import built, flat
from soro_ros.conversion.interfaces import message_class
from soro_ros.conversion.units import column_of, path_of
from soro_ros.recordings.replay import replay

BAGS = Path(__file__).parents[2] / "bags"
SMALL = BAGS / "imu_and_outliers"
STATE = "/imu_and_outliers/chambers/state"


def contents(bag: Path, topics: list[str] | None = None) -> dict[str, list[object]]:
    """Log time and message, by topic."""
    found: dict[str, list[object]] = {}
    with BagReader(bag) as reader:
        for item in reader.messages(topics):
            message = deserialize_message(item.data, message_class(item.type))
            found.setdefault(item.topic, []).append((item.log_time_ns, repr(message)))
    return found


@pytest.mark.slow
def test_a_bag_comes_back_from_csv_as_it_was(soro, tmp_path):
    """Readings and poses, nested diagnostics, messages without values: what the estimator takes, and more."""
    bag = BAGS / "track_circle_lockstep_2s"
    arm = "/track_circle/arm"
    kept = [f"{arm}/learned", f"{arm}/state", "*/sensors/*", "*/chambers/state", "/diagnostics", "*event"]
    wanted = [word for name in kept for word in ("--topic", name)]
    ended = soro("bag", "convert", str(bag), str(tmp_path / "tables"), *wanted)
    assert ended.status == 0, ended.err
    ended = soro("bag", "convert", str(tmp_path / "tables"), str(tmp_path / "back"))
    assert ended.status == 0, ended.err
    with BagReader(bag) as before, BagReader(tmp_path / "back") as after:
        assert not after.problems
        there = [topic.name for topic in after.topics]
        assert after.topics == tuple(topic for topic in before.topics if topic.name in there)
    assert contents(tmp_path / "back") == contents(bag, there)
    assert len(there) == 11
    scene = load_scene(bag / "scene.yaml")
    again = [replay(folder, scene, ["estimator"], tolerance=0.0) for folder in (tmp_path / "back", bag)]
    found, expected = ({one.topic: one for one in done.topics}[f"{arm}/state"] for done in again)
    assert (found.compared, found.worst, found.first) == (expected.compared, expected.worst, expected.first)
    assert found.compared > 0
    assert found.worst < 1e-12


def test_columns_have_names_and_units(soro, tmp_path):
    assert soro("bag", "convert", str(SMALL), str(tmp_path / "t"), "-t", "*/chambers/*").status == 0
    assert sorted(file.name for file in (tmp_path / "t").iterdir()) == [
        "imu_and_outliers.chambers.command.csv",
        "imu_and_outliers.chambers.latch.csv",
        "imu_and_outliers.chambers.state.csv",
        "topics.yaml",
    ]
    with (tmp_path / "t" / "imu_and_outliers.chambers.state.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == ["log_time_ns", "header.stamp_ns", "header.frame_id"] + [
        f"effort.link0/chamber{k}_pa" for k in range(3)
    ]
    with BagReader(SMALL) as reader:
        states = [deserialize_message(m.data, JointState) for m in reader.messages([STATE])]
    found = np.array([[float(row[f"effort.link0/chamber{k}_pa"]) for k in range(3)] for row in rows])
    assert np.array_equal(found, [list(state.effort) for state in states])


@pytest.mark.parametrize(
    ("topic", "path", "column"),
    [
        ("/a/arm/state", "position.link0/bending_x", "position.link0/bending_x_per_m"),
        ("/a/arm/state", "position.link0/elongation", "position.link0/elongation"),
        ("/a/truth/state", "velocity.link0/elongation", "velocity.link0/elongation_per_s"),
        ("/a/arm/tip", "pose.pose.position.z", "pose.pose.position.z_m"),
        ("/a/sensors/imu0", "angular_velocity.y", "angular_velocity.y_rad_s"),
        ("/a/sensors/imu0", "linear_acceleration.y", "linear_acceleration.y_m_s2"),
        ("/a/other", "position.link0/bending_x", "position.link0/bending_x"),
    ],
)
def test_units_of_columns(topic, path, column):
    assert column_of(topic, path) == column
    assert path_of(topic, column) == path
    assert path_of("/a/chambers/state", "effort.x_kpa") == ""


def test_parquet_has_the_columns_and_values_of_csv(soro, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    for form in ("csv", "parquet"):
        out = str(tmp_path / form)
        assert soro("bag", "convert", str(SMALL), out, "--format", form, "-t", "*/arm/*").status == 0
    table = parquet.read_table(tmp_path / "parquet" / "imu_and_outliers.arm.state.parquet")
    with (tmp_path / "csv" / "imu_and_outliers.arm.state.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert table.column_names == list(rows[0])
    assert table.num_rows == len(rows)
    column = "position.link0/elongation"
    values = table[column].to_pylist()
    assert values == [float(row[column]) if row[column] else None for row in rows]
    assert values[0] is None  # the first message says that there is no estimate
    assert str(table.schema.field(column).type) == "double"


def own_tables(folder: Path, text: str, **entry: object) -> Path:
    """A folder as a person writes it."""
    folder.mkdir()
    known = {"file": "mine.csv", "type": "sensor_msgs/msg/JointState", "names": ["c0", "c1"]} | entry
    (folder / "topics.yaml").write_text(yaml.safe_dump({"/arm/chambers/state": known}))
    (folder / "mine.csv").write_text(text)
    return folder


def test_csv_of_ones_own_becomes_a_bag(soro, tmp_path):
    text = "effort.c1_pa,log_time_ns,effort.c0_pa\n2e4,1000,1e4\n4e4,2000,nan\n"
    ended = soro("bag", "convert", str(own_tables(tmp_path / "mine", text)), str(tmp_path / "bag"))
    assert ended.status == 0, ended.err
    with BagReader(tmp_path / "bag") as reader:
        first, second = (deserialize_message(m.data, JointState) for m in reader.messages())
    assert (list(first.name), list(first.effort)) == (["c0", "c1"], [1e4, 2e4])
    assert np.isnan(second.effort[0])


def test_csv_of_other_programs_becomes_a_bag_without_its_damaged_rows(soro, tmp_path):
    """A spreadsheet's file, cut in its last row, with a text among the numbers and zeros of a power cut."""
    rows = [f"{k};{k}e3;{k},5" for k in range(1, 10)]
    rows[3], rows[5] = "4;x;4,5", "\0" * 9
    text = "\N{BYTE ORDER MARK}exported today\nlog_time_ns;effort.c0_pa;effort.c1_pa\n" + "\n".join(rows)
    ended = soro("bag", "convert", str(own_tables(tmp_path / "mine", text[:-2])), str(tmp_path / "bag"))
    assert ended.status == 0, ended.err
    assert "mine.csv: 3 of 9 rows left out; the first is line 6: effort.0: 'x' is no double" in ended.err
    with BagReader(tmp_path / "bag") as reader:
        found = [deserialize_message(m.data, JointState) for m in reader.messages()]
    assert [list(state.effort) for state in found] == [[k * 1e3, k + 0.5] for k in (1, 2, 3, 5, 7, 8)]


def test_texts_of_several_lines_come_back(soro, tmp_path):
    """With commas, quotes, spaces and marks of comments, which a table of numbers does not keep."""
    texts = ['# a\nb, "c"', "  d ", "% e\r\n\n f", "g"]
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic(Topic("/s", "std_msgs/msg/String"))
        for k, text in enumerate(texts):
            writer.write("/s", serialize_message(String(data=text)), k)
    assert soro("bag", "convert", str(tmp_path / "bag"), str(tmp_path / "t")).status == 0
    assert soro("bag", "convert", str(tmp_path / "t"), str(tmp_path / "back")).status == 0
    assert contents(tmp_path / "back") == contents(tmp_path / "bag")


WRONG = {
    "column": ("log_time_ns,efort.c0_pa\n1,2\n", {}, "column: got 'efort.c0_pa'; allowed: a value of"),
    "joint": ("log_time_ns,effort.c9_pa\n1,2\n", {}, "column: got 'effort.c9_pa'; allowed: a value of"),
    "unit": (
        "log_time_ns,effort.c0_kpa\n1,2\n",
        {},
        "got 'effort.c0_kpa'; allowed: effort.c0_pa",
    ),
    "no unit": ("log_time_ns,effort.c0\n1,2\n", {}, "got 'effort.c0'; allowed: effort.c0_pa"),
    "no unit of a name with spaces": (
        "log_time_ns,effort.left arm\n1,2\n",
        {"names": ["left arm", "c1"]},
        "got 'effort.left arm'; allowed: 'effort.left arm_pa'",
    ),
    "joint beside names with spaces": (
        "log_time_ns,effort.c9_pa\n1,2\n",
        {"names": ["left arm", "up, right"]},
        "sensor_msgs/msg/JointState, of 'left arm', 'up, right'",
    ),
    "no time beside names with spaces": (
        '"effort.left arm_pa","effort.a, b_pa"\n1,2\n',
        {"names": ["left arm", "a, b"]},
        "columns 'effort.left arm_pa', 'effort.a, b_pa'",
    ),
    "twice": ("log_time_ns,effort.c0_pa,effort.c0_pa\n1,2,3\n", {}, "allowed: each column once"),
    "no time": ("effort.c0_pa\n1\n", {}, "log_time_ns: got 'columns effort.c0_pa'"),
    "cell": (
        "log_time_ns,effort.c0_pa,effort.c1_pa\n1,x,2\n",
        {},
        "line 2: got \"effort.0: 'x' is no double\";",
    ),
    "time": ("log_time_ns,effort.c0_pa,effort.c1_pa\n-1,1,2\n", {}, "line 2: got 'log_time_ns: -1'"),
    "short": (
        "log_time_ns,effort.c0_pa,effort.c1_pa\n1,2\n",
        {},
        "line 2: got '2 cells, where there",
    ),
    "type": ("log_time_ns\n1\n", {"type": "a/msg/B"}, "type: got 'a/msg/B'; allowed: a type that is"),
    "file": ("", {"file": "gone.csv"}, "gone.csv: got 'no such file'"),
    "key": ("", {"unit": "pa"}, "unit"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_tables_are_one_line(soro, tmp_path, name):
    text, entry, words = WRONG[name]
    ended = soro("bag", "convert", str(own_tables(tmp_path / "mine", text, **entry)), str(tmp_path / "bag"))
    assert ended.status == 2, ended
    assert words in ended.err
    assert len(ended.err.splitlines()) == 1
    assert not (tmp_path / "bag").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("gone", "out"), "gone: no such file or folder"),
        ((str(SMALL), "out", "-t", "/none"), "no topic '/none'; there are /"),
        ((str(SMALL), "out", "--format", "xlsx"), "--format: got 'xlsx'; allowed: csv or parquet"),
        ((str(SMALL), "."), "exists already"),
        (("corrupt.mcap", "out"), "corrupt.mcap"),
    ],
)
def test_wrong_use_is_one_line(soro, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    Path("corrupt.mcap").write_bytes(b"\x89MCAP0\r\n" + bytes(100))
    ended = soro("bag", "convert", *arguments)
    assert ended.status == 2
    assert words in ended.err
    assert len(ended.err.splitlines()) == 1
    assert not Path("out").exists()


def test_names_that_change_stay_in_the_table(soro, tmp_path):
    """Two namings of one topic: the columns have numbers, and the names are values."""
    states = [JointState(name=["a"], effort=[1.0]), JointState(name=["b", "c"], effort=[2.0, 3.0])]
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic(Topic("/s", "sensor_msgs/msg/JointState"))
        for k, state in enumerate(states):
            writer.write("/s", serialize_message(state), k)
    assert soro("bag", "convert", str(tmp_path / "bag"), str(tmp_path / "t")).status == 0
    assert soro("bag", "convert", str(tmp_path / "t"), str(tmp_path / "back")).status == 0
    assert contents(tmp_path / "back") == contents(tmp_path / "bag")


def test_a_message_is_built_from_its_values():
    state = JointState(name=["a", "b"], position=[1.0, -2.5])
    state.header.stamp.sec, state.header.stamp.nanosec = -1, 5
    values = {path: str(value) for path, value in flat(state, by_name=False).items()}
    assert values["header.stamp_ns"] == "-999999995"
    assert built(JointState, values) == state
