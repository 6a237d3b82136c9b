"""The driver node: set points to the pressure regulators, readings back, nothing past the limiter."""

from __future__ import annotations

import os
import time

import numpy as np
from rosgraph_msgs.msg import Clock

from soro_core.errors import ConfigError, HardwareError
from soro_core.hardware import Regulator, load_platform, open_regulator
from soro_core.hardware.platform import IN_TURN, watched
from soro_core.scene import RegulatorNodeConfig
from soro_ros import messages, qos
from soro_ros.chambers import ChamberInterface
from soro_ros.diagnostics import ERROR, OK, WARN
from soro_ros.latch_file import LatchFile
from soro_ros.lifecycle import SoroNode, run_node
from soro_ros.timing import LoopTimer

# A vent that somebody asks for in order, and that the next process need not hear of.
DEACTIVATED = "deactivated"
# What the next process finds where this one could not say anything any more.
_KILLED = "the last driver, process {}, ended without venting"


class RegulatorNode(SoroNode[RegulatorNodeConfig]):
    """Exchanges with the regulators at a fixed rate, or once a tick of /clock in lockstep."""

    config_model = RegulatorNodeConfig
    node_name = "regulator"

    def __init__(self) -> None:
        self._regulator: Regulator | None = None
        self._left: str | None = None
        """Cause of a vent that the configuration before this one ended with."""
        self._latch_file: LatchFile | None = None
        super().__init__()

    def setup(self, config: RegulatorNodeConfig) -> None:
        platform = load_platform(config.platform).at_rate(config.rate_hz)
        if not (config.device or platform.device):
            emulator = f"`soro emulate {config.platform}`"
            allowed = f"the path or address of the devices, or the one that {emulator} prints"
            raise ConfigError("parameters of regulator", "device", "", allowed)
        self._config, self._lockstep = config, config.mode == "lockstep"
        self._period_ns = round(1e9 / config.rate_hz)
        self._latch_file, self._tick_ns = None, None
        self._last_tick_wall = time.monotonic()
        self._regulator = open_regulator(platform, config.device or None, lockstep=self._lockstep)
        self.get_logger().info(f"configuring {self._regulator.n_chambers} regulators of {config.platform}")
        self._regulator.configure()
        limits, response = watched(platform, self._regulator, config.limits, config.rate_hz, config.platform)
        # Chambers that were not sampled are carried on: who controls the arm has one reading a cycle.
        self._in_turn = self._regulator.update_hz < IN_TURN * config.rate_hz
        self._chambers = ChamberInterface(
            self,
            self._regulator.chamber_names,
            limits,
            self._now_ns,
            self._stamp_ns,
            self._try_tick,
            self._recover,
            self._lockstep,
            response,
            platform.rating,
        )
        if self._lockstep:
            self.create_subscription(Clock, "/clock", self._on_clock, qos.LOCKSTEP)
        self._active = False
        self._timer = LoopTimer(1.0 / config.rate_hz)
        self._vented = False
        # Refused commands up to the last report.
        self._reported = 0
        # The driver has to go through its start-up again before it takes set points.
        self._lost = False
        if config.keep_latch and not self._lockstep:
            self._latch_file = LatchFile(config.device or str(platform.device))
            self._left = self._left or (None if config.take_over else self._latch_file.cause())
        if self._left is not None:
            self._chambers.vent(self._left)
        self._note(self._left or _KILLED.format(os.getpid()))

    def start(self) -> None:
        self._active = True
        if self._lockstep:
            self._last_tick_wall = time.monotonic()
            self.every(0.5, self._check_stall)
        else:
            self.every(1.0 / self._config.rate_hz, self._cycle)

    def stop(self) -> None:
        self._active = False
        # Vented and latched: active again, it needs ~/reset like after any other vent.
        if self._regulator is not None:
            self._chambers.vent(DEACTIVATED)
            self._obey(True)

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
            if hasattr(self, "_chambers"):  # else the start-up has failed
                self._left = None if self._chambers.cause == DEACTIVATED else self._chambers.cause
                self._note(self._left)

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
        self._tick_ns = messages.to_ns(message.clock)
        self._last_tick_wall = time.monotonic()
        self._pending = True
        self._try_tick()

    def _try_tick(self) -> None:
        if not (self._lockstep and self._active) or self._tick_ns is None or not self._pending:
            return
        if self._tick_ns > 0 and self._chambers.seen_ns < self._tick_ns - self._period_ns:
            return
        self._pending = False
        self._cycle()

    def _check_stall(self) -> None:
        silent = time.monotonic() - self._last_tick_wall
        if silent > self._config.lockstep_timeout_s and self._regulator is not None:
            self._chambers.vent(f"lockstep stalled: no tick or command for {silent:.0f} s")
            self._obey(True)

    # One cycle ------------------------------------------------------------------------------------
    def _cycle(self) -> None:
        if self._regulator is None:
            return
        self._timer.tick()
        stamp_ns = self._stamp_ns()
        try:
            exchange = self._regulator.exchange(self._chambers.setpoint_pa, self._now_ns())
        except HardwareError as error:
            self._lost = True
            self._chambers.vent(str(error))
            self._obey(True)
            return
        # Whatever the devices complain of, a reset takes them through their start-up, or says why it cannot.
        self._lost = self._lost or exchange.trouble is not None
        reading = exchange.known_pa
        self._obey(self._chambers.judge(reading, exchange.fresh, exchange.trouble, exchange.supply_pa))
        # An old reading with a fresh stamp would fool the estimator; lockstep waits for one at every tick.
        is_due = self._in_turn or self._lockstep or bool(exchange.fresh.all())
        if is_due and np.all(np.isfinite(exchange.pressure_pa)):
            known = self._chambers.interpolated(reading, exchange.fresh) if self._in_turn else reading
            self._chambers.publish(known, stamp_ns)

    def _recover(self) -> None:
        if self._lost and self._regulator is not None:
            self._regulator.configure()
            self._lost = False

    def _note(self, cause: str | None) -> None:
        """Keep why the arm is vented for the next process, or for the end of this one; None: it is not."""
        if self._latch_file is None:
            return
        try:
            if cause is None:
                self._latch_file.clear()
            else:
                self._latch_file.write(cause)
        except OSError as error:
            self.get_logger().warning(f"no note of the latch for the next driver: {error}", once=True)

    def _obey(self, vented: bool) -> None:
        """Vent when the latch closes, whatever closed it, and say so; say so too when it opens."""
        if vented and not self._vented:
            self._regulator.vent()
            self.diagnostics.update(ERROR, f"vented: {self._chambers.cause}", self._values())
            self._note(self._chambers.cause)
        elif self._vented and not vented:
            self.diagnostics.update(OK, "active", self._values())
            self._note(_KILLED.format(os.getpid()))
        self._vented = vented

    def diagnose(self) -> None:
        if self._regulator is None:
            return
        if self._chambers.cause is not None:
            self.diagnostics.update(ERROR, f"vented: {self._chambers.cause}", self._values())
            return
        rejected = sum(self._chambers.rejected.values())
        recently, self._reported = rejected > self._reported, rejected
        self.diagnostics.update(
            WARN if recently else OK, "commands refused" if recently else "active", self._values()
        )

    def _values(self) -> dict[str, object]:
        statistics = self._regulator.statistics if self._regulator is not None else None
        counts = {} if statistics is None else vars(statistics)
        return {
            **counts,
            "lateness_p50_ms": self._timer.percentile_ms(50),
            "lateness_p99_ms": self._timer.percentile_ms(99),
            "overruns": self._timer.overruns,
            "cause": self._chambers.cause or "",
            **{f"rejected {kind}": count for kind, count in self._chambers.rejected.items()},
        }


def main() -> None:
    """Entry point of `ros2 run soro_ros regulator`."""
    run_node(RegulatorNode)


if __name__ == "__main__":
    main()
