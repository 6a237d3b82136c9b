"""Frames on an arm: at ends of links, at the tip, at sensors and at named places; and their URDF."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import accumulate
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from soro_core.arrays import Array
from soro_core.estimation.sensors.tracker import Tracker
from soro_core.robot import Robot
from soro_core.robot.basis import radius_profile
from soro_core.rotation import matrix_from_quaternion
from soro_core.run_keys import Frames

# Thickness of the disc that shows a cross-section [m].
_DISC_M = 1e-3


class ArmFrame(NamedTuple):
    """A frame that moves with a cross-section.

    Attributes
    ----------
    name : str
    at_m : float
        The cross-section, in metres from the base along the undeformed arm.
    on_section : ndarray (4, 4)
        Its pose on the cross-section [m].
    radius_m : float
        Radius of the disc that shows it [m]; 0 for none.
    """

    name: str
    at_m: float
    on_section: Array
    radius_m: float = 0.0


def frames_of(
    robot: Robot, frames: Frames, pose_locations: Sequence[float], imu_locations: Sequence[float]
) -> tuple[ArmFrame, ...]:
    """Return the frames on an arm.

    Parameters
    ----------
    robot : Robot
    frames : Frames
        Their names, with that of the base stated.
    pose_locations, imu_locations : sequence of float
        Places of the sensors, in parts of the length of the arm.
    """
    whole, length, tracker = np.eye(4), robot.length, Tracker.of(robot)
    step = robot.refinement
    ends = list(accumulate(link.length for link in robot.links))[step - 1 :: step]
    radii = [radius_profile(link, np.ones(1))[0] for link in robot.links[step - 1 :: step]]
    found = [
        ArmFrame(frames.beside(f"link{k}/end"), end, whole, radius)
        for k, (end, radius) in enumerate(zip(ends, radii, strict=True))
    ]
    found.append(ArmFrame(frames.tip, length, whole))
    for k, at in enumerate(pose_locations):
        body = whole if tracker is None else tracker.body(at * length)
        found.append(ArmFrame(frames.beside(f"pose{k}"), at * length, body))
    found += [ArmFrame(frames.imu_name(k), at * length, whole) for k, at in enumerate(imu_locations)]
    for name, place in robot.places.items():
        pose = np.eye(4)
        pose[:3, :3] = matrix_from_quaternion(np.array(place.quaternion, dtype=np.float64))
        pose[:3, 3] = place.offset_m
        found.append(ArmFrame(frames.beside(name), place.at * length, pose))
    # What is stated may name a frame twice.
    named = {frame.name: frame for frame in reversed(found) if frame.name not in (frames.base, frames.world)}
    return tuple(reversed(named.values()))


def urdf(robot: Robot, base: str, frames: Sequence[ArmFrame], at_base: Callable[[ArmFrame], Array]) -> str:
    """Return the description of an arm: each frame is a link, on a floating joint of the base.

    Parameters
    ----------
    robot : Robot
    base : str
        Name of the base, the root.
    frames : sequence of ArmFrame
    at_base : callable
        Gives the pose (4, 4) of a frame at the base, of the arm at rest [m].
    """
    root = ElementTree.Element("robot", name=robot.name)
    _link(root, base, radius_profile(robot.links[0], np.zeros(1))[0])
    for frame in frames:
        _link(root, frame.name, frame.radius_m)
        # No joint state moves it, so that robot_state_publisher leaves it to whom publishes /tf.
        joint = ElementTree.SubElement(root, "joint", name=f"{frame.name}_joint", type="floating")
        pose = at_base(frame)
        origin = {
            "xyz": _numbers(pose[:3, 3]),
            "rpy": _numbers(Rotation.from_matrix(pose[:3, :3]).as_euler("xyz")),
        }
        ElementTree.SubElement(joint, "origin", origin)
        ElementTree.SubElement(joint, "parent", link=base)
        ElementTree.SubElement(joint, "child", link=frame.name)
    ElementTree.indent(root)
    # Some parsers refuse a text that states an encoding.
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode")


def _link(root: ElementTree.Element, name: str, radius_m: float) -> None:
    link = ElementTree.SubElement(root, "link", name=name)
    if radius_m > 0.0:
        geometry = ElementTree.SubElement(ElementTree.SubElement(link, "visual"), "geometry")
        ElementTree.SubElement(geometry, "cylinder", radius=f"{radius_m:.6g}", length=f"{_DISC_M:g}")


def _numbers(values: Array) -> str:
    return " ".join(f"{value:.12g}" for value in values)
