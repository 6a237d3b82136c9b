"""Messages between filter and learner: arm/covariance and arm/learned, a JointState each (ADR 0060).

The header has the stamp, `position` the numbers, and no joint has a name.
arm/covariance: 1 if the filter has positions of the arm, else 0, then P of (q, qd) row by row.
arm/learned: the learned model. Without numbers: there is none at this tick.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from soro_core.adaptation import Learned
from soro_core.control.laws import Certainty
from soro_ros.conversion import messages

TOPICS = ("arm/covariance", "arm/learned")
_STAMP = 2
_MOST_TIME = 2.0**31  # seconds of a ROS time


def covariance(certainty: Certainty | None, stamp_ns: int) -> JointState:
    """Return what a filter says of its estimate as a message."""
    if certainty is None:
        return _message(stamp_ns, ())
    return _message(stamp_ns, np.concatenate([[certainty.positions], certainty.covariance.ravel()]))


def certainty_of(message: JointState, n_q: int) -> Certainty | None:
    """Return a message on arm/covariance as P; None for none, or one of another size or out of any range."""
    values = np.array(message.position, dtype=np.float64)
    size = 2 * n_q
    # Each entry is the product of two numbers of an arm.
    if values.size != 1 + size * size or not messages.is_possible(np.sqrt(np.abs(values))):
        return None
    return Certainty(values[1:].reshape(size, size), bool(values[0]))


def learned(model: Learned | None, stamp_ns: int) -> JointState:
    """Return a learned model as a message."""
    return _message(stamp_ns, () if model is None else model.theta)


def learned_of(message: JointState) -> Learned | None:
    """Return a message on arm/learned as a model; None for none, or numbers out of any range.

    The filter checks the size.
    """
    values = np.array(message.position, dtype=np.float64)
    return Learned(values) if values.size and messages.is_possible(values) else None


def from_array(message: Float64MultiArray) -> JointState:
    """Return a message of a bag of version 0.2 or before, whose first two numbers are the stamp [s, ns].

    Raises
    ------
    ValueError
        If these are no time.
    """
    stamp = list(message.data[:_STAMP])
    if len(stamp) < _STAMP or not all(abs(part) < _MOST_TIME for part in stamp):
        raise ValueError("its first two numbers are no time")
    return _message(int(stamp[0]) * 1_000_000_000 + int(stamp[1]), message.data[_STAMP:])


def _message(stamp_ns: int, values: ArrayLike) -> JointState:
    message = JointState(position=messages.doubles(values))
    message.header.stamp = messages.to_time(stamp_ns)
    return message
