"""The simulator twin: the robot's topics without the robot, in real time or in lockstep."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from geometry_msgs.msg import PoseStamped
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from std_srvs.srv import Trigger

from soro_core.config import find_config
from soro_core.errors import ConfigError, ModelError
from soro_core.hardware.plant_link import PlantFrame, PlantLinkClient
from soro_core.pneumatics import ValveAction, healthy
from soro_core.robot import load_robot
from soro_core.safety import Limiter, Rating, check_rating
from soro_core.twin import Observation, Twin, TwinConfig, TwinState
from soro_core.twin.shadow import beginning, between
from soro_ros import messages, qos
from soro_ros.chambers import ChamberInterface
from soro_ros.diagnostics import ERROR, OK
from soro_ros.faults import FaultInterface
from soro_ros.lifecycle import SoroNode, run_node

# A real-time twin that fell behind makes up this much at once; beyond it, time is skipped and counted.
CATCH_UP_TICKS = 20
# Longest wait for a frame of the valves in lockstep, during which the node does not hear its services.
LINK_WAIT_S = 0.05


class TwinNode(SoroNode[TwinConfig]):
    """Publishes sensors and truth; moved by its own regulators, emulated valves or measured pressures."""

    config_model = TwinConfig
    node_name = "twin"
    _link: PlantLinkClient | None = None
    _faults: FaultInterface | None = None

    def setup(self, config: TwinConfig) -> None:
        if bool(config.plant_link) != (config.pressures == "valves"):
            allowed = "the socket of the emulated valves with pressures: valves, and only then"
            raise ConfigError("parameters of twin", "plant_link", config.plant_link, allowed)
        robot = self._robot = load_robot(find_config(config.robot, "robots"))
        self._config, self._lockstep = config, config.mode == "lockstep"
        self._twin = Twin(robot, config)
        # Of emulated valves: they say what they do, and hear what pressures come of it.
        self._moves_air = config.pressures == "valves" and config.air == "states"
        self._names, self._true_names = robot.chamber_names, self._twin.plant.arm.robot.coordinate_names
        self.compile(self._warm_up)
        self._state = self._twin.initial()
        self._period_ns = round(1e9 / config.rate_hz)
        self._epoch_ns = 0
        self._observed = -1
        self._skipped = 0
        self._running = False
        self._seen: Observation | None = None
        self._chambers: ChamberInterface | None = None
        loop = qos.REPLAYED if config.pressures == "measured" else qos.loop(self._lockstep)
        self._pose = self.create_publisher(PoseStamped, "sensors/pose0", loop)
        self._imu = self.create_publisher(Imu, "sensors/imu0", loop)
        self._true_tip = self.create_publisher(PoseStamped, "truth/tip", loop)
        self._true_state = self.create_publisher(JointState, "truth/state", loop)
        self._true_air = self.create_publisher(JointState, "truth/chambers", loop)
        self._clock_publisher = (
            self.create_publisher(Clock, "/clock", qos.LOCKSTEP) if self._lockstep else None
        )
        self.create_service(Trigger, "~/start", self._on_start)
        if config.pressures == "regulators":
            check_rating(config.limits, Rating(), where="parameters of twin")
            self._limiter = Limiter(config.limits, self._names, config.regulator)
            self._chambers = ChamberInterface(
                self,
                self._limiter,
                self._now_ns,
                self._stamp_now_ns,
                self._advance_with_commands,
                self.diagnose,
                self._lockstep,
            )
        elif config.pressures == "valves":
            self._link = PlantLinkClient(config.plant_link)
            if (n := self._link.join(moves_air=False).pressures.size) != len(self._names):
                allowed = f"valves of {len(self._names)} chambers, as {robot.name} has, not of {n}"
                raise ConfigError("parameters of twin", "plant_link", config.plant_link, allowed)
            if config.fault_link:
                self._faults = FaultInterface(self, config.fault_link)
        else:
            self._measured: tuple[int, np.ndarray] | None = None
            self._bridged = 0
            self.create_subscription(JointState, "chambers/state", self._on_measured, qos.REPLAY)

    def _warm_up(self) -> None:
        """Do once, unseen, what every tick does."""
        twin = Twin(self._robot, self._config)
        state, _ = twin.observe(twin.initial())
        twin.step_setpoints(state, state.air.pressure_pa)

    def start(self) -> None:
        if not self._config.paused:
            self._begin()

    def stop(self) -> None:
        self._running = False
        self._release_air()

    def teardown(self) -> None:
        for client in (self._link, self._faults):
            if client is not None:
                client.close()
        self._link = self._faults = None

    def _on_start(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self._running:
            self._begin()
        response.success, response.message = True, "running"
        return response

    def _begin(self) -> None:
        self._running = True
        if self._config.pressures == "measured":
            return
        if self._link is not None:
            present = self._link.join(self._moves_air).pressures
            self._state = self._twin.at_pressures(self._state, present)
        if self._lockstep:
            self._observe()
            if self._link is not None:
                # Nothing of ROS wakes up on the valves' socket; each call waits for one frame on it.
                self.every(1e-4, self._advance_with_valves)
            else:
                self._advance_with_commands()
        else:
            # Time goes on from the tick at which it stood.
            self._epoch_ns = self.get_clock().now().nanoseconds - self._tick_ns()
            self._begun = time.perf_counter() - self._state.tick / self._config.rate_hz
            self._skipped = 0
            self.every(1.0 / self._config.rate_hz, self._advance_real_time)

    # Time -----------------------------------------------------------------------------------------
    def _tick_ns(self) -> int:
        return self._state.tick * self._period_ns

    def _now_ns(self) -> int:
        return self._tick_ns() if self._lockstep else time.monotonic_ns()

    def _stamp_now_ns(self) -> int:
        return self._tick_ns() if self._lockstep else self.get_clock().now().nanoseconds

    def _advance_with_valves(self) -> None:
        """Lockstep: one frame of pressures is one tick."""
        if self._over():
            self._release_air()
        elif self._running and (frame := self._link.wait(LINK_WAIT_S)) is not None:
            self._step_with_valves(frame)
            self._observe()

    def _release_air(self) -> None:
        """Nobody is to wait for pressures from a twin whose time stands still."""
        if self._link is not None:
            self._link.release()

    def _advance_with_commands(self) -> None:
        """Lockstep: the command that answers tick k - 1 acts from tick k on."""
        while self._lockstep and self._running and not self._over():
            if self._state.tick > 0 and self._chambers.seen_ns < self._tick_ns() - self._period_ns:
                return
            self._step_with_commands()
            self._observe()

    def _over(self) -> bool:
        end = self._config.duration_s
        return end > 0 and self._state.tick >= round(end * self._config.rate_hz)

    def _advance_real_time(self) -> None:
        due = (
            int((time.perf_counter() - self._begun) * self._config.rate_hz) - self._state.tick - self._skipped
        )
        if due > CATCH_UP_TICKS:
            self._skipped += due - CATCH_UP_TICKS
            due = CATCH_UP_TICKS
        frame = self._link.latest() if self._link is not None else None
        for _ in range(due):
            self._observe()
            if self._chambers is not None:
                self._step_with_commands()
            else:
                self._step_with_valves(frame)

    def _on_measured(self, message: JointState) -> None:
        """Advance to the stamp of measured pressures, which go in straight lines between samples."""
        if not self._running:
            return
        try:
            pressure = messages.pressures(message, self._names)
        except ValueError as error:
            self.get_logger().warning(f"chambers/state refused: {error}", throttle_duration_sec=1.0)
            return
        stamp_ns = messages.to_ns(message.header.stamp)
        if self._measured is None:
            self._epoch_ns = stamp_ns
            self._state = beginning(self._twin, pressure)
            self._observe()
        else:
            last_ns, last = self._measured
            ways = between(last, pressure, last_ns, stamp_ns, self._period_ns)
            if not ways:
                return
            self._bridged += len(ways) - 1
            # Time is the recording's own; its period is never quite the nominal one.
            self._epoch_ns = stamp_ns - (self._state.tick + len(ways)) * self._period_ns
            for way in ways:
                self._arrive(self._twin.step_pressures(self._state, way))
                self._observe()
        self._measured = (stamp_ns, pressure)

    # One tick -------------------------------------------------------------------------------------
    def _step_with_commands(self) -> None:
        self._limiter.judge(self._seen.reading_pa, True, self._now_ns())
        self._chambers.tell()
        self._arrive(self._twin.step_setpoints(self._state, self._limiter.state.setpoint_pa))

    def _step_with_valves(self, frame: PlantFrame) -> None:
        if not self._moves_air:
            self._arrive(self._twin.step_pressures(self._state, frame.pressures))
            return
        pressure = self._state.air.pressure_pa
        if not frame.action.spans:  # not heard of this twin yet
            action = ValveAction(((self._twin.dt, pressure),), healthy(pressure.size))
        elif self._lockstep:
            action = frame.action
        else:  # what they do at last holds for a tick of this clock
            action = replace(frame.action, spans=((self._twin.dt, frame.action.spans[-1][1]),))
        self._arrive(self._twin.step_valves(self._state, action))
        self._link.answer(frame, self._state.air.pressure_pa)

    def _arrive(self, state: TwinState) -> None:
        self._state = state
        if not state.status.ok:
            self._running = False
            raise ModelError(f"the twin stopped at {self._tick_ns() * 1e-9:.3f} s: {state.status}")

    def _observe(self) -> None:
        """Publish what is seen at this tick, once."""
        if self._state.tick == self._observed:
            return
        self._observed = self._state.tick
        self._state, seen = self._twin.observe(self._state)
        self._seen = seen
        stamp_ns = self._epoch_ns + self._tick_ns() + self._skipped * self._period_ns
        truth, air = self._state.arm, self._state.air.pressure_pa
        if self._clock_publisher is not None:
            self._clock_publisher.publish(Clock(clock=messages.to_time(stamp_ns)))
        for pose in seen.poses:
            self._pose.publish(messages.pose_sample(pose, self._sample_ns(pose.stamp_s)))
        for imu in seen.imus:
            self._imu.publish(messages.imu_sample(imu, self._sample_ns(imu.stamp_s)))
        if self._chambers is not None:
            self._chambers.publish(seen.reading_pa, stamp_ns)
        self._true_tip.publish(messages.pose_stamped(seen.tip, stamp_ns, "world"))
        self._true_state.publish(
            messages.arm_state(self._true_names, truth.q, truth.qd, np.zeros_like(truth.q), stamp_ns)
        )
        self._true_air.publish(messages.chambers(self._names, air, stamp_ns))

    def _sample_ns(self, stamp_s: float) -> int:
        return self._epoch_ns + round(stamp_s * 1e9) + self._skipped * self._period_ns

    def diagnose(self) -> None:
        vented = self._limiter.state.complaint if self._chambers is not None else None
        values = {"tick": self._state.tick, "time_s": self._tick_ns() * 1e-9, "skipped_ticks": self._skipped}
        if self._config.pressures == "measured":
            values["bridged_ticks"] = self._bridged
        if vented:
            self.diagnostics.update(ERROR, f"vented: {vented}", values)
        else:
            self.diagnostics.update(OK, "active" if self._running else "paused", values)


def main() -> None:
    """Entry point of `ros2 run soro_ros twin`."""
    run_node(TwinNode)


if __name__ == "__main__":
    main()
