"""The controller node: each message on arm/state gives one on chambers/command."""

from __future__ import annotations

import os
import re
from functools import partial

from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import JointState

from soro_core.config import with_changes
from soro_core.control import Controller, ControllerState
from soro_core.control.motion_config import MotionConfig
from soro_core.errors import SoroError
from soro_lab.scene import ControllerNodeConfig
from soro_ros.conversion import messages, qos
from soro_ros.host.services import create_triggers
from soro_ros.process.lifecycle import SoroNode
from soro_ros.process.node_process import run_node
from soro_ros.status_words import NO_COMMAND
from soro_ros.ticks.controller_ticks import ControllerTicks
from soro_ros.ticks.enable_check import EnableCheck
from soro_ros.topics.diagnostics import ERROR, OK, WARN
from soro_ros.topics.motion_job import REPLACED, STATUS, VENTED
from soro_ros.topics.ports import Input, NodeOutputs, Publishers, subscribe

_NUMBER = re.compile(r"[\d.]+")


class ControllerNode(SoroNode[ControllerNodeConfig]):
    """Gives the law its messages, and enables it after checks."""

    config_model = ControllerNodeConfig
    node_name = "controller"
    live = ("control.", "limits.")

    def setup(self, config: ControllerNodeConfig) -> None:
        self._logged = ""
        lockstep = config.mode == "lockstep"
        # The limiter distinguishes two controllers by this name; in lockstep every run must be the same.
        source = self.get_fully_qualified_name() + ("" if lockstep else f" #{os.getpid()}")
        loop = qos.loop(lockstep)
        outputs = {
            topic: (kind, qos.RELIABLE if topic == STATUS else loop)
            for topic, kind in ControllerTicks.outputs.items()
        }
        publishers = Publishers(self, outputs)
        ports = NodeOutputs(
            publishers.publish,
            lambda: int(self.get_clock().now().nanoseconds),
            self.get_logger().warning,
            self._report,
            self._refuse,
            publishers.is_read,
            fail=self._fail,
        )
        self._ticks = ControllerTicks(_with_probe(config), source, ports, self._motion)
        self._check = EnableCheck(
            self, self.controller, config, lambda: self._ticks.is_probing, self._ticks.note_pose
        )
        inputs = dict(self._ticks.inputs)
        inputs |= {
            "chambers/state": Input(JointState, self._on_reading, qos.sensor),
            "arm/state": Input(JointState, self._on_state, qos.loop),
        }
        subscribe(self, inputs, lockstep)
        self._is_vented = False
        self.create_subscription(DiagnosticStatus, "chambers/latch", self._on_latch, qos.LATCHED)
        actions = {"enable": partial(self._enable, False), "enable_anyway": partial(self._enable, True)}
        create_triggers(self, {**actions, "vent": self._on_vent, "reset": self._on_reset})
        self.compile(self._warm_up)

    @property
    def controller(self) -> Controller:
        """The law with its reference."""
        return self._ticks.controller

    @property
    def state(self) -> ControllerState:
        """State of the controller after the last tick."""
        return self._ticks.state

    def take(self, config: ControllerNodeConfig) -> None:
        """Go on with other gains, adaptation, reference or narrower limits, from the state of now."""
        self._ticks.retune(_with_probe(config))

    def stop(self) -> None:
        self._ticks.clear()

    def _warm_up(self) -> None:
        self._ticks.warm_up()
        self._check.warm_up()

    # The check sees what the law sees ----------------------------------------------------------------
    def _on_reading(self, message: JointState) -> None:
        try:
            self._check.note_reading(messages.pressures(message, self.controller.robot.chamber_names))
        except ValueError:
            return  # the estimator reports it
        self._ticks.inputs["chambers/state"].take(message)

    def _on_state(self, message: JointState) -> None:
        self._check.note_state(message)
        self._ticks.inputs["arm/state"].take(message)

    def _on_latch(self, message: DiagnosticStatus) -> None:
        self._is_vented = message.level == ERROR

    # Parameters and reports --------------------------------------------------------------------------
    def _motion(self) -> MotionConfig:
        """The section `motion` with what the parameters say now."""
        names = MotionConfig.model_fields
        return MotionConfig(**{name: self.get_parameter(f"control.motion.{name}").value for name in names})

    def _refuse(self, reason: str, repeated: bool) -> None:
        if repeated:  # limit the log of a repeated reference
            self.get_logger().error(reason, throttle_duration_sec=1.0)
        else:
            self.get_logger().error(reason)

    def _fail(self, reason: str) -> None:
        """Say why the probe before control has refused; commands are zero until the next ~/enable."""
        self.get_logger().error(reason)
        self.event_log.note("refused", reason)
        self._ticks.motions.forget(VENTED, "commanding zero until ~/enable")
        self.diagnostics.update(ERROR, reason)

    def _report(self, problems: str) -> None:
        self.diagnostics.update(WARN if problems else OK, problems or "active")
        kind = _NUMBER.sub("", problems)
        if problems.startswith(NO_COMMAND) and kind != self._logged:  # not each age of a late state
            self._logged = kind
            self.get_logger().warning(problems)

    def diagnose(self) -> None:
        counts: dict[str, object] = {"refused": self.state.watch.refused}
        counts |= {"refused references": self._ticks.refusals, **self.controller.law.counts(self.state.law)}
        self.diagnostics.update(self.diagnostics.level, self.diagnostics.message, counts)

    # Services --------------------------------------------------------------------------------------
    def _enable(self, anyway: bool) -> str:
        """Start the commands; an arm that is in control already is not checked, except for a closed latch."""
        if self._is_vented:  # the probe would find no pressure, and blame a valve
            raise SoroError("the arm is vented: soro reset first")
        warnings: list[str] = []
        if not self._ticks.enabled:
            refusals, warnings = self._check.findings(anyway, self._ticks.stay_at_zero)
            for line in (*refusals, *warnings):
                self.get_logger().warning(f"enable: {line}")
            if refusals:
                raise SoroError("; ".join(refusals))
            self._ticks.forget(anyway)
            self._report("")
        self._ticks.enabled = True
        return "; ".join(["enabled", *warnings])

    def _on_vent(self) -> str:
        self._ticks.enabled = False
        self._ticks.motions.forget(VENTED, "commanding zero until ~/enable")
        # Where readings have ended no state asks for a command, and a reset needs a last one of zero.
        self._ticks.stay_at_zero()
        return "commanding zero until ~/enable"

    def _on_reset(self) -> str:
        self.event_log.note("reset", "estimates and reference start anew")
        self._ticks.forget()
        self._ticks.motions.forget(REPLACED, "estimates and reference start anew")
        return "estimates and reference start anew"


def _with_probe(config: ControllerNodeConfig) -> ControllerNodeConfig:
    """Return the keys with what `auto` says of the probe in real time."""
    if config.mode == "lockstep" or config.control.probe_at_enable != "auto":
        return config
    return with_changes(config, control=with_changes(config.control, probe_at_enable="refuse"))


def main() -> None:
    """Entry point of `ros2 run soro_ros controller`."""
    run_node(ControllerNode)


if __name__ == "__main__":
    main()
