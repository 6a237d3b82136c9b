"""What belongs to one tick of the controller: a state, the pressures and the covariance of the same time."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from soro_core.arrays import Array
from soro_core.control.laws import Certainty
from soro_ros.conversion import messages

# Messages of a topic that wait for those of another one: a recorder on a busy machine notes one far behind.
_WAITING = 1000
_Value = TypeVar("_Value")
# An angle beyond this is none [rad].
_MOST_RAD = 100.0


class TickInput(NamedTuple):
    """Messages of one tick.

    Attributes
    ----------
    state : JointState
    stamp_ns : int
        Time of the state [ns].
    pressure_pa : ndarray (n_u,)
        Measured pressures [Pa gauge]; NaN while none has arrived.
    certainty : Certainty or None
    joint : (stamp_ns, angle) or None
        Newest angle of the measured joint [rad] and its time [ns], None before the first.
    asked : tuple of JointTrajectory
        What a hand asks for up to this time, in lockstep.
    """

    state: JointState
    stamp_ns: int
    pressure_pa: Array
    certainty: Certainty | None
    joint: tuple[int, float] | None
    asked: tuple[JointTrajectory, ...]


class TickInputs:
    """Received messages that wait for their tick.

    In lockstep a tick takes the messages of its own time and waits for them; in real time the latest ones.

    Parameters
    ----------
    lockstep : bool
    n_u : int
        Number of chambers.
    with_covariance : bool
        Whether a tick in lockstep waits for its covariance.
    covariance_age_s : float
        Age [s] above which a covariance in real time is none.
    with_hand : bool
        Whether a tick in lockstep waits until a hand has said what it asks for then.
    with_joint : bool
        Whether a tick in lockstep waits for the angle of the measured joint.
    """

    def __init__(
        self,
        lockstep: bool,
        n_u: int,
        with_covariance: bool,
        covariance_age_s: float,
        with_hand: bool = False,
        with_joint: bool = False,
    ) -> None:
        self._lockstep, self._n_u = lockstep, n_u
        self._with_covariance, self._covariance_age_s = with_covariance, covariance_age_s
        self._with_hand, self._asked_ns = lockstep and with_hand, -1
        self._asked: deque[JointTrajectory] = deque(maxlen=_WAITING)
        self._waits_for_joint = lockstep and with_joint
        self._joints: deque[tuple[int, float]] = deque(maxlen=_WAITING)
        self._readings: deque[tuple[int, Array]] = deque(maxlen=_WAITING)
        self._states: deque[JointState] = deque(maxlen=_WAITING)
        self._certainties: deque[tuple[int, Certainty | None]] = deque(maxlen=_WAITING)

    def add_reading(self, stamp_ns: int, pressure_pa: Array) -> None:
        """Add measured pressures (n_u,) [Pa gauge] of a time [ns]."""
        self._readings.append((stamp_ns, pressure_pa))

    def add_state(self, message: JointState) -> None:
        """Add an estimate of the arm's state, which waits for its tick."""
        self._states.append(message)

    def add_certainty(self, stamp_ns: int, certainty: Certainty | None) -> None:
        """Add what the filter says of its estimate of a time [ns]; None: it has none."""
        self._certainties.append((stamp_ns, certainty))

    def add_joint(self, stamp_ns: int, angle_rad: float) -> None:
        """Add the measured angle of the joint at a time [ns]; NaN: there is none."""
        self._joints.append((stamp_ns, angle_rad))

    def add_asked(self, message: JointTrajectory) -> None:
        """Add what a hand asks for at a time, or that it asks for nothing then."""
        self._asked_ns = max(self._asked_ns, messages.to_ns(message.header.stamp))
        self._asked.append(message)

    @property
    def has_reading(self) -> bool:
        """Whether a reading of the pressures has ever come."""
        return bool(self._readings)

    def clear(self) -> None:
        """Drop the states that wait, and what a hand has asked for."""
        self._states.clear()
        self._asked.clear()
        self._asked_ns = -1

    def next(self) -> TickInput | None:
        """Return the messages of the next tick; None if one has yet to arrive."""
        if not self._states:
            return None
        stamp_ns = messages.to_ns(self._states[0].header.stamp)
        if self._with_hand and self._asked_ns < stamp_ns:
            return None
        reading, found = self._reading_at(stamp_ns), self._certainty_at(stamp_ns)
        if reading is None or (found is None and self._lockstep and self._with_covariance):
            return None
        joint = self._at(self._joints, stamp_ns)
        if joint is None and self._waits_for_joint:
            return None
        certainty = None if found is None else found[1]
        asked = tuple(one for one in self._asked if messages.to_ns(one.header.stamp) <= stamp_ns)
        for one in asked:
            self._asked.remove(one)
        return TickInput(self._states.popleft(), stamp_ns, reading, certainty, joint, asked)

    def _at(self, waiting: deque[tuple[int, _Value]], stamp_ns: int) -> tuple[int, _Value] | None:
        """Return what has this time in lockstep, in real time the newest; None if it has yet to arrive."""
        for found in reversed(waiting):
            if found[0] == stamp_ns or not self._lockstep:
                return found
        return None

    def _reading_at(self, stamp_ns: int) -> Array | None:
        if (found := self._at(self._readings, stamp_ns)) is not None:
            return found[1]
        return None if self._lockstep else np.full(self._n_u, np.nan)

    def _certainty_at(self, stamp_ns: int) -> tuple[int, Certainty | None] | None:
        for found in reversed(self._certainties):
            age_s = (stamp_ns - found[0]) * 1e-9
            if age_s == 0.0 or (not self._lockstep and abs(age_s) <= self._covariance_age_s):
                return found
        return None


