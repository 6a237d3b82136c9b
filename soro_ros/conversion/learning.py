"""Messages between filter and learner: arm/covariance and arm/learned, a JointState each (ADR 0060).

The header has the stamp, `position` the numbers, and no joint has a name.
arm/covariance: 1 if the filter has positions of the arm, else 0, then P of (q, qd) row by row. Where the
force on the arm is estimated, `effort` has its stage, 1 if the load may be learned, else 0, then the force
and its covariance, and `velocity` where the tip was measured.
arm/learned: the learned model; `velocity` and `effort` have its parts `own` and `doubt`, if there are any.
Without numbers: there is none at this tick.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from soro_core.adaptation import Learned
from soro_core.adaptation.external_force import ExternalForce
from soro_core.arrays import Array
from soro_core.control.laws import Certainty
from soro_ros.conversion import messages
from soro_ros.status_words import STAGES

TOPICS = ("arm/covariance", "arm/learned")
_STAMP = 2
_FORCE = 2 + 3 + 9  # numbers of an estimated force
_MOST_TIME = 2.0**31  # seconds of a ROS time


def covariance(certainty: Certainty | None, stamp_ns: int) -> JointState:
    """Return what a filter says of its estimate as a message."""
    if certainty is None:
        return _message(stamp_ns, ())
    message = _message(stamp_ns, np.concatenate([[certainty.positions], certainty.covariance.ravel()]))
    if (force := certainty.external) is not None:
        known = [STAGES.index(force.stage), force.mass_free]
        message.effort = messages.doubles(np.concatenate([known, force.force_n, force.covariance.ravel()]))
        message.velocity = messages.doubles(() if force.tip is None else force.tip)
    return message


def certainty_of(message: JointState, n_q: int) -> Certainty | None:
    """Return a message on arm/covariance; None for none, or one of another size or out of any range."""
    values = np.array(message.position, dtype=np.float64)
    size = 2 * n_q
    # Each entry is the product of two numbers of an arm.
    if values.size != 1 + size * size or not messages.is_possible(np.sqrt(np.abs(values))):
        return None
    force, tip = (np.array(part, dtype=np.float64) for part in (message.effort, message.velocity))
    if force.size not in (0, _FORCE) or tip.size not in (0, 3):
        return None
    if not messages.is_possible(force) or not messages.is_possible(tip):
        return None
    return Certainty(values[1:].reshape(size, size), bool(values[0]), _external(force, tip))


def _external(values: Array, tip: Array) -> ExternalForce | None:
    if not values.size or values[0] not in range(len(STAGES)):
        return None
    force, covariance, stage = values[2:5], values[5:].reshape(3, 3), STAGES[int(values[0])]
    return ExternalForce(force, covariance, stage, bool(values[1]), tip if tip.size else None)


def learned(model: Learned | None, stamp_ns: int) -> JointState:
    """Return a learned model as a message."""
    if model is None:
        return _message(stamp_ns, ())
    message = _message(stamp_ns, model.theta)
    if model.own is not None:
        message.velocity = messages.doubles(model.own)
    if model.doubt is not None:
        message.effort = messages.doubles(model.doubt)
    return message


def learned_of(message: JointState) -> Learned | None:
    """Return a message on arm/learned as a model; None for none, or numbers out of any range.

    The filter checks the sizes.
    """
    values, own, doubt = (
        np.array(part, dtype=np.float64) for part in (message.position, message.velocity, message.effort)
    )
    size = math.isqrt(doubt.size)
    is_whole = values.size and own.size in (0, values.size) and size * size == doubt.size
    if not is_whole or not all(map(messages.is_possible, (values, own, doubt))):
        return None
    return Learned(values, own if own.size else None, doubt.reshape(size, size) if size else None)


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
