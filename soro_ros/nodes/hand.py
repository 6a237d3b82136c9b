"""The hand node: it asks the controllers of its fingers for shapes, and says how its grasp goes."""

from __future__ import annotations

from functools import partial

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from soro_core.arrays import Array
from soro_core.errors import ConfigError, SoroError
from soro_core.grasping import Felt, Hand, SqueezeState
from soro_core.grasping.settings import HandKeys
from soro_core.model import SoftArm
from soro_core.model.discretised import discretised
from soro_core.robot import load_robot
from soro_lab.scene import HandNodeConfig
from soro_ros.conversion import messages, qos
from soro_ros.host.services import create_triggers
from soro_ros.process.lifecycle import SoroNode
from soro_ros.process.node_process import run_node
from soro_ros.topics.diagnostics import OK, WARN
from soro_ros.topics.motion_job import GRASP, LOST, VENTED

STATE = "hand/state"
# Period of the law [s], below the time constant of its filter: the models of the fingers take milliseconds.
_PERIOD_S = 0.02
# Time between two reports of progress [s], and change of pressure that is asked for at once [Pa].
_REPORT_S, _CHANGED_PA = 0.1, 1.0
_WORDS = {
    "open": "open",
    "closing": "closes until each finger touches",
    "touching": "closes until each finger touches",
    "squeezing": "squeezes",
    "holding": "holds",
    "slipping": "the object slips: squeezes harder",
    "opening": "opens",
}


