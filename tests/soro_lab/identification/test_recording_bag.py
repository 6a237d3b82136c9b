"""Bags as recordings: what is read from them, where sensors sit, and one line for what is wrong."""

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_recordings import (
    CHAMBERS,
    IMU,
    JOINT,
    POSE,
    START_NS,
    STORE,
    arm_topics,
    imu,
    pose,
    pressures,
    robot,
    write_bag,
)
from rosbags.rosbag2 import Reader, Writer
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore

from soro_core.errors import BagError, ConfigError
from soro_core.robot import load_robot
from soro_lab.bag import BagReader, BagWriter
from soro_lab.identification.recording import Place, read_bag, summary
from tests.refused import fails, refused

Topics = dict[str, tuple[str, list[tuple[int, bytes]]]]
KEPT = Path(__file__).parents[3] / "bags" / "track_circle_lockstep_2s"


def test_a_run_of_the_twin_is_what_another_reader_finds():
    """The kept lockstep run, against rosbags: each value to the bit, stamps from the first pressure on."""
    recording = read_bag(KEPT, load_robot("tue_three_bellow"))
    stamps, values = {}, {}
    with Reader(KEPT) as reader:
        for connection, _, data in reader.messages():
            name = connection.topic.removeprefix("/track_circle/")
            if name not in ("chambers/state", "chambers/command", "sensors/pose0"):
                continue
            message = STORE.deserialize_cdr(data, connection.msgtype)
            if name != "sensors/pose0" and not message.name:
                continue
            at = message.header.stamp
            stamps.setdefault(name, []).append(at.sec + 1e-9 * at.nanosec)
            p, o = (message.pose.position, message.pose.orientation) if "pose" in name else (None, None)
            row = message.effort if p is None else [p.x, p.y, p.z, o.x, o.y, o.z, o.w]
            values.setdefault(name, []).append(row)
    for stream, name in zip(
        (recording.pressure, recording.command, recording.plates[0]),
        ("chambers/state", "chambers/command", "sensors/pose0"),
        strict=True,
    ):
        theirs = np.array(values[name])
        new = np.concatenate([[True], (np.diff(theirs, axis=0) != 0.0).any(axis=1)])
        if name == "chambers/command":  # set points stand still, and all count
            new[:] = True
        t = np.array(stamps[name])[new] - stamps["chambers/state"][0]
        np.testing.assert_allclose(stream.t, t, atol=1e-9)
        np.testing.assert_allclose(stream.table(), theirs[new], rtol=0.0, atol=1e-15)
        faults = next(each for each in recording.faults if each.stream == stream.name)
        assert (faults.samples, faults.repeated) == (len(theirs), int((~new).sum()))
    assert len(recording.pressure.t) > 390
    assert recording.plates[0].place == Place(0)  # of its scene.yaml
    assert (recording.frame, recording.notes) == ("world", ())


def test_pressures_stand_in_the_order_of_the_robot(tmp_path):
    recording = read_bag(write_bag(tmp_path / "bag", arm_topics()), robot())
    np.testing.assert_array_equal(recording.pressure.values[3], [1e3 + 3, 2e3 + 3])
    np.testing.assert_array_equal(recording.command.values[3], [1e3, 2e3])
    assert recording.chambers == CHAMBERS
    assert recording.frame == "lab"
    # No scene says where the only sensor sits.
    assert recording.plates[0].place == Place(1)
    assert len(recording.notes) == 1
    assert "sensors/pose0" in recording.notes[0]
    assert recording.notes[0] in summary(recording)


def imus(topics: Topics, has_orientation: bool) -> tuple[str, list[tuple[int, bytes]]]:
    """Samples of an IMU at the stamps of the poses."""
    stamps = [ns for ns, _ in topics["/arm/sensors/pose0"][1]]
    return IMU, [(ns, imu(ns, (k, 2, 3), (4, 5, 6), has_orientation)) for k, ns in enumerate(stamps)]


