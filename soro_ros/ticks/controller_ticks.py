"""The controller between its messages: each arm/state gives one chambers/command."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from geometry_msgs.msg import PoseStamped, WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory

from soro_core.adaptation import Learned
from soro_core.control import ControllerState, Reference
from soro_core.control.laws import Certainty, MeasuredJoint
from soro_core.control.motion_config import MotionConfig
from soro_core.control.probing.stamps import StampedPosition
from soro_core.control.reference_feasibility import check_reach
from soro_core.control.retune import retune
from soro_core.errors import ConfigError, SoroError
from soro_core.planning.motion_error import MotionError
from soro_core.robot import load_robot
from soro_core.safety import narrowed
from soro_hardware import load_platform
from soro_lab.scene import ControllerNodeConfig
from soro_lab.scene.loop import controller_of
from soro_ros.conversion import learning, messages, qos, references
from soro_ros.status_words import NO_COMMAND, add_prefix
from soro_ros.ticks.control_report import ControlReport
from soro_ros.topics.motion_job import REPLACED, WRENCH
from soro_ros.topics.motion_topic import MotionTopic
from soro_ros.topics.ports import Input, Inputs, NodeOutputs
from soro_ros.topics.tick_inputs import TickInput, TickInputs, unusable, unusable_joint

# What is learned is told again after this time: the filter forgets it after five times as long.
_TELL_AGAIN_NS = 20_000_000
# Between shorter ticks a law may leave some of its work to the next.
_FULL_TICK_S = 0.005
_TRAJECTORY, _TIP = "arm/reference/trajectory", "arm/reference/tip"


class ControllerTicks:
    """Runs the law once a message on arm/state; not enabled, it commands zero.

    Where no command can be given (no estimate, a state too old or not finite) nothing is published, and the
    regulator's watchdog vents; in lockstep an empty message is published, because other nodes wait for one.

    Parameters
    ----------
    config : ControllerNodeConfig
    source : str
        Name by which the limiter distinguishes two controllers.
    ports : NodeOutputs
    motion : callable, optional
        Gives the section `motion` that counts from the next path on; that of `config` by default.

    Attributes
    ----------
    controller : Controller
    state : ControllerState
        State of the controller after the last tick.
    enabled : bool
    refusals : int
        Refused references.
    motions : MotionTopic
    inputs : mapping of str to Input
        What it takes, by the name of the topic.
    """

    outputs: ClassVar[dict[str, type[Any]]] = {
        "chambers/command": JointState,
        "arm/learned": JointState,
        **ControlReport.outputs,
        **MotionTopic.outputs,
    }

    def __init__(
        self,
        config: ControllerNodeConfig,
        source: str,
        ports: NodeOutputs,
        motion: Callable[[], MotionConfig] | None = None,
    ) -> None:
        robot = load_robot(config.robot)
        self._config, self._lockstep = config, config.mode == "lockstep"
        self._source, self._ports, self._world = source, ports, config.frames.world
        self._platform = load_platform(config.platform) if config.platform else None
        self.controller = controller_of(config, robot, self._platform, ports.warn)
        self._names, self._coordinates = robot.chamber_names, self.controller.robot.coordinate_names
        self.enabled = config.enabled
        self._failure, self._refused, self.refusals = "", "", 0
        self._covariance_refused = False
        self.state: ControllerState
        self._zero_ns = 0
        self.forget()
        self._inputs = TickInputs(
            self._lockstep,
            len(self._names),
            self.controller.law.learns,
            config.state_age_s,
            config.hand,
            bool(config.control.joint),
        )
        self._frames = config.frames.within(source.rpartition("/")[0])
        self.motions = MotionTopic(
            self.controller,
            self._lockstep,
            1.0 / config.rate_hz,
            self._frames,
            self._take,
            self._refuse,
            motion or (lambda: config.control.motion),
            ports.publish,
        )
        self._report = ControlReport(self._coordinates, self._world, ports.publish, ports.is_read)
        self.inputs: Inputs = {
            "chambers/state": Input(JointState, self._on_reading, qos.sensor),
            "arm/covariance": Input(JointState, self._on_covariance, qos.loop),
            "arm/state": Input(JointState, self._on_state, qos.loop),
            # Those of a hand may not be lost in lockstep.
            _TRAJECTORY: Input(
                JointTrajectory, self._on_trajectory, qos.loop if config.hand else qos.reference
            ),
            _TIP: Input(PoseStamped, self._on_tip, qos.reference),
            WRENCH: Input(WrenchStamped, self._on_wrench, qos.reference),
            **self.motions.inputs,
        }
        if config.control.joint:
            self.inputs = {**self.inputs, config.control.joint: Input(JointState, self._on_joint, qos.sensor)}

    def warm_up(self) -> None:
        """Run ticks and references once without output: imports and compilation take longer than a tick."""
        if self._config.reach > 0.0:
            check_reach(self.controller, self._config.reach)
        arm, none = self.controller.arm, np.zeros(self.controller.arm.n_u)
        dt = max(1.0 / self._config.rate_hz, _FULL_TICK_S)
        q = np.full(arm.n_q, 1e-3)
        if self.controller.probe is not None:
            self.controller.probe.warm_up()
        begin = replace(self.state, probe=None)
        state, _ = self.controller.step(begin, q, q, 0.0, dt, none)
        for k, message in enumerate(references.trajectories_at_rest(self._coordinates), start=1):
            reference = _unless_refused(references.trajectory, self.controller, state, message, 0.0)
            state, _ = self.controller.step(state, q, q, k * dt, dt, none, reference)
        pose = messages.pose_stamped(arm.pose(q, self.controller.robot.length), 0, self._world)
        certain = Certainty(1e-12 * np.eye(2 * arm.n_q), positions=True)  # the learner takes this sample
        reference = _unless_refused(references.tip, self.controller, begin, pose, self._world)
        state, _ = self.controller.step(state, q, q, 4 * dt, dt, none, reference, certain)
        self.motions.warm_up(state, q)

    def retune(self, config: ControllerNodeConfig) -> None:
        """Go on with other gains, adaptation, reference or narrower limits, from the state of now."""
        narrowed(self._config.limits, config.limits, "parameters of controller")
        pressures, _ = config.known_pressures(self._platform)
        new = retune(self.controller, self.state, config.control, self._time_s(), config.reach, pressures)
        self.controller, self.state = new.controller, new.state
        self.motions.use(new.controller)
        if new.moves:
            self._take(new.reference)
            self.motions.cancel(REPLACED, "by another reference")

    def forget(self, anyway: bool = False) -> None:
        """Reset time, estimates and reference; `anyway`: what the probe finds will only warn."""
        self.state = self.controller.initial_state()
        if self.state.probe is not None and anyway:
            self.state = replace(self.state, probe=replace(self.state.probe, lenient=True))
        self._epoch_ns: int | None = None
        self._probed_ns = 0
        self._last_ns = 0
        self._seen: list[tuple[str, int, np.ndarray]] = []
        self._told: tuple[Learned | None, int] = None, 0
        self._reference: Reference | None = None
        # States older than the last zero wait still, and the driver refuses their commands as out of order.
        self._zero_ns = min(self._zero_ns, self._ports.now_ns())
        self._refuse("")

    @property
    def is_probing(self) -> bool:
        """Whether the probe goes on."""
        return self.enabled and self.state.probe is not None and not self.state.probe.done

    def note_pose(self, topic: str, message: PoseStamped) -> None:
        """Note a pose that a sensor has seen, for the probe."""
        if not messages.is_pose(message.pose):
            return  # the estimator reports it
        position, _ = messages.pose_arrays(message.pose)
        self._seen.append((topic.rpartition("/")[2], messages.to_ns(message.header.stamp), position))

    def clear(self) -> None:
        """Drop the states that wait."""
        self._inputs.clear()

    # Inputs ----------------------------------------------------------------------------------------
    def _on_reading(self, message: JointState) -> None:
        try:
            pressure = messages.pressures(message, self._names)
        except ValueError:
            return  # the estimator reports it
        self._inputs.add_reading(messages.to_ns(message.header.stamp), pressure)
        self._process()

    def _on_state(self, message: JointState) -> None:
        self._inputs.add_state(message)
        self._process()

    def _on_covariance(self, message: JointState) -> None:
        n_q = len(self._coordinates)
        certainty = learning.certainty_of(message, n_q)
        if certainty is None and message.position and not self._covariance_refused:
            self._covariance_refused = True
            size = f"{1 + 4 * n_q * n_q} numbers of an arm in position"
            self._ports.warn(f"arm/covariance refused: allowed: {size}, or none; said once")
        self._inputs.add_certainty(messages.to_ns(message.header.stamp), certainty)
        self._process()

    def _on_joint(self, message: JointState) -> None:
        angle_rad = message.position[0] if message.position else math.nan
        self._inputs.add_joint(messages.to_ns(message.header.stamp), angle_rad)
        self._process()

    def _on_trajectory(self, message: JointTrajectory) -> None:
        if self._lockstep and self._config.hand:
            self._inputs.add_asked(message)
            self._process()
        else:
            self._follow_trajectory(message)

    def _follow_trajectory(self, message: JointTrajectory) -> None:
        if message.points or not self._config.hand:
            make = partial(references.trajectory, self.controller, self.state, message)
            self._follow(_TRAJECTORY, message.header, make)

    def _on_tip(self, message: PoseStamped) -> None:
        self._follow(
            _TIP, message.header, lambda _: references.tip(self.controller, self.state, message, self._world)
        )

    def _on_wrench(self, message: WrenchStamped) -> None:
        frames = self._frames
        self._follow(
            WRENCH,
            message.header,
            lambda _: references.press(self.controller, self.state, message, WRENCH, frames),
        )

    def _follow(self, topic: str, header: Header, make: Callable[[float], Reference]) -> None:
        """Follow a reference; after a refusal the old reference stays."""
        stamp_ns = messages.to_ns(header.stamp)
        try:
            if not self.enabled:  # `~/enable` begins without it
                raise ConfigError(
                    topic, "controller", "not in control", "a controller in control: soro enable"
                )
            reference = make(self._time_s())
        except SoroError as error:
            self.motions.refuse(topic, stamp_ns, str(error))
            return
        self._take(reference)
        self.motions.given(topic, stamp_ns, reference)
        self._refuse("")

    def _time_s(self) -> float:
        """Return the time of the last tick since the first one [s]."""
        return 0.0 if self._epoch_ns is None else (self._last_ns - self._epoch_ns) * 1e-9

    def _take(self, reference: Reference | None) -> None:
        self._reference = reference

    def _refuse(self, reason: str) -> None:
        """Report why a reference is refused; an empty reason ends the report of the last refusal."""
        refused = f"reference refused: {reason}" if reason else ""
        self.refusals += bool(refused)
        is_new, self._refused = refused != self._refused, refused
        if refused:
            self._ports.refuse(refused, not is_new)
        if is_new:
            self._say()

    # One tick --------------------------------------------------------------------------------------
    def _process(self) -> None:
        while (found := self._inputs.next()) is not None:
            self._tick(found)

    def _tick(self, found: TickInput) -> None:
        message, stamp_ns, reading, certainty, joint, asked = found
        for one in asked:
            self._follow_trajectory(one)
        if self._lockstep and 0 < round(1e9 * self._config.duration_s) < stamp_ns - self._probed_ns:
            self.enabled = False
            self._note("")
        if not self.enabled:
            self._publish_learned(None, stamp_ns)
            # The first command says that readings and estimates come: `soro run` then enables the controller.
            if not self._inputs.has_reading:
                return
            # A clock that has been set back would otherwise end the commands.
            if stamp_ns > self._zero_ns or self._ports.now_ns() < self._zero_ns:
                self._publish(np.zeros(len(self._names)), stamp_ns)
            return
        start_s = time.monotonic()
        failure = self._unusable(message, stamp_ns)
        if (topic := self._config.control.joint) and not failure:
            failure = unusable_joint(topic, joint, stamp_ns, self._config.state_age_s)
        if not failure:
            if self._epoch_ns is None:
                self._epoch_ns, self._last_ns = stamp_ns, stamp_ns - round(1e9 / self._config.rate_hz)
            dt = (stamp_ns - self._last_ns) * 1e-9
            # The step also covers lost states, up to a limit.
            dt = min(dt, self._config.state_age_s)
            q, qd = np.array(message.position), np.array(message.velocity)
            t = (stamp_ns - self._epoch_ns) * 1e-9
            epoch_ns = self._epoch_ns
            seen = [
                StampedPosition(name, 1e-9 * (at_ns - epoch_ns), place) for name, at_ns, place in self._seen
            ]
            self._seen.clear()
            angle = joint and MeasuredJoint(
                joint[1], 1e-9 * (joint[0] - epoch_ns), 1e-9 * (stamp_ns - joint[0])
            )
            given = self._reference, certainty, self.stay_at_zero, seen, angle
            self.state, command = self.controller.step(self.state, q, qd, t, dt, reading, *given)
            self._last_ns, failure = stamp_ns, command.status.message
            self._publish_learned(command.learned, stamp_ns)
        else:
            self._publish_learned(None, stamp_ns)
        # The reading at time 0 is where the filter begins, and has no estimate.
        if stamp_ns > 0 or not self._lockstep:
            self._note(add_prefix(NO_COMMAND, failure) or command.status.note)
        if failure:
            if self._lockstep:
                self._publish(np.zeros(0), stamp_ns)
            return
        if (probe := self.state.probe) is not None and probe.done:
            self.enabled = False
            self._ports.fail(probe.refusal)
        if self._lockstep or stamp_ns >= self._zero_ns:
            self._publish(command.setpoint_pa, stamp_ns)
        if probe is not None:  # the law has not begun, and its time neither
            self._probed_ns = stamp_ns
            return
        self._report.publish(command, self.state.force.press, stamp_ns)
        tip = self.controller.arm.pose(q, self.controller.robot.length)[:3, 3]
        self.motions.tick(self.state, t, tip, start_s)

    def stay_at_zero(self) -> None:
        """Command zero once a period while no message is handled: without commands the driver would trip.

        In lockstep each state has its answer, and none comes beside them.
        """
        if self._lockstep:
            return
        now_ns = self._ports.now_ns()
        if now_ns - self._zero_ns > 1e9 / self._config.rate_hz:
            self._zero_ns = now_ns
            self._publish(np.zeros(len(self._names)), now_ns)

    def _publish_learned(self, learned: Learned | None, stamp_ns: int) -> None:
        """Publish what is new; in lockstep the filter waits for an answer, even an old or an empty one."""
        told, told_ns = self._told
        is_due = learned is not told or abs(stamp_ns - told_ns) > _TELL_AGAIN_NS
        if self.controller.law.learns and (self._lockstep or (learned is not None and is_due)):
            self._told = learned, stamp_ns
            self._ports.publish("arm/learned", learning.learned(learned, stamp_ns))

    def _unusable(self, message: JointState, stamp_ns: int) -> str:
        last_ns = None if self._epoch_ns is None else self._last_ns
        age_s = 0.0 if self._lockstep else (self._ports.now_ns() - stamp_ns) * 1e-9
        return unusable(message, stamp_ns, self._coordinates, last_ns, age_s, self._config.state_age_s)

    def _publish(self, setpoint_pa: np.ndarray, stamp_ns: int) -> None:
        names = self._names if setpoint_pa.size else ()
        message = messages.chambers(names, setpoint_pa, stamp_ns)
        message.header.frame_id = self._source
        self._ports.publish("chambers/command", message)

    def _note(self, failure: str) -> None:
        if failure != self._failure:
            self._failure = failure
            self._say()

    def _say(self) -> None:
        self._ports.report("; ".join(text for text in (self._failure, self._refused) if text))


def _unless_refused(make: Callable[..., Reference], *given: object) -> Reference | None:
    """Return a reference; None where the arm of the warm-up, which is nowhere yet, touches an obstacle."""
    try:
        return make(*given)
    except MotionError:
        return None
