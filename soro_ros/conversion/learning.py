"""Messages between filter and learner: arm/covariance and arm/learned.

std_msgs/Float64MultiArray has no header: the first two numbers are the stamp, seconds and nanoseconds.
arm/covariance: then 1 if the filter has positions of the arm, else 0, and P of (q, qd) row by row.
arm/learned: then the learned model. Only the stamp: there is none at this tick.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

from soro_core.adaptation import Learned
from soro_core.control.laws import Certainty
from soro_ros.conversion import messages

_STAMP = 2
_MOST_TIME = 2.0**32  # of seconds and nanoseconds of a ROS time


def covariance(certainty: Certainty | None, stamp_ns: int) -> Float64MultiArray:
    """Return what a filter says of its estimate as a message."""
    if certainty is None:
        return _message(stamp_ns)
    return _message(stamp_ns, [certainty.positions], certainty.covariance.ravel())


def certainty_of(message: Float64MultiArray, n_q: int) -> Certainty | None:
    """Return a message on arm/covariance as P; None for none, or one of another size or out of any range."""
    values = np.array(message.data[_STAMP:], dtype=np.float64)
    size = 2 * n_q
    # Each entry is the product of two numbers of an arm.
    if values.size != 1 + size * size or not messages.is_possible(np.sqrt(np.abs(values))):
        return None
    return Certainty(values[1:].reshape(size, size), bool(values[0]))


def learned(model: Learned | None, stamp_ns: int) -> Float64MultiArray:
    """Return a learned model as a message."""
    return _message(stamp_ns) if model is None else _message(stamp_ns, model.theta)


def learned_of(message: Float64MultiArray) -> Learned | None:
    """Return a message on arm/learned as a model; None for none, or numbers out of any range.

    The filter checks the size.
    """
    values = np.array(message.data[_STAMP:], dtype=np.float64)
    return Learned(values) if values.size and messages.is_possible(values) else None


def stamp_ns(message: Float64MultiArray) -> int:
    """Return the stamp of either message [ns], -1 where it has none that a ROS time could be."""
    stamp = list(message.data[:_STAMP])
    if len(stamp) < _STAMP or not all(abs(part) < _MOST_TIME for part in stamp):
        return -1
    return int(stamp[0]) * 1_000_000_000 + int(stamp[1])


def _message(stamp_ns: int, *values: ArrayLike) -> Float64MultiArray:
    data = messages.doubles(np.concatenate([divmod(stamp_ns, 1_000_000_000), *values]))
    return Float64MultiArray(layout=_layout(len(data) - _STAMP), data=data)


@lru_cache
def _layout(size: int) -> MultiArrayLayout:
    """Return the layout of a message of so many values."""
    sizes = (("stamp", _STAMP), ("values", size))
    return MultiArrayLayout(
        dim=[MultiArrayDimension(label=label, size=size, stride=size) for label, size in sizes]
    )