def with_sensors(folder: Path, locations: str = "") -> Path:
    topics = arm_topics()
    for number in (2, 10):
        topics[f"/arm/sensors/pose{number}"] = topics["/arm/sensors/pose0"]
    topics["/arm/sensors/imu0"] = imus(topics, True)
    topics["/arm/sensors/length"] = topics["/arm/chambers/state"]  # another sensor is left alone
    write_bag(folder / "bag", topics)
    if locations:
        (folder / "scene_used.yaml").write_text(locations)
    return folder


def test_places_come_from_the_scene_and_an_option_precedes_it(tmp_path):
    many = ", ".join(str(1.0 - 0.05 * k) for k in range(11))
    scene = f"twin: {{pose: {{locations: [{many}]}}, imu: {{location: 0.25}}}}\n"
    run = with_sensors(tmp_path, scene)
    given = {"sensors/pose10": Place(0, 0.03)}
    for path in (run, run / "bag"):
        recording = read_bag(path, robot(), given)
        assert [plate.name for plate in recording.plates] == [f"sensors/pose{k}" for k in (0, 2, 10)]
        places = [plate.place for plate in recording.plates]
        assert places[0] == Place(1)
        assert places[1].link == 1
        assert places[1].s == pytest.approx(0.08)
        assert places[2] == Place(0, 0.03)
        assert recording.imus[0].place == Place(0, 0.05)
        assert recording.name == tmp_path.name
    # Half of the length is the end of the first link, wherever a fit puts it.
    (tmp_path / "scene_used.yaml").write_text(scene.replace("0.9,", "0.5,"))
    assert read_bag(run, robot()).plates[1].place == Place(0)


def test_a_sensor_without_a_place_is_refused(tmp_path):
    run = with_sensors(tmp_path)
    with fails(ConfigError, where=str(run / "bag"), key="sensors/pose2"):
        read_bag(run, robot())
    with fails(ConfigError, "sensors/pose0", "sensors/pose10", "sensors/imu0", key="sensors/pose7"):
        read_bag(run, robot(), {"sensors/pose7": Place(0)})


def test_an_imu_may_have_no_orientation(tmp_path):
    topics = arm_topics()
    topics["/arm/sensors/imu0"], topics["/arm/sensors/imu1"] = imus(topics, True), imus(topics, False)
    bag = write_bag(tmp_path / "bag", topics)
    first, second = read_bag(bag, robot(), {"sensors/imu1": Place(0)}).imus
    np.testing.assert_array_equal(first.gyro[7], [7, 2, 3])
    np.testing.assert_array_equal(first.accel[7], [4, 5, 6])
    np.testing.assert_array_equal(first.orientation[7], [0.0, 0.6, 0.0, 0.8])
    assert second.orientation is None
    assert second.table().shape == (40, 6)


def test_other_chambers_are_refused_with_those_of_the_robot(tmp_path):
    topics = arm_topics()
    name = "/arm/chambers/state"
    for names in (("link0/chamber0", "link0/chamber1"), CHAMBERS[:1], (*CHAMBERS, "gripper")):
        ns = topics[name][1][0][0]
        rows = [(ns + k, pressures(ns + k, names, [1.0] * len(names))) for k in range(3)]
        bag = write_bag(tmp_path / f"bag{len(names)}{names[-1][-1]}", {**topics, name: (JOINT, rows)})
        with fails(ConfigError, *CHAMBERS, where=str(bag), key=name):
            read_bag(bag, robot())


def test_a_bag_without_pressures_is_refused_and_one_without_poses_has_no_shape(tmp_path):
    topics = arm_topics()
    left = {name: rows for name, rows in topics.items() if not name.endswith("chambers/state")}
    bag = write_bag(tmp_path / "bag", left)
    with refused(key="chambers/state", names=("chambers/state",)) as caught:
        read_bag(bag, robot())
    assert caught.value.where == str(bag)
    blind = {name: rows for name, rows in topics.items() if "pose" not in name}
    for name, given in (("blind", blind), ("silent", {**blind, "/arm/sensors/pose0": (POSE, [])})):
        recording = read_bag(write_bag(tmp_path / name, given), robot())
        assert recording.shapes == ()
        assert recording.command is not None
        assert recording.span == (recording.pressure.t[0], recording.pressure.t[-1])
    typed = {**topics, "/arm/sensors/pose1": topics["/arm/chambers/state"]}
    with refused(key="/arm/sensors/pose1", got=JOINT, names=(POSE,)):
        read_bag(write_bag(tmp_path / "typed", typed), robot())


