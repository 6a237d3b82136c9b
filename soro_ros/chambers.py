"""The chamber topics and services of whoever holds the air: the regulator node, or the twin in its place."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from soro_core import safety
from soro_core.errors import SoroError
from soro_core.pneumatics import RegulatorModel
from soro_ros import messages, qos

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Of regulators and of a platform that say nothing else.
TYPICAL, RATED = RegulatorModel(), safety.Rating()


class ChamberInterface:
    """Commands in through the limiter, readings out, and ~/enable, ~/vent, ~/reset.

    Parameters
    ----------
    node : Node
        Owner of the topics and services.
    names : sequence of str
        Chambers in order.
    limits : Limits
        Of commands and readings.
    now_ns : callable
        Time that ages are measured with: steady in real time, the tick's in lockstep.
    stamp_now_ns : callable
        The time now on the clock of the message stamps.
    on_command : callable, optional
        Called after each command that arrived, accepted or not.
    recover : callable, optional
        Brings the regulators back before the latch opens; raises SoroError if it cannot.
    lockstep : bool
        Whether a lost message would be a deadlock.
    response : RegulatorModel
        How the regulators follow their set points: what the monitors compare the readings with.
    rating : Rating
        Of the platform; limits beyond it are refused.
    """

    def __init__(
        self,
        node: Node,
        names: Sequence[str],
        limits: safety.Limits,
        now_ns: Callable[[], int],
        stamp_now_ns: Callable[[], int],
        on_command: Callable[[], None] | None = None,
        recover: Callable[[], None] | None = None,
        lockstep: bool = False,
        response: RegulatorModel = TYPICAL,
        rating: safety.Rating = RATED,
    ) -> None:
        safety.check_rating(limits, rating, where=f"parameters of {node.get_name()}")
        self._response = response
        self._node, self._names, self._limits, self._now_ns = node, tuple(names), limits, now_ns
        self._stamp_now_ns = stamp_now_ns
        self._on_command, self._recover = on_command, recover
        self._state = safety.initial_state(len(self._names), self._names)
        self.seen_ns = -1
        """Stamp of the latest message on chambers/command, accepted or not."""
        self._publisher = node.create_publisher(JointState, "chambers/state", qos.loop(lockstep))
        node.create_subscription(JointState, "chambers/command", self._on_joint_state, qos.command(lockstep))
        node.create_subscription(Float64MultiArray, "chambers/commands", self._on_array, qos.RELIABLE)
        node.create_service(Trigger, "~/enable", self._on_enable)
        node.create_service(Trigger, "~/vent", self._on_vent)
        node.create_service(Trigger, "~/reset", self._on_reset)

    @property
    def setpoint_pa(self) -> Array:
        """Set points (n,) [Pa gauge] of the next exchange."""
        return self._state.setpoint_pa

    @property
    def cause(self) -> str | None:
        """What tripped the limiter, or None."""
        return self._state.cause

    @property
    def rejected(self) -> dict[str, int]:
        """Refused commands by kind."""
        return self._state.rejected

    def judge(
        self,
        reading_pa: Array,
        fresh: bool | Flags,
        fault: str | None = None,
        supply_pa: Array | None = None,
    ) -> bool:
        """Judge the readings of an exchange; returns whether the regulators must vent now."""
        before = self._state.cause
        self._state = safety.cycle(
            self._limits, self._state, reading_pa, fresh, self._now_ns(), fault, supply_pa, self._response
        )
        if self._state.cause is not None and before is None:
            self._node.get_logger().error(f"vented: {self._state.cause}")
        return self._state.vented

    def vent(self, cause: str) -> None:
        """Latch with a cause."""
        if self._state.cause is None:
            self._node.get_logger().error(f"vented: {cause}")
        self._state = safety.request_vent(self._state, cause)

    def interpolated(self, reading_pa: Array, fresh: Flags) -> Array:
        """Readings that have just been judged, those that are not fresh carried on to now."""
        return safety.interpolated(self._state, reading_pa, fresh)

    def publish(self, reading_pa: Array, stamp_ns: int) -> None:
        """Publish readings on chambers/state."""
        self._publisher.publish(messages.chambers(self._names, reading_pa, stamp_ns))

    def _on_joint_state(self, message: JointState) -> None:
        stamp_ns = messages.to_ns(message.header.stamp)
        self.seen_ns = max(self.seen_ns, stamp_ns)
        if message.name or message.effort:  # an empty one says in lockstep that this tick has no command
            self._take(message, stamp_ns)
        if self._on_command is not None:
            self._on_command()

    def _take(self, message: JointState, stamp_ns: int) -> None:
        try:
            command = messages.pressures(message, self._names)
        except ValueError as error:
            self._refused(f"chambers/command: {error}")
            return
        # Stamps are of the ROS clock, ages of a clock that nobody sets.
        age_ns = self._stamp_now_ns() - stamp_ns
        # Two programs on one topic are two sources: each gives its name in frame_id, as our controller does.
        source = f"chambers/command {message.header.frame_id}".rstrip()
        self._offer(command, self._now_ns() - age_ns, source)

    def _on_array(self, message: Float64MultiArray) -> None:
        # Without a stamp it may have waited since the last cycle; of several the later one is the newer.
        cycle_ns, source = self._state.cycle_ns, "chambers/commands"
        stamp_ns = self._now_ns() if cycle_ns is None else cycle_ns
        if self._state.command_source == source:
            stamp_ns = max(stamp_ns, self._state.command_stamp_ns + 1)
        self._offer(np.array(message.data, dtype=np.float64), stamp_ns, source)

    def _offer(self, command_pa: Array, stamp_ns: int, source: str) -> None:
        self._state, refusal = safety.offer(
            self._limits, self._state, command_pa, stamp_ns, self._now_ns(), source
        )
        if refusal is not None:
            self._refused(refusal)

    def _refused(self, reason: str) -> None:
        self._node.get_logger().warning(f"command refused: {reason}", throttle_duration_sec=1.0)

    def _on_enable(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        is_open = self._state.cause is None
        response.success = is_open
        response.message = "enabled" if is_open else f"vented ({self._state.cause}): call ~/reset first"
        return response

    def _on_vent(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.vent("vent requested")
        response.success, response.message = True, "vented until ~/reset"
        return response

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        opened, refusal = safety.reset(self._limits, self._state, self._now_ns())
        if refusal is None and self._recover is not None:
            try:
                self._recover()
            except SoroError as error:
                opened, refusal = self._state, str(error)
        self._state = opened
        response.success, response.message = refusal is None, refusal or "reset"
        return response
