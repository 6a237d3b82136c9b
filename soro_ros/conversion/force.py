"""The force on the arm at its tip, as messages: arm/wrench, and arm/wrench/covariance beside it."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import WrenchStamped
from numpy.typing import ArrayLike
from sensor_msgs.msg import JointState

from soro_core.adaptation.external_force import ExternalForce
from soro_core.arrays import Array
from soro_ros.conversion import messages
from soro_ros.status_words import STAGES

_ENTRIES = ("xx", "xy", "xz", "yy", "yz", "zz")
_PLACES = np.triu_indices(3)


def wrench(
    force_n: ArrayLike, stamp_ns: int, frame: str, torque_nm: ArrayLike = (0.0, 0.0, 0.0)
) -> WrenchStamped:
    """Return a force (3,) [N] as a WrenchStamped, without torque unless it is given.

    Parameters
    ----------
    force_n : array_like (3,)
        Force [N].
    stamp_ns : int
        Time of the message [ns].
    frame : str
        Name of the frame of its axes.
    torque_nm : array_like (3,)
        Torque [N m].
    """
    message = WrenchStamped()
    message.header.stamp, message.header.frame_id = messages.to_time(stamp_ns), frame
    f = message.wrench.force
    f.x, f.y, f.z = (float(value) for value in np.asarray(force_n))
    t = message.wrench.torque
    t.x, t.y, t.z = (float(value) for value in np.asarray(torque_nm))
    return message


def force_of(message: WrenchStamped) -> Array:
    """Force (3,) [N] of a WrenchStamped."""
    f = message.wrench.force
    return np.array([f.x, f.y, f.z])


def torque_of(message: WrenchStamped) -> Array:
    """Torque (3,) [N m] of a WrenchStamped."""
    t = message.wrench.torque
    return np.array([t.x, t.y, t.z])


def covariance(external: ExternalForce, stamp_ns: int) -> JointState:
    """Return stage (its number in `STAGES`) and covariance [N^2] of an estimated force, by name."""
    values = [STAGES.index(external.stage), *external.covariance[_PLACES]]
    message = JointState(name=["stage", *_ENTRIES], position=messages.doubles(values))
    message.header.stamp = messages.to_time(stamp_ns)
    return message


def stage_of(message: JointState) -> str:
    """Return the stage of contact that stands on arm/wrench/covariance; empty where it has none."""
    known = dict(zip(message.name, message.position, strict=False)).get("stage", -1.0)
    return STAGES[int(known)] if known in range(len(STAGES)) else ""