class HandNode(SoroNode[HandNodeConfig]):
    """Runs the law of a squeeze; in lockstep it answers each tick, because the controllers wait for it."""

    config_model = HandNodeConfig
    node_name = "hand"
    hardware = "robots"
    live = ("squeeze.",)

    def setup(self, config: HandNodeConfig) -> None:
        names, files = config.fingers, config.robots
        if len(files) not in (1, len(names)):
            raise ConfigError("parameters of hand", "robots", list(files), f"one file, or {len(names)}")
        self._config, self._lockstep = config, config.mode == "lockstep"
        robots = [load_robot(file) for file in (files if len(files) > 1 else files * len(names))]
        self._chambers = [robot.chamber_names for robot in robots]
        self._hand: Hand
        self._carrier: SoftArm | None = None

        def make() -> None:
            self._hand = Hand(robots, config.model, _keys(config))
            if config.carrier:
                self._carrier = discretised(load_robot(config.carrier_robot), config.carrier_model)

        self.compile(make)
        self._coordinates = [one.arm.robot.coordinate_names for one in self._hand.squeeze.fingers]
        self._is_active, self._closes, self._closes_itself = False, False, config.close_at_s > 0.0
        self._state, self._t_s = self._hand.squeeze.initial_state(), 0.0
        self._asked_pa: Array | None = None
        self._reported, self._reported_s = ("open", _WORDS["open"]), -np.inf
        self._seen: dict[str, JointState | PoseStamped] = {}
        self._waiting: dict[int, dict[str, JointState | PoseStamped]] = {}
        self._in_control_ns = dict.fromkeys(names, -1)
        self._stepped_ns = self._law_ns = -1
        # Time counts from the first tick with control; in lockstep that would depend on the order of arrival.
        self._epoch_ns: int | None = 0 if self._lockstep else None
        self._palm = f"{config.carrier}/arm/state"
        self._of_fingers = [f"{name}/{topic}" for name in names for topic in ("arm/state", "chambers/state")]
        self._sources = list(self._of_fingers)
        sensor = qos.sensor(self._lockstep)
        if config.carrier:
            self._sources.append(self._palm)
        for source in self._sources:
            quality = qos.loop(self._lockstep) if source.endswith("arm/state") else sensor
            self.create_subscription(JointState, source, partial(self._on_message, source), quality)
        if config.tracked:
            self._sources.append(config.tracked)
            self.create_subscription(
                PoseStamped, config.tracked, partial(self._on_message, config.tracked), sensor
            )
        for name in names:
            self.create_subscription(
                PoseStamped, f"{name}/arm/desired/tip", partial(self._on_desired, name), qos.RELIABLE
            )
        self._asks = [
            self.create_publisher(
                JointTrajectory, f"{name}/arm/reference/trajectory", qos.loop(self._lockstep)
            )
            for name in names
        ]
        self._grasp = self.create_publisher(DiagnosticStatus, GRASP, qos.RELIABLE)
        self._felt = self.create_publisher(JointState, STATE, qos.RELIABLE)
        create_triggers(self, {"close": self._on_close, "open": self._on_open})

    def start(self) -> None:
        self._is_active = True

    def stop(self) -> None:
        self._open_at_once()
        self._is_active = False

    def take(self, config: HandNodeConfig) -> None:
        self._hand = self._hand.retuned(_keys(config))
        self._config = config

    @property
    def _missing(self) -> list[str]:
        """Topics on which nothing has come."""
        return [one for one in self._sources if one not in self._seen]

    # Inputs ----------------------------------------------------------------------------------------
    def _on_desired(self, name: str, message: PoseStamped) -> None:
        self._in_control_ns[name] = messages.to_ns(message.header.stamp)

    def _on_message(self, source: str, message: JointState | PoseStamped) -> None:
        """Make a tick once each finger has newer messages; in lockstep those of one time, of every source."""
        if not self._is_active:
            return
        stamp_ns = messages.to_ns(message.header.stamp)
        if self._lockstep:
            # The twin may be a tick ahead of the estimators.
            together = self._waiting.setdefault(stamp_ns, {})
            together[source] = message
            if len(together) < len(self._sources):
                return
            self._seen = self._waiting.pop(stamp_ns)
            self._waiting = {ns: one for ns, one in self._waiting.items() if ns > stamp_ns}
        else:
            self._seen[source] = message
            # A tracker that is silent must not keep the hand from opening.
            fingers = [self._seen[one] for one in self._of_fingers if one in self._seen]
            stamps = [messages.to_ns(one.header.stamp) for one in fingers]
            if len(stamps) < len(self._of_fingers) or min(stamps) <= self._stepped_ns <= max(stamps):
                return
            stamp_ns = max(stamps)
        if stamp_ns < self._stepped_ns:
            self._take_clock(stamp_ns)
        self._stepped_ns = stamp_ns
        dt = 1e-9 * (stamp_ns - self._law_ns)
        if dt >= _PERIOD_S - 1e-6:
            self._law_ns = stamp_ns
            self._tick(stamp_ns, dt)
        elif self._lockstep:
            self._ask(stamp_ns)

    def _take_clock(self, now_ns: int) -> None:
        """Go on from the time of a clock that has been set back."""
        back_ns, self._stepped_ns = self._stepped_ns - now_ns, now_ns
        self._law_ns -= back_ns
        if self._epoch_ns is not None and not self._lockstep:
            self._epoch_ns -= back_ns
        self._in_control_ns = {name: min(at_ns, now_ns) for name, at_ns in self._in_control_ns.items()}
        self._reported_s = -np.inf

    def _felt_now(self, stamp_ns: int) -> Felt | None:
        """What is measured; None where a finger has no estimate."""
        shapes: list[Array | None] = []
        pressures: list[Array] = []
        for name, chambers, coordinates in zip(
            self._config.fingers, self._chambers, self._coordinates, strict=True
        ):
            state = self._seen[f"{name}/arm/state"]
            if tuple(state.name) != tuple(coordinates) or not messages.is_possible(state.position):
                return None
            try:
                pressures.append(messages.pressures(self._seen[f"{name}/chambers/state"], chambers))
            except ValueError:
                return None
            shapes.append(None if self._config.by_pressure else np.array(state.position))
        if not np.isfinite(pressures).all():
            return None
        place = self._object(stamp_ns)
        if self._carrier is None:
            return Felt(pressures, shapes, None if place is None else float(place[2]))
        palm = self._palm_pose(self._carrier, stamp_ns)
        if palm is None:
            return Felt(pressures, shapes)
        turn, up = palm[:3, :3], self._hand.squeeze.fingers[0].up
        height = None if place is None else float(up @ turn.T @ (place - palm[:3, 3]))
        return Felt(pressures, shapes, height, turn.T @ self._carrier.robot.gravity)

    def _palm_pose(self, carrier: SoftArm, stamp_ns: int) -> Array | None:
        """Pose of the tip that carries the hand (4, 4); None where nothing estimates it of late."""
        seen = self._seen.get(self._palm)
        if not isinstance(seen, JointState) or tuple(seen.name) != carrier.robot.coordinate_names:
            return None
        if not messages.is_possible(seen.position) or not self._is_new(seen.header.stamp, stamp_ns):
            return None
        return carrier.pose(np.array(seen.position), carrier.length)

    def _is_new(self, stamp: Time, now_ns: int) -> bool:
        return 1e-9 * abs(now_ns - messages.to_ns(stamp)) < self._config.state_age_s

    def _object(self, stamp_ns: int) -> Array | None:
        """Place of the object in the world (3,) [m]; None where nothing tracks it of late."""
        seen = self._seen.get(self._config.tracked)
        if not isinstance(seen, PoseStamped) or not messages.is_pose(seen.pose):
            return None
        return messages.pose_arrays(seen.pose)[0] if self._is_new(seen.header.stamp, stamp_ns) else None

    # One tick --------------------------------------------------------------------------------------
    def _tick(self, stamp_ns: int, dt: float) -> None:
        felt, without = self._felt_now(stamp_ns), self._without_control(stamp_ns)
        if self._epoch_ns is None and not without:
            self._epoch_ns = stamp_ns
        self._t_s = 0.0 if self._epoch_ns is None else 1e-9 * (stamp_ns - self._epoch_ns)
        if without and self._state.phase != "open":
            # Who vents a finger takes its pressure: what the hand asks for counts no more.
            self._closes, self._state = False, self._hand.squeeze.initial_state()
            self._report(VENTED, f"{without} is not in control: the hand opens", WARN)
        elif felt is not None and not without and dt < self._config.state_age_s:
            is_due = self._closes_itself and self._t_s >= self._config.close_at_s
            if is_due and not self._missing:
                self._closes_itself, self._closes = False, True
            before = self._state
            self._state = self._hand.squeeze.step(before, felt, self._closes, dt)
            self._judge(before, felt.height_m)
        if self._felt.get_subscription_count() or self._lockstep:
            self._felt.publish(self._state_message(stamp_ns))
        self._ask(stamp_ns)

    def _without_control(self, stamp_ns: int) -> str:
        """Return a finger whose controller is not in control; empty where all are."""
        oldest_ns = max(stamp_ns - round(1e9 * self._config.state_age_s), 0)
        return next((name for name, at_ns in self._in_control_ns.items() if at_ns < oldest_ns), "")

    def _judge(self, before: SqueezeState, height_m: float | None) -> None:
        """Report how the grasp goes."""
        state, limit_n = self._state, self._hand.keys.squeeze.limit_n
        if state.cause and not before.cause:
            self._closes = False
            self._report(LOST, f"{state.cause}: opens", WARN)
            return
        words, level = _WORDS[state.phase], WARN if state.phase == "slipping" else OK
        if state.phase not in ("open", "opening") and state.most_n >= limit_n:
            words, level = f"{words}, at the crush limit: {1e3 * limit_n:g} mN", WARN
        if self._config.tracked and height_m is None and state.phase != "open":
            words, level = f"{words}; nothing tracks the object", WARN
        is_due = state.phase != "open" and self._t_s >= self._reported_s + _REPORT_S
        if is_due or (state.phase, words) != self._reported:
            self._report(state.phase, words, level)

    def _report(self, name: str, words: str, level: bytes) -> None:
        state, is_new = self._state, (name, words) != self._reported
        self._reported, self._reported_s = (name, words), self._t_s
        values = {
            "force_n": f"{state.force_n.mean():.5f}",
            "most_n": f"{state.most_n:.5f}",
            "goal_n": f"{state.goal_n:.5f}",
            "pressure_pa": f"{state.level_pa.max():.0f}",
        }
        pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
        self._grasp.publish(DiagnosticStatus(level=level, name=name, message=words, values=pairs))
        if is_new:
            self.get_logger().info(f"{name}: {words}")
            self.diagnostics.update(level, words)
            if level != OK:
                self.event_log.note(name, words)

    def _state_message(self, stamp_ns: int) -> JointState:
        """Force [N] and pressure [Pa] of each finger."""
        state = self._state
        message = JointState(name=self._config.fingers)
        message.position, message.effort = state.force_n.tolist(), state.level_pa.tolist()
        message.header.stamp = messages.to_time(stamp_ns)
        return message

    def _ask(self, stamp_ns: int) -> None:
        """Ask each finger whose pressure has changed for its shape; in lockstep the others for nothing."""
        state = self._state
        if state.phase == "open" and not state.level_pa.any() and self._asked_pa is None:
            changed = np.zeros(len(self._asks), dtype=bool)
        else:
            asked = np.full(len(self._asks), np.inf) if self._asked_pa is None else self._asked_pa
            changed = np.abs(state.level_pa - asked) > _CHANGED_PA
            self._asked_pa = np.where(changed, state.level_pa, asked)
        shapes = self._hand.shapes(state) if changed.any() else []
        for k, publisher in enumerate(self._asks):
            message = JointTrajectory()
            message.header.stamp = messages.to_time(stamp_ns)
            if changed[k]:
                message.joint_names = self._coordinates[k]
                message.points = [JointTrajectoryPoint(positions=shapes[k].tolist())]
            if changed[k] or self._lockstep:
                publisher.publish(message)

    def diagnose(self) -> None:
        if self._state.phase != "open" and not self._lockstep:
            now_ns = self.get_clock().now().nanoseconds
            age_s = 1e-9 * (now_ns - self._stepped_ns)
            if age_s < -self._config.state_age_s:
                self._take_clock(now_ns)
            elif age_s > max(self._config.state_age_s, 1.0):
                self._open_at_once()
                self._report(LOST, f"nothing is measured for {age_s:.1f} s: the hand opens", WARN)
        values: dict[str, object] = {"phase": self._state.phase, "force_n": float(self._state.force_n.mean())}
        self.diagnostics.update(self.diagnostics.level, self.diagnostics.message, values)

    def _open_at_once(self) -> None:
        """Ask closed fingers for their open shapes; in lockstep the run ends with the hand."""
        self._closes = False
        if self._state.phase != "open" and not self._lockstep:
            self._state = self._hand.squeeze.initial_state()
            self._ask(self.get_clock().now().nanoseconds)

    # Services --------------------------------------------------------------------------------------
    def _on_close(self) -> str:
        """Close, squeeze, and hold from then on."""
        if not self._is_active:
            raise SoroError("the hand is inactive: activate it")
        if self._stepped_ns < 0 or self._missing:
            raise SoroError(f"nothing has come on {', '.join(self._missing) or 'all topics at once'}")
        if without := self._without_control(self._stepped_ns):
            raise SoroError(f"{without} is not in control: soro enable")
        self._closes, self._closes_itself = True, False
        return "closes"

    def _on_open(self) -> str:
        """Open the hand; one that is open says so, or why it is, because who asks waits for a report."""
        self._closes = self._closes_itself = False
        if self._is_active and self._state.phase == "open":
            if without := self._without_control(self._stepped_ns):
                self._report(VENTED, f"{without} is not in control: the hand is open", WARN)
            else:
                self._report("open", _WORDS["open"], OK)
        return "opens"


def _keys(config: HandNodeConfig) -> HandKeys:
    return HandKeys(**{name: getattr(config, name) for name in HandKeys.model_fields})


def main() -> None:
    """Entry point of `ros2 run soro_ros hand`."""
    run_node(HandNode)


if __name__ == "__main__":
    main()
