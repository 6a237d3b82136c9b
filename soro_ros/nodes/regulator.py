"""The driver node: it sends limited set points to the pressure regulators and publishes readings."""

from __future__ import annotations

import contextlib
import os
import time
from collections import deque
from functools import partial

from rosgraph_msgs.msg import Clock

from soro_core.errors import ConfigError, SoroError
from soro_core.safety import narrowed
from soro_hardware import Regulator, load_platform, open_regulator
from soro_hardware.limited_regulator import LimitedRegulator
from soro_hardware.timing import LoopTimer
from soro_lab.scene import RegulatorNodeConfig
from soro_ros.conversion import messages, qos
from soro_ros.host import claims
from soro_ros.host.latch_file import LatchFile
from soro_ros.process.lifecycle import SoroNode
from soro_ros.process.node_process import run_node
from soro_ros.topics.chambers import ChamberInterface
from soro_ros.topics.diagnostics import OK, WARN
from soro_ros.topics.stop_topic import StopTopic

# Cause of a regular vent, which the next process does not need to know.
DEACTIVATED = "deactivated"
# Note for the next process if this one is killed.
_KILLED = "the last driver, process {}, ended without venting"


class RegulatorNode(SoroNode[RegulatorNodeConfig]):
    """Exchanges with the regulators at a fixed rate, or once a tick of /clock in lockstep."""

    config_model = RegulatorNodeConfig
    node_name = "regulator"
    hardware = "device"
    live = ("limits.",)

    def __init__(self) -> None:
        self._regulator: Regulator | None = None
        self._limited: LimitedRegulator | None = None
        self._left: str | None = None
        """Cause of the vent at the end of the previous configuration."""
        self._latch_file: LatchFile | None = None
        self._stop: StopTopic | None = None
        super().__init__()

    def claims(self) -> tuple[str, ...]:
        namespace = self.get_namespace().rstrip("/")
        arms: tuple[str, ...] = ()
        with contextlib.suppress(SoroError):  # `setup` says what is wrong with the platform
            arms = load_platform(self.get_parameter_or("platform").value).arms
        named = [f"{namespace}/{arm}" for arm in arms] or [namespace]
        return (*super().claims(), *map(claims.readings, named))

    def setup(self, config: RegulatorNodeConfig) -> None:
        platform = load_platform(config.platform).at_rate(config.rate_hz)
        if not (config.device or platform.device):
            emulator = f"`soro emulate {config.platform}`"
            allowed = f"the path or address of the devices, or the one that {emulator} prints"
            raise ConfigError("parameters of regulator", "device", "", allowed)
        self._config, self._lockstep = config, config.mode == "lockstep"
        self.diagnostics.hardware_id = config.device or str(platform.device)
        self._period_ns = round(1e9 / config.rate_hz)
        self._limited, self._latch_file = None, None
        self._tick_ns: int | None = None
        self._due: deque[int] = deque()  # ticks that wait for their commands [ns]
        self._last_tick_wall = time.monotonic()
        self._regulator = regulator = open_regulator(platform, config.device or None, lockstep=self._lockstep)
        self._stop = StopTopic(self, platform) if platform.stop_topic else None
        self.get_logger().info(f"configuring {regulator.n_chambers} regulators of {config.platform}")
        regulator.configure()
        limited = LimitedRegulator(platform, regulator, config.limits, "parameters of regulator")
        if self._stop is not None:
            limited.why_stopped = self._stop.why_stopped
        self._active = False
        self._timer = LoopTimer(1.0 / config.rate_hz)
        # Number of refused commands at the last report.
        self._reported = 0
        self._chambers = ChamberInterface(
            self,
            limited,
            self._now_ns,
            self._stamp_ns,
            self._try_tick,
            partial(self._on_latch, limited),
            self._lockstep,
            self.diagnose,
            config.follow_shared_name,
            self.diagnostics.hardware_id,
            self.event_log.note,
        )
        if self._lockstep:
            self.create_subscription(Clock, "/clock", self._on_clock, qos.LOCKSTEP)
        if config.keep_latch and not self._lockstep:
            self._latch_file = LatchFile(config.device or str(platform.device))
            found = self._latch_file.cause()
            if config.take_over and found:
                self.event_log.note("reset", f"take_over, in spite of: {found}")
            self._left = self._left or (None if config.take_over else found)
        self._limited = limited
        if self._left is None:
            self._note(_KILLED.format(os.getpid()))
        else:
            limited.latch(self._left)  # the start-up has brought the devices to 0 Pa
            self._chambers.report_latch()

    def start(self) -> None:
        if self._stop is not None:
            self._stop.wait()
        self._due.clear()
        self._active = True
        if self._limited is not None:
            self._limited.begin_anew()
        if self._lockstep:
            self._last_tick_wall = time.monotonic()
            self.every(0.5, self._check_stall)
        else:
            self.every(1.0 / self._config.rate_hz, self._cycle)

    def stop(self) -> None:
        self._active = False
        # The latch stays closed: after the next activation ~/reset opens it.
        self._vent(DEACTIVATED)

    def take(self, config: RegulatorNodeConfig) -> None:
        if self._limited is not None:
            self._limited.narrow(narrowed(self._config.limits, config.limits, "parameters of regulator"))

    def teardown(self) -> None:
        self.make_safe()

    def make_safe(self) -> None:
        """Vent and shut the devices down over the bus; ROS is not needed for it."""
        regulator, self._regulator = self._regulator, None
        if regulator is not None:
            try:
                regulator.vent()
            finally:
                regulator.close()
        if self._limited is not None:  # None after a failed start-up
            cause = self._limited.state.causes
            self._left = None if cause == DEACTIVATED else cause
            self._note(self._left)
        self.diagnose()  # the last report has the final counts
        self._limited = None

    def _vent(self, cause: str) -> None:
        if self._limited is not None:
            self._limited.vent(cause)
            self._chambers.report_latch()

    def _now_ns(self) -> int:
        if self._lockstep:
            return self._tick_ns or 0
        return time.monotonic_ns()

    def _stamp_ns(self) -> int:
        return self._now_ns() if self._lockstep else self.get_clock().now().nanoseconds

    # Lockstep: tick k needs the command that answers tick k - 1 ------------------------------------
    def _on_clock(self, message: Clock) -> None:
        if not self._active:
            return
        self._due.append(messages.to_ns(message.clock))
        self._last_tick_wall = time.monotonic()
        self._try_tick()

    def _try_tick(self) -> None:
        # A vent between two cycles is a tick too: then two of them are due, and each has its readings.
        while self._lockstep and self._active and self._due:
            self._tick_ns = self._due[0]
            if self._tick_ns > 0 and self._chambers.seen_ns < self._tick_ns - self._period_ns:
                return
            self._due.popleft()
            self._cycle()

    def _check_stall(self) -> None:
        silent = time.monotonic() - self._last_tick_wall
        # Only once: each vent is a tick of emulated devices.
        if silent > self._config.lockstep_timeout_s and self._limited and not self._limited.state.vented:
            self._vent(f"lockstep stalled: no tick or command for {silent:.0f} s")

    # One cycle ------------------------------------------------------------------------------------
    def _cycle(self) -> None:
        if self._limited is None:
            return
        self._timer.tick()
        stamp_ns, now_ns = self._stamp_ns(), self._now_ns()
        exchange = self._limited.cycle(now_ns)
        self._chambers.report_latch()
        if exchange is None:
            return
        readings = self._limited.readings_pa(exchange, now_ns, every_cycle=self._lockstep)
        if readings is not None:
            self._chambers.publish(readings, stamp_ns)

    def _note(self, cause: str | None) -> None:
        """Write the cause of a vent for the next process; None removes the note."""
        if self._latch_file is None:
            return
        try:
            if cause is None:
                self._latch_file.clear()
            else:
                self._latch_file.write(cause)
        except OSError as error:
            self.get_logger().warning(f"no note of the latch for the next driver: {error}", once=True)

    def _on_latch(self, limited: LimitedRegulator) -> None:
        self._note(limited.state.causes or _KILLED.format(os.getpid()))
        self.diagnose()

    def diagnose(self) -> None:
        if self._limited is None:
            return
        rejected = sum(self._limited.state.rejected.values())
        recently, self._reported = rejected > self._reported, rejected
        usual = (WARN, "commands refused") if recently else (OK, "active")
        level, message = self._chambers.problem or usual
        self.diagnostics.update(level, message, self._values(self._limited))

    def _values(self, limited: LimitedRegulator) -> dict[str, object]:
        state, statistics = limited.state, limited.regulator.statistics
        return {
            **vars(statistics),
            "lateness_p50_ms": self._timer.percentile_ms(50),
            "lateness_p99_ms": self._timer.percentile_ms(99),
            "overruns": self._timer.overruns,
            "cause": state.cause or "",
            "not_vented": state.not_vented or "",
            **{f"rejected {kind}": count for kind, count in state.rejected.items()},
        }


def main() -> None:
    """Entry point of `ros2 run soro_ros regulator`."""
    run_node(RegulatorNode)


if __name__ == "__main__":
    main()
