"""What one sensor, or one set of sensors with common stamps, has recorded."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from soro_core.arrays import Array, Flags
from soro_lab.identification.recording.place import Place

Kind = TypeVar("Kind", bound="Stream")


@dataclass(frozen=True)
class Stream:
    """Samples with their own stamps.

    Attributes
    ----------
    name : str
        Name, unlike that of any other stream of the recording.
    t : array of shape (n,)
        Stamps [s], rising.
    """

    name: str
    t: Array

    def rows(self: Kind, keep: Flags | NDArray[np.intp]) -> Kind:
        """Return the stream of some of its samples, (n,) of bool or their numbers."""
        return replace(self, **{key: value[keep] for key, value in self._arrays().items()})

    def window(self: Kind, start: float, end: float) -> Kind:
        """Return the samples with start <= t < end [s]; stamps stay as they are."""
        return self.rows((self.t >= start) & (self.t < end))

    def shifted(self: Kind, seconds: float) -> Kind:
        """Return the stream as a clock shows it that is ahead by so many seconds: stamps grow by them."""
        return replace(self, t=self.t + seconds)

    def table(self) -> Array:
        """Return all values as columns (n, m), in the units of the stream."""
        parts = [value.reshape(len(self.t), -1) for key, value in self._arrays().items() if key != "t"]
        return np.concatenate(parts, axis=1)

    def motion(self) -> Array:
        """Return the columns (n, m) in which motion is judged; by default all."""
        return self.table()

    def _arrays(self) -> dict[str, Any]:
        """Return the fields with one row a sample; a place or an offset has none."""
        named = {field.name: getattr(self, field.name) for field in fields(self)}
        return {key: value for key, value in named.items() if isinstance(value, np.ndarray)}


@dataclass(frozen=True)
class Series(Stream):
    """Numbers over time.

    Attributes
    ----------
    values : array of shape (n, m)
        Pressures or set points [Pa gauge] in the order of the robot's chambers.
    """

    values: Array

    def at(self, t: Array) -> Array:
        """Return the values (len(t), m) at times t [s], linear between samples, constant before and after."""
        return np.column_stack([np.interp(t, self.t, column) for column in self.values.T])


@dataclass(frozen=True)
class Plate(Stream):
    """Poses of a body that is fixed to a cross-section.

    Attributes
    ----------
    place : Place
        The cross-section.
    position : array of shape (n, 3)
        [m].
    quaternion : array of shape (n, 4)
        x, y, z, w, of length 1.
    frame : str
        What positions and quaternions refer to.
    """

    place: Place
    position: Array
    quaternion: Array
    frame: str = "tracker"

    def motion(self) -> Array:
        """Return the positions [m]."""
        return self.position


@dataclass(frozen=True)
class Marker(Stream):
    """Positions of a point that is fixed to a cross-section.

    Attributes
    ----------
    place : Place
        The cross-section.
    position : array of shape (n, 3)
        [m].
    offset : tuple of 3 float or None
        Place of the point in the frame of the cross-section [m]; None where it is not known.
    frame : str
        What positions refer to.
    """

    place: Place
    position: Array
    offset: tuple[float, ...] | None = None
    frame: str = "tracker"


@dataclass(frozen=True)
class Curvature(Stream):
    """Mean curvatures of a link.

    Attributes
    ----------
    link : int
        Number of the link.
    curvature : array of shape (n, 2)
        kx, ky [1/m] in the frame of the measurement.
    """

    link: int
    curvature: Array


@dataclass(frozen=True)
class Bend(Stream):
    """Bending angle of a link in one plane.

    Attributes
    ----------
    link : int
        Number of the link.
    angle : array of shape (n,)
        kappa L (1 + eps) [rad].
    towards : float
        Direction in the section, from x [rad], towards which the link bends at an angle above 0.
    """

    link: int
    angle: Array
    towards: float = 0.5 * math.pi


@dataclass(frozen=True)
class Imu(Stream):
    """Samples of an inertial measurement unit, in its own frame.

    Attributes
    ----------
    place : Place
        The cross-section that it is fixed to.
    gyro : array of shape (n, 3)
        Angular velocity [rad/s].
    accel : array of shape (n, 3)
        Specific force [m/s^2].
    orientation : array of shape (n, 4) or None
        Quaternion x, y, z, w; None of an IMU that gives none.
    """

    place: Place
    gyro: Array
    accel: Array
    orientation: Array | None = None

    def motion(self) -> Array:
        """Return the angular velocities [rad/s]."""
        return self.gyro

    def attitude(self) -> Attitude | None:
        """Return the rotations that it states, without zeros; None of an IMU that gives none."""
        if self.orientation is None:
            return None
        length = np.linalg.norm(self.orientation, axis=1)
        known = length > 0.5
        unit = self.orientation[known] / length[known, None]
        return Attitude(self.name, self.t[known], self.place, unit) if known.any() else None


@dataclass(frozen=True)
class Attitude(Stream):
    """Rotations of a body that is fixed to a cross-section, in a frame of its own: what an IMU states.

    Attributes
    ----------
    place : Place
        The cross-section.
    quaternion : array of shape (n, 4)
        x, y, z, w, of length 1.
    """

    place: Place
    quaternion: Array

    def motion(self) -> Array:
        """Return two axes of the body (n, 6): a turn of 1 rad moves them by about 1, whatever its sign."""
        axes = Rotation.from_quat(self.quaternion).as_matrix()[:, :, [0, 2]]
        return np.asarray(axes.reshape(-1, 6))


Shape: TypeAlias = Plate | Marker | Curvature | Bend | Attitude