def unusable(
    message: JointState,
    stamp_ns: int,
    coordinates: Sequence[str],
    last_ns: int | None,
    age_s: float,
    limit_s: float,
) -> str:
    """Return why a state cannot be used, or an empty string.

    Parameters
    ----------
    message : JointState
        On arm/state.
    stamp_ns, last_ns : int
        Its stamp, and that of the last one that was used; None before the first.
    coordinates : sequence of str
        Coordinates of the controller's model.
    age_s, limit_s : float
        Its age, and the longest one allowed [s].
    """
    if not message.name:
        return "no estimate of the state"
    if tuple(message.name) != tuple(coordinates):
        return f"arm/state of {messages.format_names(message.name)}, expected {list(coordinates)}"
    if not len(message.position) == len(message.velocity) == len(coordinates):
        found = f"{len(message.position)} positions and {len(message.velocity)} velocities"
        return f"arm/state has {found} for {len(coordinates)} coordinates"
    if not (messages.is_possible(message.position) and messages.is_possible(message.velocity)):
        return "arm/state is of no arm: a number that is not finite, or out of any range"
    if last_ns is not None and stamp_ns <= last_ns:
        return "arm/state is not newer than the last"
    if age_s < -limit_s:  # used, it would make all later ones old
        return f"arm/state is {-age_s:.3f} s in the future"
    return f"arm/state is {age_s:.3f} s old" if age_s > limit_s else ""


def unusable_joint(topic: str, joint: tuple[int, float] | None, stamp_ns: int, limit_s: float) -> str:
    """Return why the angle of a joint cannot be used, or an empty string.

    Parameters
    ----------
    topic : str
        Where it comes from.
    joint : (stamp_ns, angle) or None
        As in `TickInput`.
    stamp_ns : int
        Time of the tick [ns].
    limit_s : float
        The longest age allowed [s].
    """
    if joint is None:
        return f"{topic} has not come yet"
    if not abs(joint[1]) <= _MOST_RAD:  # what is not finite is not less
        return f"{topic} has no angle; allowed: position[0] within {_MOST_RAD:g} rad of 0"
    age_s = (stamp_ns - joint[0]) * 1e-9
    if age_s < -limit_s:
        return f"{topic} is {-age_s:.3f} s in the future"
    return f"{topic} is {age_s:.3f} s old" if age_s > limit_s else ""
