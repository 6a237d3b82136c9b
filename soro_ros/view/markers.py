"""The arm as markers: skin coloured by pressure, frames, trails, force at the tip, cause of a latch.

Points, colours and stamps are exchanged as arrays in the serialised MarkerArray:
rclpy converts each Point by itself: the 5700 of the shipped arm take 15 ms, 30 % of a core at 20 Hz; as
bytes they take 0.7 ms.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import (
    Point,
    Pose,
    PoseArray,
    PoseStamped,
    PoseWithCovarianceStamped,
    Quaternion,
    Vector3,
    WrenchStamped,
)
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from soro_core.arrays import Array
from soro_core.robot import Robot
from soro_core.robot.basis import radius_profile
from soro_lab.scene import MarkersConfig
from soro_ros.conversion import messages, qos
from soro_ros.conversion.force import force_of
from soro_ros.topics.ports import Input, Inputs
from soro_ros.view.arm_shape import arrow_of, between
from soro_ros.view.skin import Skin


class MarkerBytes:
    """Serialises markers once, and then only writes what changes into the bytes.

    Parameters
    ----------
    markers : sequence of Marker
        Everything that stays; their points, colours and stamps are replaced.
    points : sequence of int
        Number of points of each marker.
    """

    def __init__(self, markers: Sequence[Marker], points: Sequence[int]) -> None:
        for k, (marker, n) in enumerate(zip(markers, points, strict=True)):
            marker.header.stamp = Time(sec=_MARK + k, nanosec=k)
            marker.color = ColorRGBA(r=_MARK + k + 0.0, g=1.0, b=2.0, a=3.0)
            marker.points = [Point(x=_MARK + k + 0.5, y=1.0, z=2.0)] * n
        self._bytes = bytearray(serialize_message(MarkerArray(markers=list(markers))))
        self._places = [
            (self._find(_stamp(_MARK + k, k)), self._find(_colour((_MARK + k, 1.0, 2.0, 3.0))), n)
            for k, n in enumerate(points)
        ]
        self._points = [
            self._find(np.tile([_MARK + k + 0.5, 1.0, 2.0], n).tobytes()) if n else 0
            for k, n in enumerate(points)
        ]

    def of(self, stamp: Time, colours: Sequence[Sequence[float]], points: Sequence[Array]) -> bytes:
        """Return the serialised MarkerArray.

        Parameters
        ----------
        stamp : Time
            Of all markers.
        colours : sequence of sequence of float
            Red, green, blue and opacity of each marker, from 0 to 1.
        points : sequence of ndarray (n, 3)
            Points [m] of each marker.
        """
        for (at, colour_at, n), point_at, colour, xyz in zip(
            self._places, self._points, colours, points, strict=True
        ):
            self._bytes[at : at + 8] = _stamp(stamp.sec, stamp.nanosec)
            self._bytes[colour_at : colour_at + 16] = _colour(colour)
            self._bytes[point_at : point_at + 24 * n] = np.asarray(xyz, dtype="<f8").reshape(n, 3).tobytes()
        return bytes(self._bytes)

    def _find(self, part: bytes) -> int:
        at = self._bytes.find(part)
        if at < 0 or self._bytes.find(part, at + 1) >= 0:
            raise RuntimeError("markers are not serialised as this file expects")
        return at


# No number of a marker has this value.
_MARK = 1_234_500


def _stamp(sec: int, nanosec: int) -> bytes:
    return struct.pack("<iI", sec, nanosec)


def _colour(rgba: Sequence[float]) -> bytes:
    return struct.pack("<4f", *rgba)


TOPIC = "arm/markers"
# Points of a trail; a marker has as many from its first message on.
_TRAIL = 120
# A force that is older than the shape of the arm by more is not drawn [ns].
_STALE_NS = 1_000_000_000
_RED, _GREY, _AMBER = (0.757, 0.071, 0.122, 1.0), (0.55, 0.58, 0.62, 1.0), (0.80, 0.33, 0.0, 1.0)
_WHITE, _NONE = (1.0, 1.0, 1.0, 1.0), np.zeros((0, 3))
_AXES = ((0.85, 0.15, 0.15), (0.15, 0.65, 0.2), (0.15, 0.35, 0.85))


class MarkerPart(NamedTuple):
    """A marker before it is one: name, number and type, its size [m], colour, points and text."""

    name: str
    number: int
    kind: int
    size: float
    colour: tuple[float, ...]
    points: Array
    text: str = ""
    above: float = 0.0

    def marker(self, frame: str) -> Marker:
        """The marker, without what `MarkerBytes` writes into it."""
        marker = Marker(ns=self.name, id=self.number, type=self.kind, action=Marker.ADD, text=self.text)
        marker.header.frame_id = frame
        marker.pose = Pose(position=Point(z=self.above), orientation=Quaternion(w=1.0))
        head = 2.0 * self.size if self.kind == Marker.ARROW else self.size
        marker.scale = Vector3(x=self.size, y=head, z=head)
        if self.name == "frames":
            ends = [ColorRGBA(r=r, g=g, b=b, a=1.0) for r, g, b in _AXES for _ in range(2)]
            marker.colors = ends * (len(self.points) // len(ends))
        return marker


class Trail:
    """The last positions of a point, about as many as a marker has; older ones fade out at its end."""

    def __init__(self, seconds: float) -> None:
        self._ns = round(seconds * 1e9)
        self._past: deque[tuple[int, Array]] = deque()

    def add(self, stamp_ns: int, position: Array) -> None:
        """Take a position [m]; time that goes back, as in a bag that begins again, clears the trail."""
        if self._past and stamp_ns < self._past[-1][0]:
            self._past.clear()
        if len(self._past) > 1 and stamp_ns - self._past[-2][0] < self._ns // _TRAIL:
            self._past.pop()  # the newest one is always there
        self._past.append((stamp_ns, position))
        while self._past[0][0] < stamp_ns - self._ns:
            self._past.popleft()

    def points(self) -> Array:
        """Positions (_TRAIL, 3) [m], the last one as often as necessary; (0, 3) if there is none."""
        known = [position for _, position in self._past][-_TRAIL:]
        return np.array(known + known[-1:] * (_TRAIL - len(known))).reshape(-1, 3)


class ArmMarkers:
    """Keeps the newest messages of an arm and draws them.

    Parameters
    ----------
    robot : Robot
    config : MarkersConfig

    Attributes
    ----------
    inputs : mapping of str to Input
        What it takes, by the name of the topic.
    """

    def __init__(self, robot: Robot, config: MarkersConfig) -> None:
        self._skin = Skin(robot, config.around, config.per_fold)
        self._full_pa = config.full_pa or max(np.abs(robot.pressure_range_pa))
        at_ends = [radius_profile(link, np.ones(1)) for link in robot.links]
        self._radii = np.concatenate([radius_profile(robot.links[0], np.zeros(1)), *at_ends])
        self._length, self._radius = robot.length, float(self._radii[0])
        ends = np.cumsum([0.0, *(link.length for link in robot.links)])
        self._ends = ends / ends[-1]
        self._backbone: PoseArray | None = None
        self._tip, self._reference = Trail(config.trail_s), Trail(config.trail_s)
        self._wanted = np.zeros((0, 4, 4))
        self._pressure: dict[str, float] = {}
        self._force, self._force_ns = np.zeros(3), 0
        self._vented = ""
        self._written: tuple[object, MarkerBytes] | None = None
        self.inputs: Inputs = {
            "arm/backbone": Input(PoseArray, self._on_backbone, qos.sensor),
            "arm/tip": Input(PoseWithCovarianceStamped, self._on_tip, qos.sensor),
            "arm/desired/tip": Input(PoseStamped, self._on_reference, qos.sensor),
            "arm/wrench": Input(WrenchStamped, self._on_wrench, qos.sensor),
            "chambers/state": Input(JointState, self._on_pressures, qos.sensor),
            "chambers/latch": Input(DiagnosticStatus, self._on_latch, lambda lockstep: qos.LATCHED),
        }

    def take(self) -> bytes | None:
        """Return a serialised MarkerArray; None if no arm/backbone has come since the last one."""
        backbone, self._backbone = self._backbone, None
        if backbone is None:
            return None
        poses = messages.transforms(backbone)
        if messages.to_ns(backbone.header.stamp) - self._force_ns > _STALE_NS:
            self._force = np.zeros(3)
        parts = [*self._meshes(poses), *self._others(poses)]
        sizes = [len(part.points) for part in parts]
        stays = (backbone.header.frame_id, self._vented, sizes)
        if self._written is None or self._written[0] != stays:
            markers = [part.marker(backbone.header.frame_id) for part in parts]
            self._written = (stays, MarkerBytes(markers, sizes))
        colours, points = [part.colour for part in parts], [part.points for part in parts]
        return self._written[1].of(backbone.header.stamp, colours, points)

    def _meshes(self, poses: Array) -> Iterator[MarkerPart]:
        shares = {name: value / self._full_pa for name, value in self._pressure.items()}
        colours, vertices = self._skin.colours(shares), self._skin.vertices(poses)
        for k, faces in enumerate(self._skin.triangles):
            yield MarkerPart(
                "skin", k, Marker.TRIANGLE_LIST, 1.0, (*colours[k], 1.0), vertices[k][faces.ravel()]
            )

    def _others(self, poses: Array) -> Iterator[MarkerPart]:
        thin = 0.06 * self._radius
        at = between(np.linspace(0.0, 1.0, len(poses)), poses, self._ends)
        yield MarkerPart("frames", 0, Marker.LINE_LIST, thin, _WHITE, _axes_of(at, 2.0 * self._radii))
        if len(self._wanted):
            axes = _axes_of(self._wanted, 1.2 * self._radii[-1:])
            yield MarkerPart("frames", 1, Marker.LINE_LIST, thin, _WHITE, axes)
        for name, trail, colour in (("tip", self._tip, _RED), ("reference", self._reference, _GREY)):
            if len(points := trail.points()):
                yield MarkerPart(name, 0, Marker.LINE_STRIP, 2 * thin, colour, points)
        if self._force.any():
            arrow = arrow_of(self._force, poses[-1, :3, 3], self._length)
            yield MarkerPart("force", 0, Marker.ARROW, 2 * thin, _AMBER, arrow)
        if self._vented:
            above = 1.15 * self._length
            yield MarkerPart(
                "latch", 0, Marker.TEXT_VIEW_FACING, 0.6 * self._radius, _AMBER, _NONE, self._vented, above
            )

    def _on_backbone(self, message: PoseArray) -> None:
        if len(message.poses) > 1 and all(messages.is_pose(pose) for pose in message.poses):
            self._backbone = message

    def _on_tip(self, message: PoseWithCovarianceStamped) -> None:
        if messages.is_pose(message.pose.pose):
            position, _ = messages.pose_arrays(message.pose.pose)
            self._tip.add(messages.to_ns(message.header.stamp), position)

    def _on_reference(self, message: PoseStamped) -> None:
        if messages.is_pose(message.pose):
            self._wanted = messages.transform(message.pose)[None]
            self._reference.add(messages.to_ns(message.header.stamp), self._wanted[0, :3, 3])

    def _on_wrench(self, message: WrenchStamped) -> None:
        if messages.is_possible(force := force_of(message)):
            self._force, self._force_ns = force, messages.to_ns(message.header.stamp)

    def _on_pressures(self, message: JointState) -> None:
        self._pressure = messages.efforts(message) or self._pressure

    def _on_latch(self, message: DiagnosticStatus) -> None:
        self._vented = "" if message.level == DiagnosticStatus.OK else message.message


def _axes_of(poses: Array, length: Array) -> Array:
    """Ends (6 n, 3) [m] of the axes of frames (n, 4, 4), of a length (n,) or (1,) [m]."""
    begin = np.repeat(poses[:, None, :3, 3], 3, axis=1)
    end = begin + length[:, None, None] * poses[:, :3, :3].transpose(0, 2, 1)
    return np.asarray(np.stack([begin, end], axis=2).reshape(-1, 3))
