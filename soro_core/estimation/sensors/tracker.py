"""Poses in the frame of a tracker: what it sees of a cross-section, and the cross-section from what it saw.

With the world of the robot at (R_t, p_t) in the frame of the tracker and a body at (R_b, o_b) on the
cross-section (R, p), as `Calibration` states them:

    position = p_t + R_t (p + R o_b),   rotation = R_t R R_b.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from soro_core.arrays import Array
from soro_core.estimation.sensors.samples import PoseSample
from soro_core.robot import Calibration, Robot
from soro_core.rotation import matrix_from_quaternion, quaternion_from_matrix

# A body belongs to the samples of this part of the length of the arm around it: places are rounded in files.
_SAME_PLACE = 1e-3


@dataclass(frozen=True)
class Tracker:
    """Frame of a tracker and of the bodies that it sees.

    Attributes
    ----------
    frame : (4, 4)
        Pose of the robot's world in the frame of the tracker.
    bodies : tuple of (place, pose)
        Place along the arm [m] and pose (4, 4) on the cross-section of each body.
    same_m : float
        Largest distance [m] of a sample's place from that of its body.
    """

    frame: Array
    bodies: tuple[tuple[float, Array], ...]
    same_m: float

    @classmethod
    def of(cls, robot: Robot) -> Tracker | None:
        """Return the tracker of a robot; None where poses are those of cross-sections in the world."""
        c, length = robot.calibration, robot.length
        plain = Calibration()
        if (c.tracker_position, c.tracker_quaternion, c.bodies) == (
            plain.tracker_position,
            plain.tracker_quaternion,
            (),
        ):
            return None
        bodies = tuple((b.at * length, _pose(b.quaternion, b.offset_m)) for b in c.bodies)
        return cls(_pose(c.tracker_quaternion, c.tracker_position), bodies, _SAME_PLACE * length)

    def seen(self, section: Array, s: float) -> Array:
        """Return the pose (4, 4) that the tracker shows of the body on the cross-section (4, 4) at s [m]."""
        return np.asarray(self.frame @ section @ self.body(s))

    def section(self, sample: PoseSample) -> PoseSample:
        """Return the sample as a pose of the cross-section in the robot's world."""
        shown = np.eye(4)
        shown[:3, :3], shown[:3, 3] = matrix_from_quaternion(sample.quaternion), sample.position
        pose = _inverse(self.frame) @ shown @ _inverse(self.body(sample.s))
        return replace(sample, position=pose[:3, 3].copy(), quaternion=quaternion_from_matrix(pose[:3, :3]))

    def body(self, s: float) -> Array:
        """Return the pose (4, 4) of the body on the cross-section at s [m]; the section's own without one."""
        near = [pose for place, pose in self.bodies if abs(place - s) <= self.same_m]
        return near[0] if near else np.eye(4)


def _pose(quaternion: tuple[float, ...], position: tuple[float, ...]) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = matrix_from_quaternion(np.array(quaternion)), position
    return pose


def _inverse(pose: Array) -> Array:
    back = np.eye(4)
    back[:3, :3] = pose[:3, :3].T
    back[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return back
