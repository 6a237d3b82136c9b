"""The twin node: it simulates the robot and publishes the robot's topics, in real time or in lockstep.

A process has one for each arm of its scene, in one `ArmWorld`: `soro_twin /hand/left /hand/right`.
Beside bodies they move together, also in real time.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from functools import partial

import numpy as np
from rclpy.qos import QoSProfile

from soro_core.arrays import Array
from soro_core.errors import ConfigError, ModelError
from soro_core.robot import load_robot
from soro_core.safety import Limiter, check_rating, narrowed, rating_of
from soro_core.safety.vent_check import REST_S, empty_since
from soro_core.twin import Twin, TwinConfig, TwinState
from soro_core.twin.shadow import beginning, between
from soro_core.twin.world import ArmWorld
from soro_ros.conversion import qos
from soro_ros.host import claims
from soro_ros.host.services import create_triggers
from soro_ros.process import command_line
from soro_ros.process.lifecycle import SoroNode
from soro_ros.process.node_process import run_nodes
from soro_ros.run.faults import FaultInterface
from soro_ros.ticks.valve_drive import ValveDrive
from soro_ros.topics.chambers import ChamberInterface, on_readings
from soro_ros.topics.diagnostics import OK, OVER
from soro_ros.topics.frame_check import FrameCheck
from soro_ros.topics.twin_topics import BaseTopic, BodyTopics, PushTopic, TwinTopics

# Largest delay that a twin in real time recovers at once [ticks]; it skips and counts the rest.
CATCH_UP_TICKS = 20
# Longest gap between measured pressures that the twin bridges; behind a longer one it begins at rest [ns].
GAP_NS = 10_000_000_000


class TwinNode(SoroNode[TwinConfig]):
    """Publishes samples and true state of an arm; regulators, emulated valves or a measurement drive it."""

    config_model = TwinConfig
    node_name = "twin"
    live = ("limits.",)
    _valves: ValveDrive | None = None
    _faults: FaultInterface | None = None
    _bodies: BodyTopics | None = None

    def __init__(self, namespace: str | None = None, world: ArmWorld | None = None) -> None:
        self._world = world or ArmWorld()
        self._mates: list[TwinNode] = []  # beside bodies all arms of the world, else this one
        self._world.arms.append(self)
        super().__init__(namespace)

    @property
    def _sets_clock(self) -> bool:
        return self._world.arms[0] is self

    def claims(self) -> tuple[str, ...]:
        pressures, mode = (self.get_parameter_or(name).value for name in ("pressures", "mode"))
        drives = (claims.readings(self.get_namespace()),) if pressures == "regulators" else ()
        clock = ("/clock",) if mode == "lockstep" and self._sets_clock else ()
        return (*super().claims(), *drives, *clock)

    def setup(self, config: TwinConfig) -> None:
        if bool(config.plant_link) != (config.pressures == "valves"):
            allowed = "the socket of the emulated valves with pressures: valves, and only then"
            raise ConfigError("parameters of twin", "plant_link", config.plant_link, allowed)
        robot = self._robot = load_robot(config.robot)
        self._config, self._lockstep = config, config.mode == "lockstep"
        self._twin = Twin(robot, config)
        self._names = robot.chamber_names
        self.compile(self._warm_up)
        # Changes of the payload wait for ~/start, with which `soro run` begins control.
        self.state = replace(self._twin.initial(), start_tick=None)
        self._period_ns = round(1e9 / config.rate_hz)
        self._epoch_ns = 0
        self._observed = -1
        self._slewed_ns: int | None = None
        self._skipped = 0
        self.is_started = self._is_over = False
        self._empty_ns: int | None = None
        self._reading_pa: Array = np.full(len(self._names), np.nan)  # those of the last tick; before it none
        self._is_commanded = config.pressures == "regulators"
        loop = qos.REPLAYED if config.pressures == "measured" else qos.loop(self._lockstep)
        self._topics = TwinTopics(self, robot, self._twin, loop, self._lockstep and self._sets_clock)
        frames = FrameCheck(config.frames, self.get_logger().warning, self.diagnostics.refuse)
        self._push = PushTopic(self, frames, self._stamp_now_ns, takes=not config.bodies_file)
        if config.base_by_topic:
            BaseTopic(self, frames, self._stamp_now_ns, self._move_base)
        create_triggers(self, {"start": self._on_start})
        if self._is_commanded:
            rating = rating_of(robot.pressure_range_pa)
            check_rating(config.limits, rating, where="parameters of twin")
            self._limiter = Limiter(config.limits, self._names, config.regulator)
            self._chambers = ChamberInterface(
                self,
                self._limiter,
                self._now_ns,
                self._stamp_now_ns,
                self._advance_with_commands,
                self.diagnose,
                self._lockstep,
                self.diagnose,
                config.follow_shared_name,
                f"twin of {self.diagnostics.hardware_id}",
                self.event_log.note,
            )
        elif config.pressures == "valves":
            self._valves = ValveDrive(robot, self._twin, config)
            if config.fault_link:
                self._faults = FaultInterface(self, config.fault_link)
        else:
            self._measured: tuple[int, Array] | None = None
            self._bridged = 0
            on_readings(self, self._names, qos.REPLAY, self._on_measured)
        self._mates = [self]
        if config.bodies_file:
            self._join_bodies(config, loop)

    def _join_bodies(self, config: TwinConfig, profile: QoSProfile) -> None:
        """Build the world of arms and bodies, once the last arm is there."""
        if config.pressures == "measured":
            allowed = "none beside pressures: measured"
            raise ConfigError("parameters of twin", "bodies_file", config.bodies_file, allowed)
        arms = [arm for arm in self._world.arms if isinstance(arm, TwinNode)]
        if not all(arm._mates for arm in arms):
            return
        from soro_core.bodies.files import load_bodies
        from soro_core.twin.bodies import TwinBodies

        several = len(arms) > 1
        names = [arm.get_namespace().rpartition("/")[2] if several else "arm" for arm in arms]
        twins = {name: arm._twin for name, arm in zip(names, arms, strict=True)}
        bodies = load_bodies(config.bodies_file)
        mounts = {name: carrier for name, twin in twins.items() if (carrier := twin.config.mounted_on)}

        def build() -> None:
            self._world.bodies = world = TwinBodies(bodies, twins, [arm.state for arm in arms], mounts)
            for arm, state in zip(arms, world.begins, strict=True):
                arm._mates, arm.state = arms, state

        try:
            self.compile(build)
        except ModelError as error:
            found, _, allowed = str(error).partition("; allowed are ")
            raise ConfigError("scene", "bodies", found, allowed or "a world that can be") from None
        place = arms[0].get_namespace()
        arms[0]._bodies = BodyTopics(
            arms[0],
            place.rpartition("/")[0] if several else place,
            bodies,
            profile,
            config.frames.world,
        )

    def _warm_up(self) -> None:
        """Run one tick without output, which compiles its kernels."""
        twin = Twin(self._robot, self._config)
        state, _ = twin.observe(twin.initial())
        twin.step_setpoints(state, state.air.pressure_pa)

    def start(self) -> None:
        if not self._config.paused:
            self._begin()

    def stop(self) -> None:
        self.is_started = False
        self._release_air()

    def take(self, config: TwinConfig) -> None:
        if not self._is_commanded:
            allowed = "the regulator node's, which drives the valves: set them there"
            raise ConfigError("parameters of twin", "limits", "other limits", allowed)
        self._limiter.narrow(narrowed(self._config.limits, config.limits, "parameters of twin"))

    def teardown(self) -> None:
        for client in (self._valves, self._faults):
            if client is not None:
                client.close()
        self._valves = self._faults = None

    def _on_start(self) -> str:
        if self.state.start_tick is None:
            self.state = replace(self.state, start_tick=self.state.tick)
        if not self.is_started:
            self._begin()
        return "running"

    def _begin(self) -> None:
        self.is_started = True
        if self._config.pressures == "measured":
            return
        if self._lockstep:
            self._world.begin()
            if self._valves is not None:
                # The executor does not watch the socket of the valves; each call waits for one frame.
                self.every(1e-4, self._advance_with_valves)
            else:
                self._advance_with_commands()
        elif all(arm.is_started for arm in self._mates):
            for arm in self._mates:
                arm.join()
                # Time continues at the last tick.
                arm._epoch_ns = self.get_clock().now().nanoseconds - arm._tick_ns()
                arm._skipped = 0
            self._start_s = time.perf_counter() - self.state.tick / self._config.rate_hz
            self.every(1.0 / self._config.rate_hz, self._advance_real_time)

    def join(self) -> None:
        if self._valves is not None:
            self.state = self._valves.join(self.state)

    # Time -----------------------------------------------------------------------------------------
    def _tick_ns(self) -> int:
        return self.state.tick * self._period_ns

    def _now_ns(self) -> int:
        return self._tick_ns() if self._lockstep else time.monotonic_ns()

    def _stamp_now_ns(self) -> int:
        return self._tick_ns() if self._lockstep else self.get_clock().now().nanoseconds

    def _advance_with_valves(self) -> None:
        """Make a tick of the world when the frames of pressures are there, in lockstep."""
        if not self._world.tick() and self._is_over:
            self._release_air()

    def is_due(self) -> bool:
        if not self.is_started or self._over():
            return False
        if self._valves is None:
            answered_ns = self._tick_ns() - self._period_ns
            if self._slewed_ns is None and (answered_ns < 0 or self._chambers.seen_ns >= answered_ns):
                self._begin_tick()  # at once: while other arms are waited for, the next command may come
            return self._slewed_ns is not None
        return self._valves.wait()

    def step(self) -> None:
        if self._valves is None:
            self._end_tick()
        else:
            self.arrive(self._valves.step(self.state))

    def show(self) -> None:
        self._observe()

    def _release_air(self) -> None:
        if self._valves is not None:
            self._valves.release()

    def _advance_with_commands(self) -> None:
        """Lockstep: the command that answers tick k - 1 acts from tick k on."""
        while self._lockstep and self._world.tick():
            pass

    def _over(self) -> bool:
        """Whether time ends: behind `duration_s` as soon as every arm rests with empty chambers."""
        return self._is_over or (self._config.duration_s > 0.0 and self._world.ends())

    @property
    def rests(self) -> bool:
        now_ns = self._tick_ns()
        behind_s = 1e-9 * now_ns - self._config.duration_s
        rests = self._empty_ns is not None and now_ns - self._empty_ns >= 1e9 * REST_S
        return behind_s > -0.5e-9 * self._period_ns and (rests or behind_s >= self._config.empty_s)

    def end(self) -> None:
        self._is_over = True
        self.diagnose()

    def _advance_real_time(self) -> None:
        passed = int((time.perf_counter() - self._start_s) * self._config.rate_hz)
        due = passed - self.state.tick - self._skipped
        mates = self._mates
        if due > CATCH_UP_TICKS:
            for arm in mates:
                arm._skipped += due - CATCH_UP_TICKS
            due = CATCH_UP_TICKS
        seen = [arm._valves.look() for arm in mates if arm._valves is not None]  # each is read
        if not all(seen) or not all(arm.is_started for arm in mates):
            return  # a later call makes up for these ticks
        for _ in range(due):
            self._move()
            for arm in mates:
                arm._observe()
            for arm in mates:
                arm._begin_tick()
            if self._valves is not None:
                self._move()
            else:
                # The nodes of this process answer first: the arm's motion can wait, a command cannot.
                self.after_handover(self._move)

    def _move(self) -> None:
        """Move this arm by a tick if its input has been taken, and beside bodies all of them."""
        if self._world.bodies is None:
            self.step()
        else:
            self._world.move()

    def _on_measured(self, stamp_ns: int, pressure: Array) -> None:
        """Advance to the stamp of measured pressures, with linear interpolation between samples."""
        if not self.is_started:
            return
        if self._measured is None or abs(stamp_ns - self._measured[0]) > GAP_NS:
            self._epoch_ns, self._observed = stamp_ns, -1
            self.state = beginning(self._twin, pressure)
            self._observe()
        else:
            last_ns, last = self._measured
            ways = between(last, pressure, last_ns, stamp_ns, self._period_ns)
            if not ways:
                return
            self._bridged += len(ways) - 1
            # Time is that of the recording, whose period differs a little from the nominal one.
            self._epoch_ns = stamp_ns - (self.state.tick + len(ways)) * self._period_ns
            for way in ways:
                self.arrive(self._twin.step_pressures(self.state, way))
                self._observe()
        self._measured = (stamp_ns, pressure)

    # One tick -------------------------------------------------------------------------------------
    def _begin_tick(self) -> None:
        """Take the input of this tick; later commands are for the next one."""
        if self._valves is not None:
            self._valves.begin()
            return
        self._slewed_ns = self._now_ns()
        self._limiter.slew(self._slewed_ns)

    def _end_tick(self) -> None:
        """Judge the readings and move the arm, once for each tick that has started."""
        if self._slewed_ns is None:
            return
        now_ns, self._slewed_ns = self._slewed_ns, None
        self._limiter.judge(self._reading_pa, True, now_ns)
        self._chambers.report_latch()
        self.arrive(self._twin.step_setpoints(self.state, self._limiter.state.setpoint_pa))

    def arrive(self, state: TwinState) -> None:
        self.state = state
        if not state.status.ok:
            self.is_started = False
            raise ModelError(f"the twin stopped at {self._tick_ns() * 1e-9:.3f} s: {state.status}")

    def _move_base(self, pose: Array) -> None:
        self.state = self._twin.at_base(self.state, pose)

    def _observe(self) -> None:
        """Publish the samples of this tick, once."""
        if self.state.tick == self._observed:
            return
        self._observed = self.state.tick
        self.state = self._twin.at_wrench(self.state, *self._push.now())
        self.state, seen = self._twin.observe(self.state)
        self._reading_pa = seen.reading_pa
        self._empty_ns = empty_since(self._config.limits, self._empty_ns, seen.reading_pa, self._tick_ns())
        stamp_ns = self._epoch_ns + self._tick_ns() + self._skipped * self._period_ns
        self._topics.publish_samples(seen, stamp_ns, self._sample_ns)
        if self._is_commanded:
            self._chambers.publish(seen.reading_pa, stamp_ns)
        self._topics.publish_truth(self.state, seen, stamp_ns)
        if self._bodies is not None and self._world.bodies is not None:
            self._bodies.publish(self._world.bodies.now, stamp_ns)

    def _sample_ns(self, stamp_s: float) -> int:
        return self._epoch_ns + round(stamp_s * 1e9) + self._skipped * self._period_ns

    def diagnose(self) -> None:
        values: dict[str, object] = {
            "tick": self.state.tick,
            "time_s": self._tick_ns() * 1e-9,
            "skipped_ticks": self._skipped,
            **self._push.frames.values,
        }
        if self._config.pressures == "measured":
            values["bridged_ticks"] = self._bridged
        problem = self._chambers.problem if self._is_commanded else None
        level, message = problem or (OK, OVER if self._is_over else "active" if self.is_started else "paused")
        self.diagnostics.update(level, message, values)


def main() -> None:
    """Entry point of `ros2 run soro_ros twin`."""
    namespaces, rest = command_line.namespaces(sys.argv[1:])
    world = ArmWorld()
    arms = [partial(TwinNode, namespace, world) for namespace in namespaces] or [partial(TwinNode)]
    run_nodes(arms, command_line.of_node(TwinNode.node_name, TwinConfig), rest)


if __name__ == "__main__":
    main()
