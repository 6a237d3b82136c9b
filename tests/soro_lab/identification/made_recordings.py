"""A small robot, and bags and CSV files of it, for tests of recordings; CDR comes from rosbags."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from soro_core.robot import Robot, robot_from_dict
from soro_lab.bag import BagWriter, Topic

STORE = get_typestore(Stores.ROS2_JAZZY)
START_NS = 1_700_000_000_123_456_789
JOINT, POSE, IMU = "sensor_msgs/msg/JointState", "geometry_msgs/msg/PoseStamped", "sensor_msgs/msg/Imu"
LINK = {
    "length": 0.1,
    "radius": 0.02,
    "mass": 0.1,
    "k_e": [100.0, 0.0, 0.0],
    "k_b": [0.01, 0.0, 0.0],
    "damping": [0.1, 1e-4, 1e-4],
    "chambers": [{"angle_rad": 0.0, "area_m2": 1e-4, "offset_m": 0.01}],
}
CHAMBERS = ("link0/chamber0", "link1/chamber0")


def robot(links: int = 2) -> Robot:
    """Links of 100 mm with one chamber each, 0 to 100 kPa."""
    return robot_from_dict({"links": [LINK] * links, "pressure_range_pa": [0.0, 100e3]})


def header(stamp_ns: int, frame: str = "tracker") -> Any:
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    stamp = STORE.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
    return STORE.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def pressures(stamp_ns: int, names: Sequence[str], efforts: Sequence[float]) -> bytes:
    empty = np.zeros(0)
    message = STORE.types[JOINT](header(stamp_ns, ""), list(names), empty, empty, np.array(efforts, float))
    return bytes(STORE.serialize_cdr(message, JOINT))


def pose(stamp_ns: int, position: Sequence[float], quaternion: Sequence[float], frame: str = "t") -> bytes:
    point = STORE.types["geometry_msgs/msg/Point"](*map(float, position))
    turn = STORE.types["geometry_msgs/msg/Quaternion"](*map(float, quaternion))
    body = STORE.types["geometry_msgs/msg/Pose"](point, turn)
    return bytes(STORE.serialize_cdr(STORE.types[POSE](header(stamp_ns, frame), body), POSE))


def imu(stamp_ns: int, gyro: Sequence[float], accel: Sequence[float], has_orientation: bool) -> bytes:
    turn = STORE.types["geometry_msgs/msg/Quaternion"](0.0, 0.6, 0.0, 0.8)
    vector = STORE.types["geometry_msgs/msg/Vector3"]
    unknown = np.zeros(9)
    known = np.concatenate([[0.1 if has_orientation else -1.0], np.zeros(8)])
    values = turn, known, vector(*map(float, gyro)), unknown, vector(*map(float, accel)), unknown
    return bytes(STORE.serialize_cdr(STORE.types[IMU](header(stamp_ns, "imu0"), *values), IMU))


def write_bag(folder: Path, topics: Mapping[str, tuple[str, Sequence[tuple[int, bytes]]]]) -> Path:
    """Write topics: name to type and (stamp [ns], message); logged in the order of their stamps."""
    with BagWriter(folder) as writer:
        for name, (kind, _) in topics.items():
            text, _ = STORE.generate_msgdef(kind, ros_version=2)
            writer.add_topic(Topic(name, kind, text, "ros2msg", STORE.hash_rihs01(kind), ()))
        found = [(ns, name, data) for name, (_, rows) in topics.items() for ns, data in rows]
        for order, (_, name, data) in enumerate(found):
            writer.write(name, data, START_NS + order)
    return folder


def arm_topics(samples: int = 40, prefix: str = "/arm") -> dict[str, tuple[str, list[tuple[int, bytes]]]]:
    """Return rising pressures of both chambers, in the other order, and a tip that follows them."""
    rows: dict[str, tuple[str, list[tuple[int, bytes]]]] = {
        f"{prefix}/chambers/state": (JOINT, []),
        f"{prefix}/chambers/command": (JOINT, []),
        f"{prefix}/sensors/pose0": (POSE, []),
    }
    for k in range(samples):
        ns = START_NS + k * 10_000_000
        names = CHAMBERS[::-1]
        rows[f"{prefix}/chambers/state"][1].append((ns, pressures(ns, names, (2e3 + k, 1e3 + k))))
        rows[f"{prefix}/chambers/command"][1].append((ns, pressures(ns, CHAMBERS, (1e3, 2e3))))
        rows[f"{prefix}/sensors/pose0"][1].append((ns, pose(ns, (1e-3 * k, 0, 0.2), (0, 0, 0, 1), "lab")))
    return rows


def write_csv(path: Path, columns: Mapping[str, Any]) -> Path:
    """Write columns of equal length under their names, to the bit."""
    table = np.column_stack([np.asarray(values, float) for values in columns.values()])
    lines = [",".join(columns), *(",".join(map(repr, map(float, row))) for row in table)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
