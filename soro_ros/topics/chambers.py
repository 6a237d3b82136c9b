"""Topics and services of the chambers, for the regulator node or the twin in its place.

Of valves that several arms share, the topics of each arm stand in its namespace below that of the node.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from soro_core.arrays import Array
from soro_core.errors import SoroError
from soro_core.safety import ArmLimiter, Limiter
from soro_ros.conversion import messages, qos
from soro_ros.host import pulse
from soro_ros.host.services import create_triggers
from soro_ros.status_words import REQUESTED, VENTED
from soro_ros.topics.command_topic import CommandTopic
from soro_ros.topics.diagnostics import ERROR, NONE, OK, WARN


class ChamberInterface:
    """Commands in to a limiter, readings out, and ~/enable, ~/vent, ~/reset.

    Parameters
    ----------
    node : Node
        Owner of the topics and services.
    limiter : Limiter
        Limiter of the commands; the node exchanges and judges.
    now_ns : callable
        Time that ages are measured with: steady in real time, the tick's in lockstep.
    stamp_now_ns : callable
        The time now on the clock of the message stamps.
    on_command : callable
        Called after each command that arrived, accepted or not.
    on_latch : callable
        Called when the latch has closed or opened, or a vented arm is found not to become empty.
    lockstep : bool
        Whether a lost message would be a deadlock.
    on_publishers : callable
        Called when `second_publisher` has changed.
    follow_shared_name : bool
        Whether commands are followed while two publishers give the same name.
    device : str
        What is driven, for chambers/latch.
    note : callable
        Takes an event and its text, for the log that outlives runs.
    """

    def __init__(
        self,
        node: Node,
        limiter: Limiter,
        now_ns: Callable[[], int],
        stamp_now_ns: Callable[[], int],
        on_command: Callable[[], None] = lambda: None,
        on_latch: Callable[[], None] = lambda: None,
        lockstep: bool = False,
        on_publishers: Callable[[], None] = lambda: None,
        follow_shared_name: bool = False,
        device: str = "",
        note: Callable[[str, str], None] = lambda event, text: None,
    ) -> None:
        self._node, self._limiter, self.now_ns = node, limiter, now_ns
        self.stamp_now_ns, self.on_command, self._on_latch = stamp_now_ns, on_command, on_latch
        self._follow_shared_name, self._note = follow_shared_name, note
        self._reported: tuple[str | None, str | None] = None, None
        self._device = device
        self._arms = [
            _ArmTopics(self, node, own, f"{arm}/" if arm else "", lockstep, on_publishers)
            for arm, own in limiter.of_arms().items()
        ]
        self._publish_latch()
        launcher = None if lockstep else pulse.listener()
        if launcher is not None:
            check = partial(self._check_launcher, launcher)
            node.create_timer(pulse.PERIOD_S, check, clock=Clock(clock_type=ClockType.STEADY_TIME))
        create_triggers(node, {"enable": self._on_enable, "vent": self._on_vent, "reset": self._on_reset})

    def report_latch(self) -> None:
        """Log once the cause of the latch and the chambers that are not empty; call it after each cycle."""
        before, self._reported = self._reported, (self._limiter.state.causes, self._limiter.not_vented)
        if self._reported == before:
            return
        for event, now, then in zip(("vented", "not vented"), self._reported, before, strict=True):
            if now is not None and now != then:
                self._node.get_logger().error(f"{event}: {now}")
                self._note(event, f"{now} ({self._device or NONE})")
        self._publish_latch()
        self._on_latch()

    @property
    def seen_ns(self) -> int:
        """Stamp of the latest message on chambers/command, of several arms that of the last one."""
        return min(arm.seen_ns for arm in self._arms)

    @property
    def second_publisher(self) -> str | None:
        """Topics of commands with more than one publisher, and the nodes; None without such a topic."""
        topics = [topic for arm in self._arms for topic in arm.topics]
        return "; ".join(topic.conflict for topic in topics if topic.conflict) or None

    @property
    def problem(self) -> tuple[bytes, str] | None:
        """Level and message for /diagnostics of a closed latch or a second publisher; None without both."""
        complaint, second = self._limiter.state.complaint, self.second_publisher
        if complaint is not None:
            return ERROR, "; ".join(filter(None, (f"{VENTED}: {complaint}", second)))
        return None if second is None else (WARN, second)

    def publish(self, reading_pa: Array, stamp_ns: int) -> None:
        """Publish readings on chambers/state."""
        for arm in self._arms:
            own_pa = reading_pa[arm.limiter.columns]
            arm.readings.publish(messages.chambers(arm.limiter.names, own_pa, stamp_ns))

    def _check_launcher(self, launcher: pulse.Listener) -> None:
        """Vent while the program that runs the arm gives no sign of life."""
        failure = launcher.failure()
        if failure is not None and self._limiter.cause is None:
            self._limiter.vent(failure)
            self.report_latch()

    def _publish_latch(self) -> None:
        """Publish the state of the latch for panels: they also receive it when they start later."""
        cause, kept = self._limiter.state.causes, self._limiter.not_vented
        complaint = self._limiter.state.complaint
        vented = cause is not None and kept is None
        values = {"latched": _flag(cause is not None), "vented": _flag(vented)}
        values |= {"cause": cause or "", "not_vented": kept or ""}
        message = DiagnosticStatus(
            level=OK if complaint is None else ERROR,
            name=self._node.get_fully_qualified_name(),
            message="open" if complaint is None else f"{VENTED}: {complaint}",
            hardware_id=self._device or NONE,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
        for arm in self._arms:
            arm.latch.publish(message)

    def offer(
        self, limiter: Limiter | ArmLimiter, command_pa: Array, stamp_ns: int, source: str, doubt: str | None
    ) -> None:
        """Offer a command of an arm to its limiter, or refuse one of a doubtful source.

        Parameters
        ----------
        limiter : Limiter or ArmLimiter
        command_pa : ndarray (n_u,)
            Set points [Pa gauge].
        stamp_ns : int
            Stamp of the command [ns].
        source : str
            Who has sent it.
        doubt : str or None
            Why the source is doubtful.
        """
        if doubt is not None and not self._follow_shared_name:
            limiter.doubt(doubt, source)
            self.refused(doubt)
            return
        refusal = limiter.offer(command_pa, stamp_ns, self.now_ns(), source)
        if refusal is not None:
            self.refused(refusal)

    def refused(self, reason: str) -> None:
        """Log that a command was refused."""
        line = messages.one_line(f"command refused: {reason}")
        self._node.get_logger().warning(line, throttle_duration_sec=1.0)

    def _on_enable(self) -> str:
        if cause := self._limiter.state.causes or self._limiter.why_stopped():
            raise SoroError(f"vented ({cause}): call ~/reset first")
        return "enabled"

    def _on_vent(self) -> str:
        self._limiter.vent(REQUESTED)
        self.report_latch()
        return "vented until ~/reset"

    def _on_reset(self) -> str:
        refusal = self._limiter.reset(self.now_ns)
        self._note("reset refused" if refusal else "reset", refusal or "")
        self.report_latch()
        if refusal:
            raise SoroError(refusal)
        return "reset"


class _ArmTopics:
    """The topics of the chambers of one arm: commands in, readings and the latch out."""

    def __init__(
        self,
        owner: ChamberInterface,
        node: Node,
        limiter: Limiter | ArmLimiter,
        prefix: str,
        lockstep: bool,
        on_publishers: Callable[[], None],
    ) -> None:
        self._owner, self.limiter = owner, limiter
        self._seen_ns = -1
        # Stamps ahead of the time: in lockstep a command may come before the tick that it answers.
        self._early_ns: deque[int] = deque(maxlen=100)
        self.readings = node.create_publisher(JointState, f"{prefix}chambers/state", qos.loop(lockstep))
        self.latch = node.create_publisher(DiagnosticStatus, f"{prefix}chambers/latch", qos.LATCHED)
        topics = (
            (JointState, f"{prefix}chambers/command", qos.command(lockstep), _name, self._on_joint_state),
            (Float64MultiArray, f"{prefix}chambers/commands", qos.array(lockstep), _no_name, self._on_array),
        )
        self.topics = [CommandTopic(node, *topic, on_publishers) for topic in topics]

    @property
    def seen_ns(self) -> int:
        """Stamp of the latest message on chambers/command, accepted or not, up to now.

        One from the future would let a twin in lockstep run ahead until then.
        """
        due = [one for one in self._early_ns if one <= self._owner.stamp_now_ns()]
        for one in due:
            self._early_ns.remove(one)
        self._seen_ns = max(self._seen_ns, *due) if due else self._seen_ns
        return self._seen_ns

    def _on_joint_state(self, message: JointState, doubt: str | None) -> None:
        stamp_ns = messages.to_ns(message.header.stamp)
        now_ns = self._owner.stamp_now_ns()
        self._seen_ns = max(self._seen_ns, min(stamp_ns, now_ns))
        if stamp_ns > now_ns:
            self._early_ns.append(stamp_ns)
        if message.name or message.effort:  # in lockstep an empty message means: no command at this tick
            try:
                command = messages.pressures(message, self.limiter.names)
            except ValueError as error:
                self._owner.refused(f"chambers/command: {error}")
            else:
                # Stamps use the ROS clock, which can be set; ages use a steady clock.
                age_ns = self._owner.stamp_now_ns() - stamp_ns
                # frame_id distinguishes two programs on one topic.
                source = f"chambers/command {_name(message)}".rstrip()
                self._owner.offer(self.limiter, command, self._owner.now_ns() - age_ns, source, doubt)
        self._owner.on_command()

    def _on_array(self, message: Float64MultiArray, doubt: str | None) -> None:
        # A message without a stamp may have waited since the last cycle; the later of several is the newer.
        state, source = self.limiter.state, "chambers/commands"
        stamp_ns = self._owner.now_ns() if state.cycle_ns is None else state.cycle_ns
        if state.command_source == source:
            stamp_ns = max(stamp_ns, state.command_stamp_ns + 1)
        self._owner.offer(self.limiter, np.array(message.data, dtype=np.float64), stamp_ns, source, doubt)


def on_readings(
    node: Node, names: Sequence[str], profile: QoSProfile, take: Callable[[int, Array], None]
) -> None:
    """Subscribe to chambers/state; a message that is refused is logged.

    Parameters
    ----------
    node : Node
        Owner of the subscription.
    names : sequence of str
        Of the chambers.
    profile : QoSProfile
        Quality of service.
    take : callable
        Takes stamp [ns] and readings (n_u,) [Pa gauge] of each message, in the order of `names`.
    """

    def on_message(message: JointState) -> None:
        try:
            pressure = messages.readings(message, names)
        except ValueError as error:
            node.get_logger().warning(f"chambers/state refused: {error}", throttle_duration_sec=1.0)
            return
        take(messages.to_ns(message.header.stamp), pressure)

    node.create_subscription(JointState, "chambers/state", on_message, profile)


def _flag(value: bool) -> str:
    return str(value).lower()


def _name(message: JointState) -> str:
    return str(message.header.frame_id).rstrip()


def _no_name(message: Float64MultiArray) -> str:
    return ""
