"""The controller node: each message on arm/state gives one on chambers/command."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from functools import partial

import numpy as np
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from soro_core.adaptation import Learned
from soro_core.control import Reference
from soro_core.control.laws import Certainty
from soro_core.control.reach import check_reach
from soro_core.control.retune import retune
from soro_core.errors import SoroError
from soro_core.hardware import load_platform
from soro_core.loop import controller_of
from soro_core.robot import load_robot
from soro_core.safety import narrowed
from soro_core.scene import ControllerNodeConfig
from soro_ros import learning, messages, qos, references
from soro_ros.control_report import FRAME, ControlReport
from soro_ros.diagnostics import OK, WARN
from soro_ros.enable_check import EnableCheck
from soro_ros.lifecycle import SoroNode
from soro_ros.motion_topic import REPLACED, VENTED, MotionTopic
from soro_ros.node_process import run_node
from soro_ros.tick_inputs import TickInputs, unusable


class ControllerNode(SoroNode[ControllerNodeConfig]):
    """Runs the law once a message on arm/state; not enabled, it commands zero.

    Where no command can be given (no estimate, a state too old or not finite) nothing is published, and the
    regulator's watchdog vents; in lockstep an empty message is published, because other nodes wait for one.

    Attributes
    ----------
    controller : Controller
    state : ControllerState
        State of the controller after the last tick.
    """

    config_model = ControllerNodeConfig
    node_name = "controller"
    live = ("control.", "limits.")

    def setup(self, config: ControllerNodeConfig) -> None:
        robot = load_robot(config.robot)
        self._config, self._lockstep = config, config.mode == "lockstep"
        self._platform = load_platform(config.platform) if config.platform else None
        self.controller = controller_of(config, robot, self._platform, self.get_logger().warning)
        self._names, self._coordinates = robot.chamber_names, self.controller.robot.coordinate_names
        self._enabled = config.enabled
        # The limiter distinguishes two controllers by this name; in lockstep every run must be the same.
        self._source = self.get_fully_qualified_name() + ("" if self._lockstep else f" #{os.getpid()}")
        self._forget()
        self._trouble, self._refused = "", ""
        self._reference: Reference | None = None
        self._inputs = TickInputs(
            self._lockstep, len(self._names), self.controller.law.learns, config.state_age_s
        )
        loop, sensor = qos.loop(self._lockstep), qos.sensor(self._lockstep)
        self._motions = MotionTopic(
            self, self.controller, self._lockstep, 1.0 / config.rate_hz, self._take, self._refuse
        )
        self._check = EnableCheck(self, self.controller, config)
        self._command = self.create_publisher(JointState, "chambers/command", loop)
        self._learned = self.create_publisher(Float64MultiArray, "arm/learned", loop)
        self._output = ControlReport(self, self._coordinates, loop)
        self.create_subscription(JointState, "chambers/state", self._on_reading, sensor)
        self.create_subscription(Float64MultiArray, "arm/covariance", self._on_covariance, loop)
        self.create_subscription(JointState, "arm/state", self._on_state, loop)
        self.create_subscription(
            JointTrajectory, "arm/reference/trajectory", self._on_trajectory, qos.RELIABLE
        )
        self.create_subscription(PoseStamped, "arm/reference/tip", self._on_tip, qos.RELIABLE)
        for name, callback in (
            ("enable", partial(self._enable, anyway=False)),
            ("enable_anyway", partial(self._enable, anyway=True)),
            ("vent", self._on_vent),
            ("reset", self._on_reset),
        ):
            self.create_service(Trigger, f"~/{name}", callback)
        self.compile(self._warm_up)

    def take(self, config: ControllerNodeConfig) -> None:
        """Go on with other gains, adaptation, reference or narrower limits, from the state of now."""
        narrowed(self._config.limits, config.limits, "parameters of controller")
        control, _ = config.known_control(self._platform)
        new = retune(self.controller, self.state, control, self._time_s(), config.reach)
        self.controller, self.state = new.controller, new.state
        self._motions.use(new.controller)
        if new.moves:
            self._take(new.reference)
            self._motions.cancel(REPLACED, "by another reference")

    def stop(self) -> None:
        self._inputs.clear()

    def _warm_up(self) -> None:
        """Run ticks and references once without output: imports and compilation take longer than a tick."""
        if self._config.reach > 0.0:
            check_reach(self.controller, self._config.reach)
        arm, dt, none = self.controller.arm, 1.0 / self._config.rate_hz, np.zeros(self.controller.arm.n_u)
        q = np.full(arm.n_q, 1e-3)
        state, _ = self.controller.step(self.state, q, q, 0.0, dt, none)
        for k, message in enumerate(references.trajectories_at_rest(self._coordinates), start=1):
            reference = references.trajectory(self.controller, message, 0.0)
            state, _ = self.controller.step(state, q, q, k * dt, dt, none, reference)
        pose = messages.pose_stamped(arm.pose(q, self.controller.robot.length), 0, FRAME)
        certain = Certainty(1e-12 * np.eye(2 * arm.n_q), positions=True)  # the learner takes this sample
        reference = references.tip(self.controller, self.state, pose)
        state, _ = self.controller.step(state, q, q, 4 * dt, dt, none, reference, certain)
        self._check.warm_up()
        self._motions.warm_up(state, q)

    def _forget(self) -> None:
        """Reset time, estimates and reference."""
        self.state = self.controller.initial_state()
        self._epoch_ns: int | None = None
        self._last_ns = 0
        self._reference = None
        self._zero_ns = 0

    # Inputs ----------------------------------------------------------------------------------------
    def _on_reading(self, message: JointState) -> None:
        try:
            pressure = messages.pressures(message, self._names)
        except ValueError:
            return  # the estimator reports it
        self._inputs.add_reading(messages.to_ns(message.header.stamp), pressure)
        self._check.note_reading(pressure)
        self._process()

    def _on_state(self, message: JointState) -> None:
        self._inputs.add_state(message)
        self._check.note_state(message)
        self._process()

    def _on_covariance(self, message: Float64MultiArray) -> None:
        self._inputs.add_covariance(message)
        self._process()

    def _on_trajectory(self, message: JointTrajectory) -> None:
        self._follow(lambda t: references.trajectory(self.controller, message, t))

    def _on_tip(self, message: PoseStamped) -> None:
        self._follow(lambda t: references.tip(self.controller, self.state, message))

    def _follow(self, make: Callable[[float], Reference]) -> None:
        """Follow a reference; after a refusal the old reference stays."""
        try:
            self._take(make(self._time_s()))
        except SoroError as error:
            self._refuse(str(error))
            return
        self._motions.cancel(REPLACED, "by another reference")
        self._refuse("")

    def _time_s(self) -> float:
        """Return the time of the last tick since the first one [s]."""
        return 0.0 if self._epoch_ns is None else (self._last_ns - self._epoch_ns) * 1e-9

    def _take(self, reference: Reference | None) -> None:
        self._reference = reference

    def _refuse(self, reason: str) -> None:
        """Report why a reference is refused; an empty reason ends the report of the last refusal."""
        refused = f"reference refused: {reason}" if reason else ""
        if refused and refused == self._refused:  # limit the log of a repeated reference
            self.get_logger().error(refused, throttle_duration_sec=1.0)
        elif refused != self._refused:
            self._refused = refused
            if refused:
                self.get_logger().error(refused)
            self._report()

    # One tick --------------------------------------------------------------------------------------
    def _process(self) -> None:
        while (found := self._inputs.next()) is not None:
            self._tick(*found)

    def _tick(
        self, message: JointState, stamp_ns: int, reading: np.ndarray, covariance: Float64MultiArray | None
    ) -> None:
        if not self._enabled:
            self._publish_learned(None, stamp_ns)
            if stamp_ns > self._zero_ns:
                self._publish(np.zeros(len(self._names)), stamp_ns)
            return
        begun_s = time.monotonic()
        trouble = self._unusable(message, stamp_ns)
        if not trouble:
            if self._epoch_ns is None:
                self._epoch_ns, self._last_ns = stamp_ns, stamp_ns - round(1e9 / self._config.rate_hz)
            dt = (stamp_ns - self._last_ns) * 1e-9
            # The step also covers lost states, up to a limit.
            dt = min(dt, self._config.state_age_s)
            q, qd = np.array(message.position), np.array(message.velocity)
            t = (stamp_ns - self._epoch_ns) * 1e-9
            certainty = None if covariance is None else learning.certainty_of(covariance, len(q))
            self.state, command = self.controller.step(
                self.state, q, qd, t, dt, reading, self._reference, certainty
            )
            self._last_ns, trouble = stamp_ns, command.status.message
            self._publish_learned(command.learned, stamp_ns)
        else:
            self._publish_learned(None, stamp_ns)
        self._note(trouble or command.status.note)
        if trouble:
            if self._lockstep:
                self._publish(np.zeros(0), stamp_ns)
            return
        self._publish(command.setpoint_pa, stamp_ns)
        self._output.publish(command, stamp_ns)
        tip = self.controller.arm.pose(q, self.controller.robot.length)[:3, 3]
        self._motions.tick(self.state, t, tip, begun_s)

    def _publish_learned(self, learned: Learned | None, stamp_ns: int) -> None:
        """Publish what is learned; in lockstep the filter waits for an answer, even an empty one."""
        if self.controller.law.learns and (self._lockstep or learned is not None):
            self._learned.publish(learning.learned(learned, stamp_ns))

    def _unusable(self, message: JointState, stamp_ns: int) -> str:
        last_ns = None if self._epoch_ns is None else self._last_ns
        age_s = 0.0 if self._lockstep else (self.get_clock().now().nanoseconds - stamp_ns) * 1e-9
        return unusable(message, stamp_ns, self._coordinates, last_ns, age_s, self._config.state_age_s)

    def _publish(self, setpoint_pa: np.ndarray, stamp_ns: int) -> None:
        names = self._names if setpoint_pa.size else ()
        message = messages.chambers(names, setpoint_pa, stamp_ns)
        message.header.frame_id = self._source
        self._command.publish(message)

    def _note(self, trouble: str) -> None:
        if trouble != self._trouble:
            self._trouble = trouble
            self._report()

    def _report(self) -> None:
        problems = "; ".join(text for text in (self._trouble, self._refused) if text)
        self.diagnostics.update(WARN if problems else OK, problems or "active")

    def diagnose(self) -> None:
        counts = {"refused": self.state.watch.refused, **self.controller.law.counts(self.state.law)}
        self.diagnostics.update(self.diagnostics.status.level, self.diagnostics.status.message, counts)

    # Services --------------------------------------------------------------------------------------
    def _enable(self, request: Trigger.Request, response: Trigger.Response, anyway: bool) -> Trigger.Response:
        """Start the commands; an arm that is in control already is not checked."""
        warnings: list[str] = []
        if not self._enabled:
            refusals, warnings = self._check.findings(anyway, self._stay_at_zero)
            for line in (*refusals, *warnings):
                self.get_logger().warning(f"enable: {line}")
            if refusals:
                response.success, response.message = False, "; ".join(refusals)
                return response
            self._forget()
        self._enabled = True
        response.success, response.message = True, "; ".join(["enabled", *warnings])
        return response

    def _stay_at_zero(self) -> None:
        """Command zero once a period while no message is handled: without commands the driver would trip."""
        now_ns = self.get_clock().now().nanoseconds
        if now_ns - self._zero_ns > 1e9 / self._config.rate_hz:
            self._zero_ns = now_ns
            self._publish(np.zeros(len(self._names)), now_ns)

    def _on_vent(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._enabled = False
        self._motions.forget(VENTED, "commanding zero until ~/enable")
        response.success, response.message = True, "commanding zero until ~/enable"
        return response

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._forget()
        self._motions.forget(REPLACED, "estimates and reference start anew")
        response.success, response.message = True, "estimates and reference start anew"
        return response


def main() -> None:
    """Entry point of `ros2 run soro_ros controller`."""
    run_node(ControllerNode)


if __name__ == "__main__":
    main()
