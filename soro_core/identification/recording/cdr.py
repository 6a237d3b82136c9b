"""The messages of a recording from their bytes (CDR), without ROS: a lab reads its bag on any machine."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.errors import BagError

Array: TypeAlias = NDArray[np.float64]

JOINT_STATE = "sensor_msgs/msg/JointState"
POSE = "geometry_msgs/msg/PoseStamped"
IMU = "sensor_msgs/msg/Imu"


@dataclass(frozen=True)
class Efforts:
    """Stamp [ns], names and efforts of a JointState."""

    stamp_ns: int
    frame: str
    names: tuple[str, ...]
    efforts: Array


@dataclass(frozen=True)
class Values:
    """Stamp [ns], frame and numbers of a message.

    Of a pose: position (3) and quaternion (4) x, y, z, w. Of an IMU: orientation (4), the first number of its
    covariance (-1: there is no orientation), angular velocity (3), specific force (3).
    """

    stamp_ns: int
    frame: str
    values: Array


def joint_state(data: bytes) -> Efforts:
    """Read a sensor_msgs/JointState.

    Raises
    ------
    BagError
        If the bytes end too early, as for all functions here.
    """
    cursor = _Cursor(data)
    stamp_ns, frame = cursor.header()
    names = tuple(cursor.text() for _ in range(cursor.count()))
    for _ in range(2):  # position, velocity
        cursor.doubles(cursor.count())
    return Efforts(stamp_ns, frame, names, cursor.doubles(cursor.count()))


def pose_stamped(data: bytes) -> Values:
    """Read a geometry_msgs/PoseStamped: position and quaternion."""
    cursor = _Cursor(data)
    return Values(*cursor.header(), cursor.doubles(7))


def imu(data: bytes) -> Values:
    """Read a sensor_msgs/Imu: orientation, first of its covariance, angular velocity, specific force."""
    cursor = _Cursor(data)
    stamp_ns, frame = cursor.header()
    numbers = cursor.doubles(4 + 9 + 3 + 9 + 3)
    return Values(stamp_ns, frame, np.concatenate([numbers[:5], numbers[13:16], numbers[25:28]]))


class _Cursor:
    """A place in a serialised message; each number is aligned to its size after the four bytes in front."""

    def __init__(self, data: bytes) -> None:
        if len(data) < 4 or data[0] != 0 or data[1] not in (0, 1):
            raise BagError(f"bytes {data[:4].hex(' ')}; allowed is plain CDR", code="damaged", place="byte 0")
        self._order = "<" if data[1] else ">"
        self._data, self._at = memoryview(data)[4:], 0

    def header(self) -> tuple[int, str]:
        """Return stamp [ns] and frame of a std_msgs/Header."""
        seconds, nanoseconds = struct.unpack(f"{self._order}iI", self._take(4, 8))
        return seconds * 10**9 + nanoseconds, self.text()

    def text(self) -> str:
        """Return a text; its length counts the zero at its end."""
        return bytes(self._take(1, self.count())).rstrip(b"\0").decode("utf-8", "replace")

    def count(self) -> int:
        """Return the length of a sequence."""
        return int(struct.unpack(f"{self._order}I", self._take(4, 4))[0])

    def doubles(self, number: int) -> Array:
        """Return numbers (number,)."""
        # No padding stands before a sequence without elements.
        taken = self._take(8, 8 * number) if number else b""
        return np.frombuffer(taken, f"{self._order}f8").astype(np.float64)

    def _take(self, size: int, length: int) -> memoryview:
        begin = -(-self._at // size) * size
        if begin + length > len(self._data):
            raise BagError("the message ends early", code="damaged", place=f"byte {begin}")
        self._at = begin + length
        return self._data[begin : self._at]