def test_one_of_several_arms_is_named(tmp_path):
    bag = write_bag(tmp_path / "bag", {**arm_topics(), **arm_topics(30, "/other"), **arm_topics(20, "")})
    with refused(key="namespace", names=("arm", "other", "/")):
        read_bag(bag, robot())
    with refused(key="namespace", got="third", names=("arm", "other")):
        read_bag(bag, robot(), namespace="third")
    assert read_bag(bag, robot(), namespace="other").faults[0].samples == 30
    assert read_bag(bag, robot(), namespace="/arm/").faults[0].samples == 40
    assert read_bag(bag, robot(), namespace="/").faults[0].samples == 20


def test_time_that_runs_backwards(tmp_path):
    """A late message is left out and counted; a clock that was set back is refused."""
    topics = arm_topics()
    kind, rows = topics["/arm/sensors/pose0"]
    rows[10], rows[11] = rows[11], rows[10]
    topics["/arm/sensors/pose0"] = kind, rows
    recording = read_bag(write_bag(tmp_path / "late", topics), robot())
    faults = next(each for each in recording.faults if each.stream == "sensors/pose0")
    assert (faults.backwards, faults.left_out) == (1, 1)
    assert (np.diff(recording.plates[0].t) > 0.0).all()
    early = START_NS - 10**9
    topics["/arm/sensors/pose0"] = kind, [*rows, (early, pose(early, (0, 0, 0), (0, 0, 0, 1)))]
    bag = write_bag(tmp_path / "set", topics)
    with fails(ConfigError, "sample 41", where=str(bag), key="sensors/pose0"):
        read_bag(bag, robot())


def test_poses_on_another_clock_are_refused(tmp_path):
    topics = arm_topics()
    shifted = [
        (ns, pose(ns + 3600 * 10**9, (1e-3 * k, 0, 0), (0, 0, 0, 1)))
        for k, (ns, _) in enumerate(topics["/arm/sensors/pose0"][1])
    ]
    bag = write_bag(tmp_path / "bag", {**topics, "/arm/sensors/pose0": (POSE, shifted)})
    with fails(ConfigError, "3600.000", where=str(bag), key="sensors/pose0"):
        read_bag(bag, robot())


def test_what_is_no_bag_is_refused(tmp_path):
    with fails(BagError, code="missing"):
        read_bag(tmp_path / "absent", robot())


def test_damaged_messages_are_left_out_and_counted(tmp_path):
    """A short pose, one with a huge number of names, one of another encoding: each costs itself."""
    topics = arm_topics()
    _, poses = topics["/arm/sensors/pose0"]
    _, states = topics["/arm/chambers/state"]
    poses[5] = poses[5][0], poses[5][1][:-8]
    states[7] = states[7][0], states[7][1][:20] + struct.pack("<I", 2**31) + states[7][1][24:]
    states[9] = states[9][0], b"\0\3" + states[9][1][2:]
    recording = read_bag(write_bag(tmp_path / "bag", topics), robot())
    samples = {each.stream: each.samples for each in recording.faults}
    assert (samples["sensors/pose0"], samples["pressure"], samples["command"]) == (39, 38, 40)
    told = summary(recording)
    assert "/arm/sensors/pose0: 1 of 40 messages left out" in told
    assert "/arm/chambers/state: 2 of 40 messages" in told
    none = {**topics, "/arm/sensors/pose0": (POSE, [(ns, data[:-8]) for ns, data in poses])}
    with fails(BagError, "/arm/sensors/pose0", file=str(tmp_path / "none"), code="damaged"):
        read_bag(write_bag(tmp_path / "none", none), robot())


