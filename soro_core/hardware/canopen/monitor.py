"""What the driver knows of one node, and the faults that follow from it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from soro_core.hardware.canopen import frames
from soro_core.hardware.canopen.cia408 import State, state_of
from soro_core.hardware.canopen.frames import NmtState
from soro_core.hardware.canopen.pdo import signed
from soro_core.hardware.canopen.startup import TPDO_LAYOUT, Scaling
from soro_core.hardware.platform import Platform
from soro_core.hardware.port import Fault

_GONE = frozenset({"rebooted", "left_operational", "heartbeat_lost"})


@dataclass
class NodeMonitor:
    """Record of one node. Times are those of `Regulator.exchange`, None before the first."""

    chamber: str
    node: int
    scaling: Scaling | None = None
    configured: bool = False
    pressure_pa: float = math.nan
    status: int = 0
    fresh: bool = False
    missed: int = 0
    late: int = 0
    garbled: int = 0
    emergencies: int = 0
    active: bool = False
    heard_ns: int | None = None
    read_ns: int | None = None
    requested_ns: int | None = None
    latched: dict[str, Fault] = field(default_factory=dict)

    @property
    def source(self) -> str:
        """How faults and errors name the node."""
        return f"{self.chamber} (node {self.node})"

    @property
    def gone(self) -> bool:
        """Whether no answers are to be expected of the node before it is configured again."""
        return not _GONE.isdisjoint(self.latched)

    def restart(self) -> None:
        """Forget everything but counts and the last pressure, before the node is configured."""
        self.scaling, self.configured, self.status, self.fresh = None, False, 0, False
        self.missed, self.active = 0, False
        self.heard_ns = self.read_ns = self.requested_ns = None
        self.latched.clear()

    def begin_cycle(self, now_ns: int) -> None:
        """Start a cycle; the time limits begin with the first one."""
        self.fresh = False
        if self.heard_ns is None or self.read_ns is None:
            self.heard_ns = self.read_ns = now_ns

    def on_reading(self, data: bytes, now_ns: int, in_cycle: bool) -> None:
        """Take the node's TPDO; it counts as fresh if it answers the SYNC of the running cycle."""
        if self.scaling is None or len(data) < TPDO_LAYOUT.length:
            self.garbled += 1
            return
        status, raw = TPDO_LAYOUT.unpack(data)
        self.status, self.pressure_pa = status, signed(raw, 16) * self.scaling.actual_pa
        if in_cycle:
            self.fresh, self.missed, self.read_ns = True, 0, now_ns
        elif self.missed:
            self.late += 1

    def on_heartbeat(self, data: bytes, now_ns: int) -> None:
        """Take the node's heartbeat or boot-up."""
        if len(data) != 1:
            self.garbled += 1
            return
        self.heard_ns = now_ns
        if not self.configured:
            return
        if data[0] == NmtState.BOOT_UP:
            self._latch("rebooted", "booted again and lost its configuration")
        elif data[0] & 0x7F != NmtState.OPERATIONAL:
            self._latch("left_operational", f"communication state 0x{data[0]:02X}")

    def on_emergency(self, data: bytes) -> None:
        """Take the node's emergency; code 0 says that an error is over and changes nothing here."""
        parsed = frames.parse_emergency(data)
        if parsed is None:
            self.garbled += 1
        elif parsed.code != 0:
            self.emergencies += 1
            if self.configured:
                self._latch("emergency", f"emergency {frames.emergency_text(parsed.code)}")

    def end_cycle(self, now_ns: int, asked_active: bool, platform: Platform) -> list[Fault]:
        """Judge a cycle and return every fault of the node."""
        times = platform.canopen
        limit_ns = round(times.heartbeat_consumer_s * 1e9)
        if self.heard_ns is not None and now_ns - self.heard_ns > limit_ns:
            self._latch("heartbeat_lost", f"not heard for {times.heartbeat_consumer_s * 1e3:.0f} ms")
        if asked_active:
            self._follow_state(now_ns, round(times.activation_timeout_s * 1e9))
        faults = list(self.latched.values())
        if not self.fresh:
            self.missed += 1
            age_ns = now_ns - (self.read_ns or now_ns)
            if self.missed >= times.stale_cycles or age_ns >= times.stale_s * 1e9:
                faults.append(Fault("stale_reading", self.source, f"no pressure for {self.missed} cycles"))
        return faults

    def stand_down(self) -> None:
        """The node is no longer asked to be ACTIVE, as in a vent."""
        self.active, self.requested_ns = False, None

    def _follow_state(self, now_ns: int, limit_ns: int) -> None:
        if self.requested_ns is None:
            self.requested_ns = now_ns
        if not self.fresh:
            return
        # All four bits: M, H and D alone (0111) are the fault reaction.
        if self.status & 0xF == State.ACTIVE.bits:
            self.active = True
        elif self.active:
            self._latch("not_active", f"fell from active to {state_of(self.status).value[0]}")
        elif state_of(self.status).is_fault or now_ns - self.requested_ns > limit_ns:
            self._latch("not_active", f"stays in {state_of(self.status).value[0]}")

    def _latch(self, code: str, message: str) -> None:
        self.latched.setdefault(code, Fault(code, self.source, message, latched=True))
