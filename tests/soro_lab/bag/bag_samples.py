"""Bags with made-up messages for the tests; CDR comes from rosbags, so no ROS is needed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from soro_lab.bag import BagMessage, BagReader, BagWriter, Qos, Topic

STORE = get_typestore(Stores.ROS2_JAZZY)
LATCHED = Qos(history="keep_last", depth=1, reliability="reliable", durability="transient_local")
SENSOR = Qos(history="unknown", depth=0, reliability="best_effort", durability="volatile")
START_NS = 1_700_000_000_123_456_789


def topic(name: str, type_name: str, *qos: Qos) -> Topic:
    text, _ = STORE.generate_msgdef(type_name, ros_version=2)
    return Topic(name, type_name, text, "ros2msg", STORE.hash_rihs01(type_name), qos)


TOPICS = (
    topic("/chambers/state", "sensor_msgs/msg/JointState", Qos()),
    topic("/sensors/pose0", "geometry_msgs/msg/PoseStamped", SENSOR),
    topic("/notes", "std_msgs/msg/String", LATCHED, SENSOR),
    topic("/never", "std_msgs/msg/Float64MultiArray"),
)


def joint_state(stamp_ns: int, names: list[str], efforts: np.ndarray) -> Any:
    types = STORE.types
    stamp = types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="base")
    empty = np.zeros(0)
    return types["sensor_msgs/msg/JointState"](header, names, empty, empty, efforts)


def cdr(message: Any, type_name: str) -> bytes:
    return bytes(STORE.serialize_cdr(message, type_name))


def random_messages(seed: int, count: int) -> list[BagMessage]:
    """Messages of the first three topics with random bytes, sizes and steps of time, some times equal."""
    rng = np.random.default_rng(seed)
    now = START_NS
    result = []
    counts = dict.fromkeys((item.name for item in TOPICS), 0)
    for _ in range(count):
        now += int(rng.integers(0, 3)) * 5_000_000
        which = TOPICS[int(rng.integers(3))]
        counts[which.name] += 1
        data = b"\x00\x01\x00\x00" + rng.bytes(int(rng.integers(0, 400)))
        result.append(BagMessage(which.name, which.type, data, now, now - 1000, counts[which.name]))
    return result


def write_bag(folder: Path, messages: list[BagMessage], **options: Any) -> Path:
    with BagWriter(folder, **options) as writer:
        for item in TOPICS:
            writer.add_topic(item)
        for message in messages:
            writer.write(
                message.topic, message.data, message.log_time_ns, message.publish_time_ns, message.sequence
            )
    return folder


def read_all(path: Path, **options: Any) -> list[BagMessage]:
    with BagReader(path, **options) as reader:
        return list(reader.messages())