STAMPED = """
================================================================================
MSG: std_msgs/Header
string frame_id
builtin_interfaces/Time stamp
================================================================================
MSG: builtin_interfaces/Time
uint32 nanosec
int32 sec
"""


def redefined(folder: Path, definition: str, serialise) -> Path:
    """The bag of an arm whose pressures were recorded with another definition."""
    plain = write_bag(folder / "plain", arm_topics())
    with BagReader(plain) as reader, BagWriter(folder / "bag") as writer:
        for topic in reader.topics:
            own = topic.name == "/arm/chambers/state"
            writer.add_topic(replace(topic, definition=definition, type_hash="") if own else topic)
        for item in reader.messages():
            own = item.topic == "/arm/chambers/state"
            data = serialise(STORE.deserialize_cdr(item.data, JOINT)) if own else item.data
            writer.write(item.topic, data, item.log_time_ns)
    return folder / "bag"


@pytest.mark.parametrize("number", ["float64", "float32"])
def test_fields_in_another_order_are_read_by_the_definition_in_the_bag(tmp_path, number):
    """A narrower number too."""
    text = (
        f"{number}[] effort\nfloat64[] position\nfloat64[] velocity\nstring[] name\nstd_msgs/Header header\n"
    )
    store = Typestore()
    store.register(get_types_from_msg(text + STAMPED, JOINT))

    def serialise(state):
        at = state.header.stamp
        stamp = store.types["builtin_interfaces/msg/Time"](at.nanosec, at.sec)
        header = store.types["std_msgs/msg/Header"](state.header.frame_id, stamp)
        message = store.types[JOINT](
            state.effort.astype(number), state.position, state.velocity, state.name, header
        )
        return bytes(store.serialize_cdr(message, JOINT))

    recording = read_bag(redefined(tmp_path, text + STAMPED, serialise), robot())
    plain = read_bag(tmp_path / "plain", robot())
    expected = plain.pressure.values.astype(number).astype(float)
    np.testing.assert_array_equal(recording.pressure.values, expected)
    np.testing.assert_array_equal(recording.pressure.t, plain.pressure.t)


@pytest.mark.parametrize(
    ("definition", "words"),
    [
        ("std_msgs/Header header\nstring[] name\n" + STAMPED, "JointState.position is missing"),
        ("float64 effort\nstring[] name\n", "std_msgs/Header"),
        ("what is this", "cannot be read"),
        ("Missing part\n", "no definition of sensor_msgs/msg/Missing"),
        ("sensor_msgs/JointState again\n", "within itself"),
        ("string[4000000000] name\n", "an array of 4000000000"),
        ("float64 x\n" * 30_000, "characters; allowed"),
    ],
)
def test_a_definition_that_does_not_fit_is_refused_by_name(tmp_path, definition, words):
    bag = redefined(tmp_path, definition, lambda state: b"\0\1\0\0")
    with fails(BagError, "/arm/chambers/state", words, file=str(bag)):
        read_bag(bag, robot())


def test_a_sqlite_bag_gives_the_same(tmp_path):
    """rosbag2's storage before Iron; the folder, and the file alone."""
    plain = write_bag(tmp_path / "plain", arm_topics())
    with BagReader(plain) as reader, Writer(tmp_path / "bag", version=9) as writer:
        connections = {
            topic.name: writer.add_connection(topic.name, topic.type, typestore=STORE)
            for topic in reader.topics
        }
        for item in reader.messages():
            writer.write(connections[item.topic], item.log_time_ns, item.data)
    expected = read_bag(plain, robot())
    for path in (tmp_path / "bag", tmp_path / "bag" / "bag.db3"):
        found = read_bag(path, robot())
        np.testing.assert_array_equal(found.pressure.values, expected.pressure.values)
        np.testing.assert_array_equal(found.plates[0].table(), expected.plates[0].table())
