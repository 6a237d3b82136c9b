"""The exciter node: set points of an excitation, in the place of estimator and controller."""

from __future__ import annotations

import os
from collections import deque

import numpy as np
from sensor_msgs.msg import JointState

from soro_core.errors import SoroError
from soro_core.robot import load_robot
from soro_lab.excitation.motion import Sample
from soro_lab.excitation.procedure import Excitation, ExcitationTick, advance, initial_state, left_s
from soro_lab.scene import ExciterNodeConfig
from soro_lab.scene.excitation import excitation_of
from soro_ros.conversion import messages, qos
from soro_ros.host.services import create_triggers
from soro_ros.process.lifecycle import SoroNode
from soro_ros.process.node_process import run_node
from soro_ros.status_words import REQUESTED
from soro_ros.topics.diagnostics import OK, WARN
from soro_ros.topics.frame_check import FrameCheck
from soro_ros.topics.ports import subscribe
from soro_ros.topics.sample_inputs import SampleInputs


class ExciterNode(SoroNode[ExciterNodeConfig]):
    """Answers each chambers/state with one chambers/command; not enabled, it commands zero.

    Once the excitation is over it commands zero in real time. In lockstep it answers no more, so that the
    time stands still and the recording has the same end every time.
    """

    config_model = ExciterNodeConfig
    node_name = "exciter"

    def setup(self, config: ExciterNodeConfig) -> None:
        robot = load_robot(config.robot)
        self._config, self._lockstep = config, config.mode == "lockstep"
        self._names = robot.chamber_names
        # The limiter distinguishes two programs by this name; in lockstep every run must be the same.
        self._source = self.get_fully_qualified_name() + ("" if self._lockstep else f" #{os.getpid()}")
        self._excitation: Excitation

        def make() -> None:
            self._excitation = excitation_of(config, robot)

        self.compile(make)
        self._enabled, self._answered, self._stop = False, False, ""
        self._epoch_ns: int | None = None
        self._last_ns: int | None = None
        self._t_s, self._samples_seen, self._announced = 0.0, 0, -1
        self._state = initial_state(self._excitation)
        self._readings: deque[int] = deque(maxlen=1000)
        loop, sensor = qos.loop(self._lockstep), qos.sensor(self._lockstep)
        self._command = self.create_publisher(JointState, "chambers/command", loop)
        self._section = self.create_publisher(JointState, "exciter/section", loop)
        self._frames = FrameCheck(config.frames, self.get_logger().warning, self.diagnostics.refuse)
        self._inputs = SampleInputs(config, robot.length, self._seconds, self._process, self._frames)
        subscribe(self, self._inputs.inputs, self._lockstep)
        self.create_subscription(JointState, "chambers/state", self._on_reading, sensor)
        create_triggers(self, {"enable": self._on_enable, "answer": self._on_answer, "vent": self._on_vent})

    # One tick --------------------------------------------------------------------------------------
    def _on_reading(self, message: JointState) -> None:
        # A chamber without a reading is as no message in real time; in lockstep each tick has its answer.
        if not (self._lockstep or np.all(np.isfinite(message.effort))):
            return
        stamp_ns = messages.to_ns(message.header.stamp)
        if not self._lockstep and (odd := self._odd(stamp_ns)):
            line = f"chambers/state refused: {odd}"
            self.get_logger().warning(line, throttle_duration_sec=1.0)
            return
        self._last_ns = stamp_ns
        self._readings.append(stamp_ns)
        self._process(is_reading=True)

    def _odd(self, stamp_ns: int) -> str:
        """Return why a time cannot be that of a reading: taken, all sections would be over at once."""
        if self._last_ns is not None and stamp_ns <= self._last_ns:
            return f"{(self._last_ns - stamp_ns) * 1e-9:.3f} s before the last one"
        return messages.ahead(stamp_ns, int(self.get_clock().now().nanoseconds))

    def _process(self, is_reading: bool = False) -> None:
        if not self._lockstep and not is_reading:
            return  # in real time a sample waits for the next tick
        while self._readings:
            stamp_ns = self._readings[0]
            tick = round(stamp_ns * 1e-9 * self._config.rate_hz)
            if self._lockstep and not self._inputs.complete(tick):
                return
            self._readings.popleft()
            samples = {name: tuple(found) for name, found in self._inputs.due(tick).items() if found}
            self._samples_seen += sum(map(len, samples.values()))
            if self._enabled:
                self._advance(stamp_ns, samples)
            else:
                self._publish(np.zeros(len(self._names)), stamp_ns)

    def _advance(self, stamp_ns: int, samples: dict[str, tuple[Sample, ...]]) -> None:
        if self._epoch_ns is None:
            self._epoch_ns = stamp_ns
            if stamp_ns:  # the samples that came before have the time of another epoch
                samples = {}
        self._t_s = self._seconds(stamp_ns)
        answered, self._answered = self._answered, False
        tick = ExcitationTick(self._t_s, samples, answered, self._stop)
        self._state = state = advance(self._excitation, self._state, tick)
        self._announce(stamp_ns)
        if state.phase != "over" or not self._lockstep:
            self._publish(state.setpoint_pa, stamp_ns)

    def _announce(self, stamp_ns: int) -> None:
        """Publish the name of a section when it begins, and the end."""
        state, sections = self._state, self._excitation.plan.sections
        number = state.index if state.phase == "running" else len(sections) + (state.phase == "over")
        if number == self._announced:
            return
        self._announced = number
        if state.phase == "running":
            section = sections[number]
            stage, name = section.stage, section.name
        else:
            stage, name = state.phase, state.reason
        message = JointState(name=[f"{stage}: {name}" if name else stage], position=[float(number)])
        message.header.stamp, message.header.frame_id = messages.to_time(stamp_ns), stage
        self._section.publish(message)
        self.diagnostics.update(WARN if state.reason else OK, message.name[0], self._values())

    def _publish(self, setpoint_pa: np.ndarray, stamp_ns: int) -> None:
        message = messages.chambers(self._names, setpoint_pa, stamp_ns)
        message.header.frame_id = self._source
        self._command.publish(message)

    def _seconds(self, stamp_ns: int) -> float:
        return (stamp_ns - (self._epoch_ns or 0)) * 1e-9

    def _values(self) -> dict[str, object]:
        state, sections = self._state, self._excitation.plan.sections
        asks = sections[state.index].asks if state.phase == "running" and self._enabled else ""
        return {
            "phase": state.phase,
            "reason": state.reason,
            "asks": asks,
            "section": state.index,
            "sections": len(sections),
            "time_s": self._t_s,
            "left_s": left_s(self._excitation, state, self._t_s),
            "not_still": state.restless,
            "samples": self._samples_seen,
            **self._frames.values,
        }

    def diagnose(self) -> None:
        self.diagnostics.update(self.diagnostics.level, self.diagnostics.message, self._values())

    # Services --------------------------------------------------------------------------------------
    def _on_enable(self) -> str:
        """Begin; in real time only with samples of the arm."""
        if not (self._lockstep or self._samples_seen):
            without = ("no sample of a sensor on the arm has come", self._frames.refusal)
            raise SoroError("; ".join(filter(None, without)))
        self._enabled = True
        return "enabled"

    def _on_answer(self) -> str:
        """Take a person's answer."""
        self._answered = True
        return "taken"

    def _on_vent(self) -> str:
        """End the excitation."""
        self._stop = REQUESTED
        if not self._lockstep:
            # Where readings have ended none asks for a command, and a reset needs a last one of zero.
            self._publish(np.zeros(len(self._names)), int(self.get_clock().now().nanoseconds))
        return "commanding zero"


def main() -> None:
    """Entry point of `ros2 run soro_ros exciter`."""
    run_node(ExciterNode)


if __name__ == "__main__":
    main()
