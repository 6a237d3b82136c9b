"""What is shown of an arm at one time, from the newest message of each of its topics."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Pose, PoseArray, PoseStamped, PoseWithCovarianceStamped, WrenchStamped
from sensor_msgs.msg import JointState

from soro_core.arrays import Array
from soro_ros.conversion import messages
from soro_ros.conversion.force import force_of, stage_of
from soro_ros.status_words import VENTED, node_of

BACKBONE, TIP, WANTED = "arm/backbone", "arm/tip", "arm/desired/tip"
PRESSURES, LATCH = "chambers/state", "chambers/latch"
WRENCH, WRENCH_COVARIANCE = "arm/wrench", "arm/wrench/covariance"
DIAGNOSTICS = "/diagnostics"
TOPICS: Mapping[str, type[Any]] = {
    BACKBONE: PoseArray,
    TIP: PoseWithCovarianceStamped,
    WANTED: PoseStamped,
    PRESSURES: JointState,
    WRENCH: WrenchStamped,
    WRENCH_COVARIANCE: JointState,
    LATCH: DiagnosticStatus,
    DIAGNOSTICS: DiagnosticArray,
}

# After this time without a message of its topic, nothing is shown of it [s].
STALE_S = 1.0
# Nodes publish /diagnostics once a second; after this time a node is said to be silent [s].
SILENT_S = 5.0


@dataclass(frozen=True)
class Moment:
    """What is shown at one time; what is not known, or no longer, is None or missing.

    Attributes
    ----------
    t_s : float
        Time since the first message [s].
    backbone : ndarray (n, 4, 4) or None
        Poses at equal distances from base to tip.
    tip, wanted : ndarray (3,) or None
        Estimated tip and its reference, in the world [m].
    pressure : mapping of str to float
        Of each chamber [Pa gauge].
    latched : bool or None
        Whether the latch of the valves is closed.
    valves : str
        State of the valves, and the cause of a latch, in words.
    faults : tuple of str
        What nodes warn of, a line each.
    force : ndarray (3,) or None
        Estimated force on the arm at its tip, in the world [N].
    stage : str
        Stage of contact, of `soro_ros.status_words.STAGES`; empty where it is not known.
    """

    t_s: float = 0.0
    backbone: Array | None = None
    tip: Array | None = None
    wanted: Array | None = None
    pressure: Mapping[str, float] = field(default_factory=dict)
    latched: bool | None = None
    valves: str = "not known: no node drives valves"
    faults: tuple[str, ...] = ()
    force: Array | None = None
    stage: str = ""

    @property
    def error_m(self) -> float:
        """Distance of the tip from its reference [m]; NaN where one of them is not known."""
        if self.tip is None or self.wanted is None:
            return math.nan
        return float(np.linalg.norm(self.tip - self.wanted))


class Received:
    """The newest message of each topic of one arm.

    Parameters
    ----------
    namespace : str
        Of the arm's nodes, with a slash at its begin: ``/track_circle``.
    silent_s : float
        Time without diagnostics after which a node is said to be silent [s].

    Attributes
    ----------
    t_s : float
        Stamp of the newest pressures since the first ones [s].
    """

    def __init__(self, namespace: str, silent_s: float = SILENT_S) -> None:
        self._prefix, self._silent_s = namespace.rstrip("/") + "/", silent_s
        self._newest: dict[str, tuple[float, Any]] = {}
        self._nodes: dict[str, tuple[float, DiagnosticStatus]] = {}
        self._first_s: float | None = None
        self.t_s = 0.0

    def take(self, topic: str, message: Any, now_s: float) -> None:
        """Take a message, received at a time [s].

        Parameters
        ----------
        topic : str
            One of `TOPICS`.
        message : object
            Message of its type.
        now_s : float
            Time of its reception [s], by any clock.
        """
        if topic == DIAGNOSTICS:
            for status in message.status:
                if (name := node_of(status.name, self._prefix)) is not None:
                    self._nodes[name] = (now_s, status)
            return
        self._newest[topic] = (now_s, message)
        if topic == PRESSURES:
            stamp_s = messages.to_ns(message.header.stamp) * 1e-9
            if self._first_s is None or stamp_s < self._first_s + self.t_s:  # a run begins anew
                self._first_s = stamp_s
            self.t_s = stamp_s - self._first_s

    def moment(self, now_s: float) -> Moment:
        """Return what is known at a time [s] of the clock of `take`."""

        def fresh(topic: str) -> Any:
            at_s, message = self._newest.get(topic, (-math.inf, None))
            return message if now_s - at_s <= STALE_S else None

        backbone, tip, wanted = fresh(BACKBONE), fresh(TIP), fresh(WANTED)
        wrench, doubt = fresh(WRENCH), fresh(WRENCH_COVARIANCE)
        force = None if wrench is None else force_of(wrench)
        poses = [] if backbone is None else backbone.poses
        is_shape = len(poses) > 1 and all(messages.is_pose(one) for one in poses)
        latched, valves = self._latch(now_s)
        return Moment(
            self.t_s,
            messages.transforms(backbone) if is_shape else None,
            None if tip is None else _place(tip.pose.pose),
            None if wanted is None else _place(wanted.pose),
            messages.efforts(fresh(PRESSURES)),
            latched,
            valves,
            tuple(self._faults(now_s)),
            force if force is not None and messages.is_possible(force) else None,
            "" if doubt is None else stage_of(doubt),
        )

    def _latch(self, now_s: float) -> tuple[bool | None, str]:
        """Return whether the latch is closed, and the words of the node that drives the valves.

        Readings come also while a device is silent: without them the driver is gone, and what it said of an
        open latch is not known to hold.
        """
        if LATCH in self._newest:
            said = [self._newest[LATCH][1]]
        else:
            said = [status for _, status in self._nodes.values() if status.message.startswith(VENTED)]
        for status in said:
            if _level(status) >= 2:
                return True, status.message
        if PRESSURES not in self._newest:
            return (False, "open") if LATCH in self._newest else (None, Moment.valves)
        age_s = now_s - self._newest[PRESSURES][0]
        return (False, "open") if age_s <= STALE_S else (None, f"not known: no readings for {age_s:.0f} s")

    def _faults(self, now_s: float) -> list[str]:
        lines = []
        for name, (at_s, status) in sorted(self._nodes.items()):
            ended = any(pair.key == "lifecycle" and pair.value == "finalized" for pair in status.values)
            if now_s - at_s > self._silent_s and not ended:
                lines.append(f"{name}: silent for {now_s - at_s:.0f} s")
            elif _level(status) >= 1:
                lines.append(f"{name}: {status.message.removeprefix(f'{name}: ')}")
        return lines


def _level(status: DiagnosticStatus) -> int:
    return int.from_bytes(status.level, "little")


def _place(pose: Pose) -> Array | None:
    return messages.pose_arrays(pose)[0] if messages.is_pose(pose) else None
